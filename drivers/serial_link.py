"""The serial port itself: pyserial sets it up, the system's own calls move its bytes.

A read takes all that came and never waits (`drivers/serial_arrivals.py`); a write that finds no room keeps
what is left of its one frame, and nothing more: commands must not queue. An unplugged port is closed and
taken again when it returns.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import stat
import termios
from pathlib import Path
from typing import TYPE_CHECKING

import serial

from drivers import serial_counters as count
from drivers.base import DriverError
from drivers.serial_arrivals import Arrivals

if TYPE_CHECKING:
    from drivers.serial_config import SerialOptions

BY_ID = Path("/dev/serial/by-id")
CHUNK = 65536
REOPEN_S = 0.2
"""Time between attempts to take a port that is gone."""


class SerialLink:
    """One port.

    Attributes:
        down: Why nothing can be sent or received ("" while it can).

    Args:
        options: Of the driver.
        counts: The driver's health counters.
    """

    def __init__(self, options: SerialOptions, counts: list[int]) -> None:
        self.down = ""
        self._options = options
        self._counts = counts
        self._port: serial.Serial | None = None
        self._fd = -1
        self._arrivals: Arrivals | None = None
        self._pending = b""
        self._next_attempt = -math.inf

    def open(self) -> None:
        """Take the port.

        Raises:
            DriverError: It cannot be had.
        """
        try:
            self._take()
        except (OSError, ValueError, termios.error) as error:
            port = self._options.port
            raise DriverError(f"driver: cannot open port {port!r}: {self._advice(error)}") from error
        self.down = ""

    def _take(self) -> None:
        o = self._options
        mode = os.stat(o.port).st_mode  # noqa: PTH116 - as the system tells it
        if not stat.S_ISCHR(mode):
            raise ValueError("it is no serial port")
        port = serial.Serial(o.port, o.baud, timeout=0, write_timeout=0, exclusive=True)
        with contextlib.suppress(OSError, ValueError):  # a pty, or an adapter that has no such mode
            port.set_low_latency_mode(True)
        self._port, self._fd = port, port.fileno()
        self._arrivals = Arrivals(self._fd)
        self._pending = b""

    def _advice(self, error: Exception) -> str:
        code = getattr(error, "errno", None)
        if code == errno.ENOENT:
            ports = ", ".join(sorted(str(each) for each in BY_ID.glob("*"))) or "none is plugged in"
            return f"there is no such port; by stable names there are: {ports}"
        if code in (errno.EACCES, errno.EPERM):
            return "no permission: add the daemon's user to the group `dialout`"
        if code in (errno.EAGAIN, errno.EBUSY):
            return "another program has it"
        return str(error)

    @property
    def is_open(self) -> bool:
        """Whether there is a port to wait on."""
        return self._fd >= 0

    def wait(self, timeout: float) -> bool:
        """Whether something can be read within `timeout` [s]."""
        return self._arrivals is not None and self._arrivals.wait(timeout)

    def read(self) -> bytes:
        """All that came; nothing if the port is gone."""
        if self._arrivals is None or not self._arrivals.taken():
            return b""
        try:
            data = os.read(self._fd, CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._fail(error.strerror or str(error))
            return b""
        if not data and self._hung_up():
            self._fail("unplugged?")
        return data

    def _hung_up(self) -> bool:
        poll = select.poll()
        poll.register(self._fd, 0)
        return bool(poll.poll(0))

    def send(self, data: bytes) -> bool:
        """Hand over one frame; False, and nothing of it sent, if the frame before has not left whole."""
        if self._fd < 0 or not self.flush():
            return False
        try:
            written = os.write(self._fd, data)
        except BlockingIOError:
            return False
        except OSError as error:
            self._fail(error.strerror or str(error))
            return False
        self._pending = data[written:]
        return True

    def flush(self) -> bool:
        """Hand over what was left of the last frame; whether nothing is left now."""
        if self._pending and self._fd >= 0:
            try:
                self._pending = self._pending[os.write(self._fd, self._pending) :]
            except BlockingIOError:
                return False
            except OSError as error:
                self._fail(error.strerror or str(error))
                return False
        return not self._pending

    def drop_output(self) -> None:
        """Throw away what has not left yet."""
        self._pending = b""
        if self._fd >= 0:
            try:
                termios.tcflush(self._fd, termios.TCOFLUSH)
            except termios.error as error:
                self._fail(str(error))

    def reopen(self, t: float) -> bool:
        """Now and then, at time `t` [s], try to take a port again that is gone; whether it was taken."""
        if self._fd >= 0 or t < self._next_attempt:
            return False
        self._next_attempt = t + REOPEN_S
        try:
            self._take()
        except (OSError, ValueError, termios.error):
            return False
        self.down = ""
        self._counts[count.REOPENED] += 1
        return True

    def _fail(self, why: str) -> None:
        self._counts[count.UNPLUGGED] += 1
        self.close()
        self.down = f"the port {self._options.port} is gone: {why}"

    def close(self) -> None:
        """Give the port back."""
        if self._arrivals is not None:
            self._arrivals.close()
        if self._port is not None:
            self._port.close()
        self._port, self._fd, self._arrivals, self._pending = None, -1, None, b""
