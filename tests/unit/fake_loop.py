"""A stand-in for the loop process: writes rows and events into the shared memory, answers commands."""

from __future__ import annotations

import asyncio
import json
import math
import os
import socket
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seod.client import Client
from seod.config.model import RigConfig
from seod.gateway.process import Gateway
from seod.observe import process as observing
from seod.observe.observer import Observer
from seod.observe.process import clock_of, start_recording
from seod.processes.link import Link
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH, AxisState, Shared, Word

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Coroutine

PERIOD = 1 / 2000
DEADLINE_S = 20.0


def rig_config(axes: tuple[str, ...] = ("motor",), **server: Any) -> RigConfig:
    def plant(name: str) -> dict[str, Any]:
        return {"input": f"{name}_u", "output": f"{name}_y", "K_L": 17.0, "omega_n": 117.0, "zeta": 0.21}

    def axis(name: str) -> dict[str, Any]:
        return {
            "sensor": name,
            "output": name,
            "K_L": 17.0,
            "relay": {"e_a": 0.5, "hysteresis": 0.004},
            "limits": {
                "output": 2.0,
                "travel": (-1.0, 1.0),
                "speed": 60.0,
                "amplitude": 0.5,
                "excitation": 60.0,
            },
            "polarity": {"movement": 0.01},
        }

    return RigConfig.model_validate(
        {
            "version": 1,
            "rig": "fake",
            "driver": {"kind": "virtual"},
            "sensors": {name: {"channel": f"{name}_y", "unit": "rad"} for name in axes},
            "outputs": {name: {"channel": f"{name}_u"} for name in axes},
            "axes": {name: axis(name) for name in axes},
            "server": {"port": 0, **server},
            "simulation": {"plants": {name: plant(name) for name in axes}},
        }
    )


class FakeLoop:
    """Writes what it is told; time goes on by one period a row.

    The limit cycle is a sine with its relay: enough for any estimator that counts crossings.
    """

    def __init__(self, axes: tuple[str, ...] = ("motor",), rows: int = 4096) -> None:
        self.axes = axes
        self.shared = Shared(len(axes), rows)
        self.t = 100.0
        self.state = AxisState.IDLE
        self.refuse: str | None = None
        self.silent = False
        self.taken: list[dict[str, Any]] = []
        self.estops = 0

    def event(self, kind: str, **fields: Any) -> None:
        self.shared.events.put({"event": kind, "t": self.t, **fields})

    def start(self, generation: int = 1) -> None:
        self.shared.commands.skip_to_head()
        realtime = {"ok": False, "why": ["this is a test"]}
        self.event(
            "started", generation=generation, realtime=realtime, simulated=True, counters=["late", "lost"]
        )

    def become(self, state: AxisState, axis: str = "motor") -> None:
        previous, self.state = self.state, state
        name = state.name.lower()
        self.event("state", axis=axis, state=name, previous=previous.name.lower(), why="test")

    def fault(self, why: str = "motor: too far", axis: str | None = "motor") -> None:
        self.event("fault", axis=axis, code="travel", why=why, numbers={"y": 1.5})
        self.become(AxisState.FAULT)

    def row(self, flags: int = FLAG_EXCITING | FLAG_FRESH, y: float | None = None) -> None:
        words = self.shared.words
        tick = words[Word.TICKS]
        position = 0.2 * math.sin(115.0 * self.t) if y is None else y
        volts = -math.copysign(0.5, position)
        one = (self.t, position, 0.0, volts, self.t + 1e-4, 0.5, 0.0, -position)
        one = (*one, math.nan, math.nan, 17.0, int(self.state), flags)
        ring = self.shared.row_ring
        values = one * len(self.axes)
        self.shared.row_struct.pack_into(ring.data, ring.next_offset(), tick, self.t, *values)
        ring.commit()
        words[Word.TICKS] = tick + 1
        self.shared.floats[Word.TICK_TIME_D] = self.t
        self.t += PERIOD

    def rows(self, number: int) -> None:
        for _ in range(number):
            self.row()

    def answer(self) -> None:
        """Take the commands that wait and answer each as told."""
        words = self.shared.words
        if words[Word.ESTOPS] > self.estops:
            self.estops = words[Word.ESTOPS]
            self.taken.append({"op": "estop", "axis": None, "values": {}})
            words[Word.ESTOPS_OBEYED] = 0 if self.silent else self.estops
        for command in self.shared.commands.take():
            self.taken.append(command)
            if self.silent:
                continue
            if command["op"] == "set" and self.refuse is None:
                self.event("changed", axis=self.axes[command["axis"]], values=command["values"])
            self.event("reply", id=command["id"], ok=self.refuse is None, error=self.refuse)

    async def keep_answering(self) -> None:
        while True:
            self.answer()
            await asyncio.sleep(0.001)

    def close(self) -> None:
        self.shared.close()


async def eventually(condition: Callable[[], object]) -> None:
    """Wait until something is so."""
    async with asyncio.timeout(DEADLINE_S):
        while not condition():  # noqa: ASYNC110 - many things, none of which an Event could be hung on
            await asyncio.sleep(0.002)


class Running:
    """A gateway under test with its fake loop and the supervisor's end of the socket.

    The process that estimates is a task here; `rig` is what it holds.
    """

    def __init__(self, gateway: Gateway, observer: Observer, loop: FakeLoop, link: socket.socket) -> None:
        self.gateway = gateway
        self.observer = observer
        self.rig = observer.rig
        self.loop = loop
        self.link = link
        self.port = 0


class Peer:
    """A client that speaks lines, for tests that must see every message."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer
        self.last_id = 0
        self.notifications: list[dict[str, Any]] = []

    async def read(self) -> dict[str, Any]:
        async with asyncio.timeout(DEADLINE_S):
            line = await self.reader.readline()
        if not line:
            raise EOFError
        return json.loads(line)

    async def send(self, data: bytes) -> None:
        self.writer.write(data)
        await self.writer.drain()

    async def call(self, method: str, /, **params: Any) -> Any:
        """Result or error of a call; what comes meanwhile is kept in `notifications`."""
        self.last_id += 1
        request = {"jsonrpc": "2.0", "id": self.last_id, "method": method, "params": params}
        await self.send(json.dumps(request).encode() + b"\n")
        while True:
            message = await self.read()
            if message.get("id") == self.last_id:
                return message.get("result", message.get("error"))
            self.notifications.append(message)

    async def until(self, method: str, **wanted: Any) -> dict[str, Any]:
        """The params of the next notification of a topic with these values."""
        while True:
            message = self.notifications.pop(0) if self.notifications else await self.read()
            params = message.get("params", {})
            if message.get("method") == method and wanted.items() <= params.items():
                return params

    async def close(self) -> None:
        self.writer.close()
        await self.writer.wait_closed()


def beside(
    config: RigConfig, shared: Shared, supervisor: socket.socket, rig_file: Path, record: Path | None = None
) -> tuple[Gateway, Observer, Coroutine[Any, Any, None]]:
    """A gateway, what estimates for it, and that one's work, all in this process."""
    ours, theirs = (Link(end) for end in socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET))
    its = Shared(shared.axes, shared.rows, os.dup(shared.fd))
    recording = start_recording(record, config, rig_file)
    observer = Observer(config, its, theirs, observing.make_estimator, clock_of(config, its), recording)

    async def observe() -> None:
        observer.poll()
        theirs.send({"observer": "ready"})
        while not observer.ended:
            observer.poll()
            await asyncio.sleep(0.002)
        observer.close()
        its.close()
        theirs.close()

    return Gateway(config, shared, supervisor, ours, rig_file), observer, observe()


@asynccontextmanager
async def running(
    axes: tuple[str, ...] = ("motor",),
    record: Path | None = None,
    base: Path = Path(),
    rows: int = 4096,
    started: bool = True,
    **server: Any,
) -> AsyncIterator[Running]:
    loop = FakeLoop(axes, rows)
    theirs, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    if started:
        loop.start()
    config = rig_config(axes, **server)
    gateway, observer, work = beside(config, loop.shared, theirs, base / "rig.yaml", record)
    run = Running(gateway, observer, loop, ours)
    tasks = [asyncio.create_task(each) for each in (gateway.run(), work, loop.keep_answering())]
    try:
        run.port = (await hear(run))["port"]
        yield run
    finally:
        gateway.end()
        tasks[2].cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        loop.close()
        theirs.close()
        ours.close()
    tasks[0].result()


async def hear(run: Running) -> dict[str, Any]:
    """The next message to the supervisor."""
    async with asyncio.timeout(DEADLINE_S):
        return json.loads(await asyncio.get_running_loop().sock_recv(run.link, 65536))


@asynccontextmanager
async def peer(run: Running, **options: Any) -> AsyncIterator[Peer]:
    reader, writer = await asyncio.open_connection("127.0.0.1", run.port, limit=1 << 22, **options)
    client = Peer(reader, writer)
    try:
        yield client
    finally:
        with suppress(OSError):
            await client.close()


def blocking(run: Running, **options: Any) -> Client:
    """The library's own client; use it in a thread."""
    return Client("127.0.0.1", run.port, **options)
