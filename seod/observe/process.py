"""The process beside the gateway: estimates, records and encodes what the loop writes, at ordinary priority.

It may be as slow as it likes: neither the loop nor the gateway waits for it.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING

from seod.config.model import RigConfig
from seod.config.settings import on_clock
from seod.estimate import make_estimator
from seod.observe.observer import Observer
from seod.observe.recording import Recording
from seod.processes.handover import ChildArguments, die_with_parent, read_memfd
from seod.processes.link import Link
from seod.processes.realtime import GATEWAY_OOM, be_ended_sooner
from seod.processes.ring import Shared, Word
from seod.record.errors import BusLogError
from seod.record.opening import open_bus_log, open_recorder

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.record.opening import Recorder

POLL_S = 0.004
"""How often rows and events are taken: a small part of the 2 s of rows that the ring holds."""


NICE = -5
"""Where the system allows it: rows are lost if it gets no processor for 2 s."""


class ObserveError(Exception):
    """It cannot start; the message says why."""


def start_recording(path: Path | None, config: RigConfig, rig_file: Path) -> Recording:
    """Start recording to a file, if one is given, and logging the bus, if the rig file asks for it.

    Raises:
        ObserveError: A file, or the bus, cannot be had.
    """
    try:
        bus_log = open_bus_log(config, rig_file.parent)
    except BusLogError as error:
        raise ObserveError(str(error)) from error
    try:
        recorder = None if path is None else open_recorder(path, config, text_of(rig_file, config))
    except OSError as error:
        Recording(bus_log=bus_log).close()
        raise ObserveError(f"cannot record to {path}: {error.strerror or error}") from error
    folder = config.record.folder
    if folder is None:
        return Recording(recorder, bus_log)

    def another() -> Recorder:
        where = rig_file.parent / folder
        where.mkdir(parents=True, exist_ok=True)
        name = f"{config.rig}-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}.mcap"
        return open_recorder(where / name, config, text_of(rig_file, config))

    return Recording(recorder, bus_log, another)


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
    """Run at ordinary priority, whatever was inherited: it must hold up no loop, nor take its memory."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    be_ended_sooner(GATEWAY_OOM)
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)


def observe(observer: Observer, link: Link) -> None:
    """Work until the gateway, or a signal, says that it is over."""

    def end(*_: object) -> None:
        observer.ended = True

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        observer.poll()  # whoever asks finds what has been said already
        link.send({"observer": "ready"})
        while not observer.ended:
            select.select([link], [], [], POLL_S)
            observer.poll()
    finally:
        observer.close()


def main() -> int:
    """Entry point of the process."""
    arguments = ChildArguments.from_argv()
    die_with_parent(arguments.supervisor_pid)
    leave_realtime()
    link = Link(socket.socket(fileno=arguments.supervisor_fd))
    config = RigConfig.model_validate_json(read_memfd(arguments.config_fd))
    shared = Shared(arguments.axes, arguments.rows, arguments.shared_fd)
    record = None if arguments.record is None else Path(arguments.record)
    try:
        recording = start_recording(record, config, Path(arguments.config_path))
        clock = clock_of(config, shared)
        observe(Observer(config, shared, link, make_estimator, clock, recording), link)
        link.send({"observer": "ended", "rows_missing": recording.rows_missing})
        link.flush()
    except ObserveError as error:
        link.send({"observer": "failed", "why": str(error)})
        return 1
    finally:
        shared.close()
        link.close()
    return int(recording.rows_missing > 0)
