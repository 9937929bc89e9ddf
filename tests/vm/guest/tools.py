"""What the guest's tests are made of: processes, JSON-RPC by line, the bus itself. Standard library only."""

from __future__ import annotations

import json
import os
import select
import socket
import struct
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

if TYPE_CHECKING:
    import signal
    from collections.abc import Callable, Iterator

REPO = Path(__file__).parents[3]
SEOD = Path(sys.executable).with_name("seod")
CONFIG = Path(__file__).with_name("rig.yaml")
PATIENCE_S = 45.0
"""How long a condition may take to come true; none should."""

COMMAND_ID = 0x201
"""The message `Valve` of configs/motor.dbc: command voltage in its first two bytes, 0.5 mV a bit."""

CAN_ERR_FLAG = 0x20000000
CAN_ERR_CRTL, CAN_ERR_BUSOFF, CAN_ERR_RESTARTED = 0x004, 0x040, 0x100
"""Error messages of linux/can/error.h; `vcan` never makes any, so that the tests send them."""

Json = dict[str, Any]
T = TypeVar("T")


def until(what: str, look: Callable[[], T], patience_s: float = PATIENCE_S) -> T:
    """Wait until `look()` is true; returns what it gave."""
    deadline = time.monotonic() + patience_s
    while True:
        found = look()
        if found:
            return found
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {patience_s:g} s: {what} (last: {found!r})")
        time.sleep(0.02)


class RpcError(Exception):
    """The other end said no."""


class Rpc:
    """JSON-RPC by line, as any client would write it; notifications are kept in `heard`."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self.lines = self.socket.makefile("rb")
        self.number = 0
        self.heard: list[Json] = []

    def call(self, method: str, **params: Any) -> Any:
        """The result of a call."""
        self.number += 1
        request = {"jsonrpc": "2.0", "id": self.number, "method": method, "params": params}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        while True:
            message = self.next()
            if message.get("id") != self.number:
                self.heard.append(message)
            elif "error" in message:
                raise RpcError(message["error"]["message"])
            else:
                return message["result"]

    def next(self) -> Json:
        """The next message, whatever it is."""
        line = self.lines.readline()
        assert line, "the other end hung up"
        message: Json = json.loads(line)
        return message

    def wait_for(self, what: str, fits: Callable[[Json], bool]) -> Json:
        """The first notification that fits, those already heard included; takes it and all before it."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            message = self.heard.pop(0) if self.heard else self.next()
            if fits(message):
                return message
            assert message.get("params", {}).get("event") != "fault", f"waiting for {what}: {message}"
        raise AssertionError(f"not within {PATIENCE_S:g} s: {what}")

    def event(self, **wanted: Any) -> Json:
        """The first event with these values."""
        params: Json = self.wait_for(
            f"event {wanted}",
            lambda m: m.get("method") == "event" and wanted.items() <= m["params"].items(),
        )["params"]
        return params

    def close(self) -> None:
        """Hang up."""
        self.lines.close()
        self.socket.close()


class Program:
    """`seod ARGS` as a process with its output in a file; whatever it leaves behind is ended too."""

    def __init__(self, log: Path, *arguments: str | Path) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [SEOD, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Of the process that was started: for the daemon, its supervisor."""
        return self.process.pid

    def said(self) -> str:
        """All output so far."""
        return self.log.read_text(errors="replace")

    def wait(self) -> int:
        """Exit code."""
        return self.process.wait(PATIENCE_S)

    def stop(self) -> None:
        """SIGTERM, and SIGKILL if need be."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                raise


def free_port() -> int:
    """A TCP port on loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def port_open(port: int) -> bool:
    """Whether something listens."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def find_process(word: str, parent: int | None = None) -> int:
    """The process with this word in its command line (and this parent); 0 if there is none that lives."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        if word.encode() in words and fields[0] != "Z" and parent in (None, int(fields[1])):
            return int(entry.name)
    return 0


class Seen(NamedTuple):
    """A command frame on the bus."""

    t: float
    """Kernel timestamp, converted to CLOCK_MONOTONIC [s]."""
    volts: float


class Listener:
    """A third party on the bus that sees every command frame with its kernel timestamp."""

    SO_RCVBUFFORCE, SO_TIMESTAMPNS = 33, 35  # asm-generic/socket.h; not in Python's module

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        only = struct.pack("=II", COMMAND_ID, socket.CAN_SFF_MASK | socket.CAN_EFF_FLAG)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, only)
        self.socket.setsockopt(socket.SOL_SOCKET, self.SO_TIMESTAMPNS, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, self.SO_RCVBUFFORCE, 16 << 20)
        self.socket.bind(("vcan0",))
        self.frames: list[Seen] = []

    def read(self) -> list[Seen]:
        """Everything seen so far."""
        offset = time.monotonic() - time.time()
        while select.select([self.socket], [], [], 0)[0]:
            try:
                frame, extra, _, _ = self.socket.recvmsg(72, 64)
            except OSError:  # the interface went down: told once, then it goes on
                continue
            seconds, nanoseconds = struct.unpack("qq", extra[0][2][:16])
            (raw,) = struct.unpack_from("<h", frame, 8)
            self.frames.append(Seen(seconds + nanoseconds * 1e-9 + offset, raw * 0.0005))
        return self.frames

    def close(self) -> None:
        """Stop listening."""
        self.socket.close()


def send_raw(can_id: int, data: bytes) -> None:
    """Put one frame on the bus; with CAN_ERR_FLAG it is an error message as a controller reports it."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.bind(("vcan0",))
        bus.send(struct.pack("=IB3x8s", can_id, len(data), data))


def ip(*arguments: str) -> None:
    """`ip ...`."""
    subprocess.run(["ip", *arguments], check=True)


def tc(*arguments: str) -> None:
    """`tc qdisc ...`."""
    subprocess.run(["tc", "qdisc", *arguments], check=True)


@contextmanager
def slow_bus() -> Iterator[None]:
    """vcan0 carries some 200 frames a second, behind a queue of 10 s; what is in it at the end is lost."""
    tc("add", "dev", "vcan0", "root", "tbf", "rate", "30kbit", "burst", "1kb", "latency", "10s")
    try:
        yield
    finally:
        tc("del", "dev", "vcan0", "root")


def kill(pid: int, number: signal.Signals) -> None:
    """Signal a process that may be gone already."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return
