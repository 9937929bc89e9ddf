"""The gateway process: estimates, records and serves what the loop writes, at ordinary priority.

It may be as slow as it likes: the loop never waits for it.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seod.config.model import RigConfig
from seod.estimate import make_estimator
from seod.gateway.hub import Hub
from seod.gateway.recording import Recording
from seod.gateway.rig import Rig
from seod.gateway.server import Server, ServerError
from seod.gateway.service import Service
from seod.process import ChildArguments, die_with_parent, read_memfd, receive_json, send_json
from seod.record.opening import BusLogError, open_bus_log, open_recorder
from seod.ring import Shared, Word
from seod.settings import on_clock

if TYPE_CHECKING:
    from collections.abc import Callable

POLL_S = 0.004
"""How often rows and events are taken: a small part of the 2 s of rows that the ring holds."""


class GatewayError(Exception):
    """The gateway cannot start; the message says why."""


class Gateway:
    """Ties rig, server and supervisor together.

    Args:
        config: The rig file.
        shared: The memory shared with the loop.
        link: Socket to the supervisor.
        rig_file: The rig file; paths in it start from its folder.
        record: File to record to, or None.
    """

    def __init__(
        self, config: RigConfig, shared: Shared, link: socket.socket, rig_file: Path, record: Path | None
    ) -> None:
        self._link = link
        self._ended = asyncio.Event()
        hub = Hub()
        recording = start_recording(record, config, rig_file)
        clock = clock_of(config, shared)
        self.rig = Rig(config, shared, hub, make_estimator, clock, self._restart_loop, recording)
        self.server = Server(config.server, rig_file.parent, Service(config.server, self.rig, hub), hub)
        self.rig.clients = self.server.clients

    def end(self) -> None:
        """End `run`."""
        self._ended.set()

    async def run(self) -> None:
        """Serve until told to end, or until the supervisor is gone.

        Raises:
            ServerError: It cannot listen.
        """
        loop = asyncio.get_running_loop()
        try:
            self.rig.poll()  # whoever connects finds what has been said already
            port = await self.server.start()
            loop.add_reader(self._link, self._hear)
            send_json(self._link, {"gateway": "ready", "port": port})
            while not self._ended.is_set():
                self.rig.poll()
                await asyncio.sleep(POLL_S)
        finally:
            loop.remove_reader(self._link)
            self.rig.close()
            await self.server.close()

    def _hear(self) -> None:
        message: dict[str, Any] | None = receive_json(self._link)
        if message is None:
            return
        if message.get("loop") == "died":
            self.rig.loop_died(message)
        elif not message or message.get("stop"):
            asyncio.get_running_loop().remove_reader(self._link)
            self.end()

    def _restart_loop(self) -> None:
        send_json(self._link, {"op": "restart_loop"})


def start_recording(path: Path | None, config: RigConfig, rig_file: Path) -> Recording:
    """Start recording to a file, if one is given, and logging the bus, if the rig file asks for it.

    Raises:
        GatewayError: A file, or the bus, cannot be had.
    """
    try:
        bus_log = open_bus_log(config, rig_file.parent)
    except BusLogError as error:
        raise GatewayError(str(error)) from error
    try:
        recorder = None if path is None else open_recorder(path, config, text_of(rig_file, config))
    except OSError as error:
        Recording(bus_log=bus_log).close()
        raise GatewayError(f"cannot record to {path}: {error.strerror or error}") from error
    return Recording(recorder, bus_log)


def text_of(rig_file: Path, config: RigConfig) -> str:
    """The rig file; where it was taken away meanwhile, what was read of it."""
    try:
        return rig_file.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return config.model_dump_json(indent=1)


def clock_of(config: RigConfig, shared: Shared) -> Callable[[], float]:
    """The clock of the rows: simulated and recorded time pass with the ticks, else it is CLOCK_MONOTONIC."""
    if not on_clock(config):
        return lambda: shared.floats[Word.TICK_TIME_D]
    return time.monotonic


def leave_realtime() -> None:
    """Run at ordinary priority, whatever was inherited: the gateway must never hold up the loop."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


async def serve(arguments: ChildArguments, link: socket.socket) -> None:
    """Map what was inherited, then run until the end.

    Raises:
        GatewayError, ServerError: It cannot start.
    """
    config = RigConfig.model_validate_json(read_memfd(arguments.config_fd))
    shared = Shared(arguments.axes, arguments.rows, arguments.shared_fd)
    record = None if arguments.record is None else Path(arguments.record)
    try:
        gateway = Gateway(config, shared, link, Path(arguments.config_path), record)
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, gateway.end)
        await gateway.run()
    finally:
        shared.close()


def main() -> int:
    """Entry point of the gateway process."""
    arguments = ChildArguments.from_argv()
    die_with_parent(arguments.supervisor_pid)
    leave_realtime()
    with socket.socket(fileno=arguments.supervisor_fd) as link:
        try:
            asyncio.run(serve(arguments, link))
        except (GatewayError, ServerError) as error:
            send_json(link, {"gateway": "failed", "why": str(error)})
            return 1
    return 0
