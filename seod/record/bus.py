"""Raw frames of the CAN bus into a file of python-can, from a listening socket of the gateway's own.

A thread of its own; the loop's socket is not touched. Both directions are seen: SocketCAN hands each frame
that is sent to all who listen. The format follows the file's suffix: .blf, .asc, .log (candump), .mf4 ...
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import can

from seod.record.opening import BusLogError

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.can_config import CanOptions

WAIT_S = 0.2
"""Longest wait for a frame, and pause after an error [s]."""
CLOSE_S = 5.0
SUFFIXES = (".asc", ".blf", ".csv", ".log", ".mf4", ".trc")


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
        self._frames = self._lost = 0
        self._bus = _listen(options)
        try:
            self._logger = _logger(path)
        except BusLogError:
            self._bus.shutdown()
            raise
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bus log", daemon=True)
        self._thread.start()

    def report(self) -> dict[str, Any]:
        """For `health`: file, frames in it, frames lost, and what is wrong (or null)."""
        counts = {"frames": self._frames, "lost": self._lost}
        return {"file": str(self._path), **counts, "error": self.error or None}

    def close(self) -> None:
        """End the file; a disk that hangs is not waited for."""
        self._end.set()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        while not self._end.is_set():
            self._step()
        self._bus.shutdown()
        try:
            self._logger.stop()
        except OSError as error:
            self._failed(error)

    def _step(self) -> None:
        try:
            frame = self._bus.recv(WAIT_S)
        except (can.CanError, OSError, ValueError) as error:
            self.error = f"{self._path}: the bus cannot be heard: {error}"
            self._end.wait(WAIT_S)
            return
        if frame is None:
            return
        try:
            self._logger(frame)
        except (OSError, ValueError) as error:
            self._lost += 1
            self._failed(error)
        else:
            self._frames += 1
            self.error = ""

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
    if path.suffix.lower() not in SUFFIXES:
        raise BusLogError(f"record.bus_log: {path}: no such format; expected one of {', '.join(SUFFIXES)}")
    try:
        if path.is_file() and path.stat().st_size:
            path.replace(path.with_name(path.name + "~"))
        return can.Logger(path)
    except (ImportError, NotImplementedError) as error:  # asammdf, for MF4 alone
        raise BusLogError(f"record.bus_log: {path}: needs asammdf: pip install 'seod[mdf]'") from error
    except OSError as error:
        raise BusLogError(f"record.bus_log: cannot write {path}: {error.strerror or error}") from error
