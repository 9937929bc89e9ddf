"""Raw frames of the CAN bus into a file of python-can, from a listening socket of the gateway's own.

Two threads of its own, one that hears and one that writes: for a slow format (a frame of MF4 takes python-can
25 times as long as one of BLF) or disk frames wait in memory, not in the socket, which drops them untold.
The loop's socket is not touched. Both directions are seen: SocketCAN hands each frame that is sent to all who
listen. The format follows the file's suffix: .blf, .asc, .log (candump), .mf4 ...
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import can

from seod.files.user_files import BUS_LOG_ENDINGS, create_recording, keep_earlier
from seod.record.errors import BusLogError

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.can_config import CanOptions

WAIT_S = 0.2
"""Longest wait for a frame, and pause after an error [s]."""
WAITING_FRAMES = 100_000
"""What may wait in memory; the rest is dropped and counted."""
LATE_S = 1.0
"""How long frames that wait at the end are still written [s]; then the file is ended without the rest."""
CLOSE_S = 5.0
"""How long the end of the daemon waits for the file [s]."""


class BusLog:
    """Logs from now on until `close`.

    Attributes:
        error: What is wrong at present; "" if nothing is.

    Args:
        path: The file; one that has content already is kept as `NAME~`.
        options: Of the CAN driver.

    Raises:
        BusLogError: Bus or file cannot be had.
    """

    def __init__(self, path: Path, options: CanOptions) -> None:
        self.error = ""
        self._path = path
        self._frames = self._unwritten = self._unheard = 0
        self._waiting: queue.Queue[can.Message] = queue.Queue(WAITING_FRAMES)
        self._bus = _listen(options)
        try:
            self._logger = _logger(path)
        except BusLogError:
            self._bus.shutdown()
            raise
        self._end = threading.Event()
        self._quiet = threading.Event()
        self._hearing = threading.Thread(target=self._hear, name="bus log: hears", daemon=True)
        self._writing = threading.Thread(target=self._write, name="bus log: writes", daemon=True)
        self._hearing.start()
        self._writing.start()

    def report(self) -> dict[str, Any]:
        """For `health`: file, frames in it, frames lost, and what is wrong (or null)."""
        counts = {"frames": self._frames, "lost": self._unwritten + self._unheard}
        return {"file": str(self._path), **counts, "error": self.error or None}

    def close(self) -> None:
        """Write what was heard until now and end the file; a disk that hangs is not waited for."""
        self._end.set()
        self._writing.join(CLOSE_S)
        lost = self._unwritten + self._unheard
        if self._writing.is_alive():
            print(f"seod: bus log {self._path}: it could not be ended in time", file=sys.stderr)  # noqa: T201
        elif lost:
            print(f"seod: bus log {self._path}: {lost} frames are not in it", file=sys.stderr)  # noqa: T201

    def _hear(self) -> None:
        while not self._end.is_set():
            self._quiet.set()
            if self._take(WAIT_S):
                self._quiet.clear()
                while self._take(0.0) and not self._end.is_set():
                    pass
        last = time.monotonic() + WAIT_S
        while self._take(0.0) and time.monotonic() < last:  # what the socket holds still
            pass
        self._quiet.set()
        self._bus.shutdown()

    def _take(self, wait_s: float) -> bool:
        try:
            frame = self._bus.recv(wait_s)
        except (can.CanError, OSError, ValueError) as error:
            self.error = f"{self._path}: the bus cannot be heard: {error}"
            self._end.wait(WAIT_S)
            return False
        if frame is None:
            return False
        try:
            self._waiting.put_nowait(frame)
        except queue.Full:
            self._unheard += 1
            self.error = f"{self._path} is written more slowly than the bus speaks"
        return True

    def _write(self) -> None:
        while not self._end.is_set():
            self._quiet.wait(WAIT_S)  # one thread of Python runs at a time, and hearing has the first turn
            self._put(WAIT_S)
        self._hearing.join()
        last = time.monotonic() + LATE_S
        while self._put(0.0) and time.monotonic() < last:
            pass
        self._unwritten += self._waiting.qsize()
        try:
            self._logger.stop()
        except OSError as error:
            self._failed(error)

    def _put(self, wait_s: float) -> bool:
        try:
            frame = self._waiting.get(timeout=wait_s)
        except queue.Empty:
            return False
        try:
            self._logger(frame)
        except (OSError, ValueError) as error:
            self._unwritten += 1
            self._failed(error)
        else:
            self._frames += 1
            if self._waiting.qsize() <= WAITING_FRAMES // 2:
                self.error = ""
        return True

    def _failed(self, error: Exception) -> None:
        self.error = f"{self._path} cannot be written: {getattr(error, 'strerror', None) or error}"


def _listen(options: CanOptions) -> can.BusABC:
    name = f"{options.interface} channel {options.channel!r}"
    if options.interface == "virtual":
        raise BusLogError(f"record.bus_log: {name} belongs to the loop's process and cannot be heard")
    try:
        return can.Bus(
            interface=options.interface,
            channel=options.channel,
            fd=options.fd,
            ignore_config=True,
            **options.bus_options,
        )
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise BusLogError(f"record.bus_log: cannot listen on {name}: {error}") from error


def _logger(path: Path) -> can.Listener:
    if path.suffix.lower() not in BUS_LOG_ENDINGS:
        raise BusLogError(
            f"record.bus_log: {path}: no such format; expected one of {', '.join(BUS_LOG_ENDINGS)}"
        )
    try:
        keep_earlier(path)
        os.close(create_recording(path))
        return can.Logger(path)
    except (ImportError, NotImplementedError) as error:  # asammdf, for MF4 alone
        raise BusLogError(f"record.bus_log: {path}: needs asammdf: pip install 'seod[mdf]'") from error
    except OSError as error:
        raise BusLogError(f"record.bus_log: cannot write {path}: {error.strerror or error}") from error
