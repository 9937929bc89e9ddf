"""The bus itself: python-can, its failures turned into counters and a sentence."""

from __future__ import annotations

import errno
import math
import socket
from copy import copy
from typing import TYPE_CHECKING

import can
from can.interfaces.socketcan.socketcan import build_can_frame

from drivers import can_counters as count
from drivers import can_socket
from drivers.base import DriverError
from drivers.can_errors import bus_event
from drivers.can_interfaces import asks_for_echo

if TYPE_CHECKING:
    from collections.abc import Sequence

    from can.typechecking import CanFilters

    from drivers.can_config import CanOptions

REOPEN_S = 0.5
"""Time between attempts to take an interface that was deleted and may have come back."""
FRAME_MEMORY = 1024
"""What a queued frame takes of the socket's send buffer, at most [bytes]."""
GONE = (errno.ENODEV, errno.ENXIO, errno.EBADF)
FULL = (errno.ENOBUFS, errno.EAGAIN)


class CanLink:
    """One python-can bus.

    Attributes:
        down: Why nothing can be sent or received ("" while it can).
        bus_off: Why the controller has left the bus ("" while it takes part).
        failures: How often either began.
        here: The frame that came last is of this computer; False also where that is unknown.

    Args:
        options: Of the driver.
        counts: The driver's health counters.
    """

    def __init__(self, options: CanOptions, counts: list[int]) -> None:
        self.down = ""
        self.bus_off = ""
        self.failures = 0
        self.here = False
        self._options = options
        self._counts = counts
        self._bus: can.BusABC | None = None
        self._raw: socket.socket | None = None
        self._filters: CanFilters = []
        self._queue = 0
        self._next_attempt = -math.inf

    def open(self, filters: CanFilters, queue: int) -> None:
        """Take the bus.

        Args:
            filters: python-can's filters: exactly the frames needed.
            queue: Frames that may wait in the socket at once.

        Raises:
            DriverError: It cannot be had.
        """
        self._filters = filters
        self._queue = queue
        self.down = self.bus_off = ""
        try:
            self._take_bus()
        except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
            o = self._options
            raise DriverError(
                f"driver: cannot open {o.interface} channel {o.channel!r}: {error}{self._advice(error)}"
            ) from error

    def _advice(self, error: Exception) -> str:
        if self._options.interface == "socketcan" and isinstance(error, OSError):
            return (
                " (see `ip -brief link show type can`, or make a virtual one: `ip link add vcan0 type vcan`)"
            )
        return ""

    def _take_bus(self) -> None:
        o = self._options
        wanted = {
            "interface": o.interface,
            "channel": o.channel,
            "bitrate": o.bitrate,
            "fd": o.fd,
        }
        if asks_for_echo(o):
            wanted["receive_own_messages"] = True
        if o.interface == "socketcan":
            socket.if_nametoindex(o.channel)  # python-can leaves a socket open if this fails later
        if o.data_bitrate is not None:
            wanted["data_bitrate"] = o.data_bitrate
        # configuration files of python-can on this machine must not change what the rig file says
        bus = can.Bus(ignore_config=True, **{**wanted, **o.bus_options, "can_filters": self._filters})
        self._bus = bus
        raw = getattr(bus, "socket", None)
        if o.interface == "socketcan" and isinstance(raw, socket.socket):
            raw.setblocking(False)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._queue * FRAME_MEMORY)
            self._raw = raw

    def receive(self, timeout: float = 0.0) -> can.Message | None:
        """The next frame, or None if there is none within `timeout` s or the bus is gone."""
        if self._bus is None:
            return None
        try:
            if self._raw is None:
                return self._bus.recv(timeout)
            frame = can_socket.receive(self._raw, timeout)
        except (can.CanError, OSError, ValueError) as error:
            if _code(error) == errno.EAGAIN:
                return None
            self._counts[count.RECEIVE_ERRORS] += 1
            self._fail(error)
            return None
        if frame is None:
            return None
        self.here = frame.here
        return frame.message

    @property
    def is_open(self) -> bool:
        """Whether there is a bus to wait on."""
        return self._bus is not None

    def send(self, message: can.Message) -> bool:
        """Hand one frame to the interface; False if it did not take it."""
        if self._bus is None:
            return False
        try:
            if self._raw is None:
                self._bus.send(_copy(message))
            else:
                self._raw.send(build_can_frame(message))
        except (can.CanError, OSError, ValueError) as error:
            self._send_failed(error)
            return False
        self._counts[count.FRAMES_SENT] += 1
        self.down = ""
        return True

    def _send_failed(self, error: Exception) -> None:
        if _code(error) in FULL or "buffer full" in str(error):
            self._counts[count.NO_BUFFERS] += 1
        else:
            self._counts[count.SEND_ERRORS] += 1
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        name = f"{self._options.interface} {self._options.channel}"
        code = _code(error)
        if not self.down:
            self.failures += 1
            self._counts[count.INTERFACE_DOWN] += 1
        if code == errno.ENETDOWN:
            self.bus_off = ""  # taking the interface down restarts the controller
            self.down = f"{name} is down: `ip link set {self._options.channel} up`"
        elif code in GONE:
            self.bus_off = ""  # one that comes back has a controller that starts anew
            self.down = f"{name} is gone"
            if self._options.interface == "socketcan":
                self._drop_bus()
        else:
            self.down = f"{name} fails: {error}"

    def reopen(self, t: float) -> None:
        """Now and then, try to take an interface again that was deleted: quick, as it is only a socket."""
        if self._bus is not None or t < self._next_attempt:
            return
        self._next_attempt = t + REOPEN_S
        try:
            self._take_bus()
        except (can.CanError, OSError):
            return
        self._counts[count.REOPENED] += 1

    def take_error_frame(self, message: can.Message) -> None:
        """Count what the controller says, and follow it off the bus and back."""
        event = bus_event(message.arbitration_id, message.data)
        counts = self._counts
        counts[count.ERROR_FRAMES] += 1
        counts[count.ERROR_WARNING] += event.warning
        counts[count.ERROR_PASSIVE] += event.passive
        counts[count.ACK_ERRORS] += event.ack_missing
        counts[count.OVERFLOWS] += event.overflow
        counts[count.RESTARTED] += event.restarted
        if event.restarted:
            self.bus_off = ""
        if event.bus_off:
            counts[count.BUS_OFF] += 1
            self.failures += 1
            channel = self._options.channel
            self.bus_off = (
                f"{channel} is bus-off after too many errors: check cable, termination and bit rate; "
                f"`ip link set {channel} type can restart` brings it back"
            )

    def close(self) -> None:
        """Give the bus back."""
        self._drop_bus()

    def _drop_bus(self) -> None:
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = self._raw = None


def _copy(message: can.Message) -> can.Message:
    """The message for an interface to do with as it likes: that of gs_usb pads the data in place."""
    mine = copy(message)
    mine.data = bytearray(message.data)
    return mine


def _code(error: Exception) -> int | None:
    """The errno behind an error of python-can or of the system."""
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return code if isinstance(code, int) else None


def filters_for(identifiers: Sequence[tuple[int, bool]]) -> CanFilters:
    """Filters that pass exactly these (identifier, extended) pairs."""
    return [
        {"can_id": frame_id, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended}
        for frame_id, extended in identifiers
    ]
