"""The gateway process: serves clients, and nothing else, so that an e-stop never waits for a computation.

What is to be known of the rig it asks of a process of its own, `seod.observe`, whose end is its end as well.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import resource
import signal
import socket
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seod.client.nearby import Address, announce
from seod.config.model import RigConfig
from seod.gateway.desk import Desk
from seod.gateway.hub import Hub
from seod.gateway.server import Server, ServerError
from seod.gateway.service import Service
from seod.processes.hand_in import receive_client
from seod.processes.handover import ChildArguments, die_with_parent, read_memfd, receive_json, send_json
from seod.processes.link import Link
from seod.processes.realtime import GATEWAY_OOM, be_ended_sooner, set_fifo
from seod.processes.ring import Shared, Word

if TYPE_CHECKING:
    from collections.abc import Iterator

POLL_S = 0.004
"""How often it looks for what the loop says,"""
BUSY_POLL_S = 0.001
"""and while somebody waits for the loop's answer."""
CLIENTS_S = 0.1
"""How often the number of clients is told to who publishes it."""
OBSERVER_HANG_S = 20.0
"""The process that estimates hangs if it has not turned for this long; a disk may hold it up for seconds."""
OBSERVER_END_S = 2.0
"""How long it may take to end its recording; less than the gateway itself has."""
PRIORITY = 1
"""Under SCHED_FIFO: before all that is ordinary, so that an e-stop does not wait for it; behind the loop."""
NICE = -10
"""Where that is refused."""


class GatewayError(Exception):
    """The gateway cannot start, or go on; the message says why."""


class Gateway:
    """Ties clients, loop, supervisor and the process that estimates together.

    Args:
        config: The rig file.
        shared: The memory shared with the loop.
        link: Socket to the supervisor.
        observer: To the process that estimates.
        rig_file: The rig file; paths in it start from its folder.
        panel: Where the panel hands in its clients, or None.
    """

    def __init__(
        self,
        config: RigConfig,
        shared: Shared,
        link: socket.socket,
        observer: Link,
        rig_file: Path,
        panel: socket.socket | None = None,
    ) -> None:
        self._link, self._observer, self._panel = link, observer, panel
        self._words = shared.words
        self._ended = asyncio.Event()
        self._observer_ready = asyncio.Event()
        self._observer_gone = asyncio.Event()
        self._why = "the process that estimates has ended"
        self.recorded_all = False
        """The process that estimates and records has said, at its end, that no row is missing."""
        self.hub = Hub(observer.send)
        self.desk = Desk(config, shared, observer, self.hub, self._restart_loop)
        self.server = Server(
            config.server, rig_file.parent, Service(config.server, self.desk, self.hub), self.hub
        )
        self.desk.clients = self.server.clients

    def end(self) -> None:
        """End `run`."""
        self._ended.set()

    async def run(self) -> None:
        """Serve until told to end, or until the supervisor is gone.

        Raises:
            ServerError: It cannot listen.
            GatewayError: The process that estimates cannot start, has ended, or hangs.
        """
        held = None
        loop = asyncio.get_running_loop()
        loop.add_reader(self._observer.fileno(), self._hear_observer)
        loop.add_reader(self._link, self._hear)
        try:
            await self._first_of(self._observer_ready)
            if not self._ended.is_set():
                port = await self.server.start()
                if self._panel is not None:
                    loop.add_reader(self._panel, self._take_in, self._panel)
                server = self.server.config
                held = announce(Address(self.desk.config.rig, server.host, port, server.tls is not None))
                send_json(self._link, {"gateway": "ready", "port": port})
            await self._serve()
        except (GatewayError, ServerError) as error:
            send_json(self._link, {"gateway": "failed", "why": str(error)})  # while there is time to hear it
            raise
        finally:
            await self._end_observer()
            loop.remove_reader(self._link)
            loop.remove_reader(self._observer.fileno())
            if self._panel is not None:
                loop.remove_reader(self._panel)
            self._observer.close()
            await self.server.close()
            if held is not None:
                held.close()

    async def _serve(self) -> None:
        """Until the end: each turn takes what the loop said, and is counted."""
        beat, heard, told = -1, time.monotonic(), 0.0
        while not self._ended.is_set() and not self._observer_gone.is_set():
            self.desk.poll()
            self._words[Word.GATEWAY_BEAT] += 1
            now = time.monotonic()
            if now - told > CLIENTS_S:
                told = now
                self.desk.tell_clients()
            if self._words[Word.OBSERVER_BEAT] != beat:
                beat, heard = self._words[Word.OBSERVER_BEAT], now
            elif now - heard > OBSERVER_HANG_S:
                raise GatewayError(f"the process that estimates hung: no turn for {OBSERVER_HANG_S:g} s")
            await asyncio.sleep(BUSY_POLL_S if self.desk.mailbox.busy else POLL_S)
        if not self._ended.is_set():
            raise GatewayError(self._why)

    async def _first_of(self, event: asyncio.Event) -> None:
        """Wait for an event, or for the end of either side. The supervisor watches the time."""
        waiting = [asyncio.ensure_future(e.wait()) for e in (event, self._ended, self._observer_gone)]
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        for each in waiting:
            each.cancel()

    async def _end_observer(self) -> None:
        """Have the recording ended, and hand on what is still said."""
        self._observer.send({"stop": True})
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(OBSERVER_END_S):
                await self._observer_gone.wait()

    def _hear_observer(self) -> None:
        message = self._observer.receive()
        if message is None:
            return
        if not message or message.get("observer") == "failed":
            self._why = message.get("why", self._why)
            asyncio.get_running_loop().remove_reader(self._observer.fileno())
            self._observer_gone.set()
        elif message.get("observer") == "ready":
            self._observer_ready.set()
        elif message.get("observer") == "ended":
            self.recorded_all = message["rows_missing"] == 0
        else:
            self.desk.hear(message)

    def _hear(self) -> None:
        message: dict[str, Any] | None = receive_json(self._link)
        if message is None:
            return
        if message.get("loop") == "died":
            self.desk.loop_died(message)
        elif not message or message.get("stop"):
            asyncio.get_running_loop().remove_reader(self._link)
            self.end()

    def _take_in(self, panel: socket.socket) -> None:
        """The panel hands in a client: its end of a connection, and where it comes from."""
        taken = receive_client(panel)
        if taken is not None:
            self.server.take_in(*taken)

    def _restart_loop(self) -> None:
        send_json(self._link, {"op": "restart_loop"})


def prepare() -> None:
    """As many descriptors as the system allows, and what is loaded by now out of the collector's way."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    gc.collect()
    gc.freeze()


def go_before_others() -> None:
    """Before all that is ordinary, where the system allows it; `Turns` bounds what that takes.

    Where memory runs out it goes before the loop.
    """
    be_ended_sooner(GATEWAY_OOM)
    if set_fifo(PRIORITY):
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, NICE)


@contextlib.contextmanager
def observing(arguments: ChildArguments) -> Iterator[Link]:
    """The process that estimates and records, as a child; killed if it does not end by itself."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    given = replace(arguments, supervisor_fd=theirs.fileno(), supervisor_pid=os.getpid(), panel_fd=-1)
    with ours:
        command, fds = given.command("seod.observe"), given.inherited()
        process = subprocess.Popen(command, pass_fds=fds, stdin=subprocess.DEVNULL)  # noqa: S603 - our own
        theirs.close()
        try:
            yield Link(ours)
        finally:
            end(process)


def end(process: subprocess.Popen[bytes]) -> None:
    """It has said all, or does not answer: a moment, then it is killed."""
    try:
        process.wait(0.5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


async def serve(arguments: ChildArguments, link: socket.socket, observer: Link) -> bool:
    """Map what was inherited, then run until the end.

    Returns:
        Whether the recording has all rows, and its end.

    Raises:
        GatewayError, ServerError: It cannot start.
    """
    config = RigConfig.model_validate_json(read_memfd(arguments.config_fd))
    shared = Shared(arguments.axes, arguments.rows, arguments.shared_fd)
    try:
        panel = None if arguments.panel_fd < 0 else socket.socket(fileno=arguments.panel_fd)
        gateway = Gateway(config, shared, link, observer, Path(arguments.config_path), panel)
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, gateway.end)
        prepare()
        await gateway.run()
        return gateway.recorded_all
    finally:
        shared.close()


def main() -> int:
    """Entry point of the gateway process."""
    arguments = ChildArguments.from_argv()
    die_with_parent(arguments.supervisor_pid)
    with socket.socket(fileno=arguments.supervisor_fd) as link, observing(arguments) as observer:
        go_before_others()
        try:
            recorded_all = asyncio.run(serve(arguments, link, observer))
        except (GatewayError, ServerError):
            return 1
    return int(arguments.record is not None and not recorded_all)
