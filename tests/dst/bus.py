"""A CAN bus with this computer's interface on one end and a rig on the other, on simulated time.

Frames travel one after the other, lowest identifier first. The interface has a queue, can be down, gone, off
the bus or cut off.
"""

from __future__ import annotations

import errno
import socket
import struct
from collections import deque
from typing import TYPE_CHECKING, Any, ClassVar

from drivers import can_counters as count
from tests.dst.frames import ENCODER, SUPPLY, VALVE, Valve, sensed
from tests.dst.shells import Shell
from tests.dst.world import End

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.dst.world import Process, World

FRAME = struct.Struct("=IB3x8s")
ERR_FLAG = 0x20000000
CONFIRM, LOCAL = int(socket.MSG_CONFIRM), int(socket.MSG_DONTROUTE)
QUEUE = 10
"""Frames that the interface holds: txqueuelen."""
INBOX = 400
"""Frames that a socket holds."""
BIT_S = 1e-6
COUNTED = (
    count.FRAMES_RECEIVED,
    count.REPEATED,
    count.REORDERED,
    count.GARBAGE,
    count.CHECKSUM_ERRORS,
    count.WRONG_LENGTH,
)
"""Each frame of the sensors that is taken is in one of these."""


class CanSocket(End):
    """A raw CAN socket of this computer."""

    bus: Bus

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.fd = next(world.fds)
        world.ends[self.fd] = self
        self.process: Process = world.me().process
        self.inbox: deque[tuple[bytes, float, int]] = deque()
        self.errors: deque[OSError] = deque()
        self.wanted: frozenset[int] | None = frozenset()
        self.bound = False
        self.sent = 0
        self.taken: dict[int, int] = {}
        self.overflown = 0
        self.process.held.append(self)

    def readable(self) -> bool:
        return bool(self.inbox or self.errors)

    def bind(self, _: tuple[str]) -> None:
        if not self.bus.there:
            raise OSError(errno.ENODEV, "No such device")
        self.bound = True
        self.bus.sockets.append(self)

    def setsockopt(self, *_: object) -> None:
        """As it is."""

    def setblocking(self, _: bool) -> None:
        """It never blocks."""

    def fileno(self) -> int:
        return self.fd

    def send(self, frame: bytes) -> int:
        self.world.touch("send")
        self.world.me()
        if self not in self.bus.sockets:
            raise OSError(errno.ENXIO, "No such device or address")
        self.bus.queue_frame(self, frame)
        self.world.touch("sent")
        return len(frame)

    def recvmsg(self, *_: object) -> tuple[bytes, list[tuple[int, int, bytes]], int, None]:
        self.world.touch("receive")
        if self.errors:
            raise self.errors.popleft()
        if not self.inbox:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        frame, stamp, flags = self.inbox.popleft()
        identifier = FRAME.unpack(frame)[0]
        self.taken[identifier] = self.taken.get(identifier, 0) + 1
        seconds = int(stamp)
        return frame, [(0, 0, struct.pack("@ll", seconds, int((stamp - seconds) * 1e9)))], flags, None

    def deliver(self, frame: bytes, identifier: int, flags: int) -> None:
        wanted = identifier & ERR_FLAG or self.wanted is None or identifier in self.wanted
        if not wanted:
            return
        if len(self.inbox) >= INBOX:
            self.overflown += 1
            return
        self.inbox.append((frame, self.bus.realtime(), flags))
        if self.watchers:
            self.changed()

    def miscount(self, counters: list[int]) -> str:
        """What the driver's counters tell wrong ("" where nothing)."""
        if counters[count.REOPENED]:
            return ""
        taken = self.taken.get(ENCODER, 0) + self.taken.get(SUPPLY, 0)
        told = sum(counters[kind] for kind in COUNTED)
        # one of each message may be in doubt, one in hand; after a long gap the first is left out
        doubt = 3 + counters[count.COUNTER_RESTARTS] + counters[count.LOST] // 8
        if not 0 <= taken - told <= doubt:
            return f"{taken} sensor frames were taken, the counters add up to {told}"
        if self.sent - counters[count.FRAMES_SENT] not in (0, 1):
            return f"{self.sent} frames were sent, {counters[count.FRAMES_SENT]} counted"
        return ""

    def close(self) -> None:
        if self in self.process.held:
            self.process.held.remove(self)
        self.give_back()

    def give_back(self) -> None:
        if self in self.bus.sockets:
            self.bus.sockets.remove(self)


class HostBus:
    """`can.Bus` as python-can makes it for SocketCAN."""

    def __init__(self, raw: CanSocket) -> None:
        self.socket = raw

    def shutdown(self) -> None:
        self.socket.close()


class LinkSockets(Shell):
    """`socket` as `drivers.can_link` uses it."""

    def __init__(self, world: World, bus: Bus) -> None:
        super().__init__(world, socket)
        self._bus = bus
        self.socket = CanSocket

    def if_nametoindex(self, name: str) -> int:
        if not self._bus.there:
            raise OSError(errno.ENODEV, f"no interface {name}")
        return 3


class Bus:
    """The wire, the interface, and what can go wrong with both.

    Attributes:
        there, up, off, cut: Of the interface: it exists; it is up; it has left the bus; nobody acknowledges.
        slow: Factor on the time of a frame: other traffic has the rest.
        works: Frames pass, both ways, in their time.
        on_command: Told of each command frame that the interface takes: socket, command.
        on_arrival: Told of each command frame that reaches the rig: data.
        on_sensor: Told of encoder frames that reach this computer: run enable, sound, counter.
        on_foreign: Told of others' commands that reach it.
    """

    HEALTHY: ClassVar[dict[str, Any]] = {"there": True, "up": True, "off": False, "cut": False, "slow": 1.0}

    def __init__(self, world: World, realtime: Callable[[], float]) -> None:
        self.world, self.realtime = world, realtime
        self.there = self.up = True
        self.off = self.cut = False
        self.slow = 1.0
        self.works = True
        self.sockets: list[CanSocket] = []
        self.queue: deque[tuple[CanSocket | None, bytes]] = deque()
        self.others: deque[tuple[int, bytes]] = deque()
        self.on_command: Callable[[CanSocket, Valve], None] = lambda *_: None
        self.on_arrival: Callable[[bytes], None] = lambda _: None
        self.on_sensor: Callable[[bool, bool, int], None] = lambda *_: None
        self.on_foreign: Callable[[], None] = lambda: None
        self._busy = False

    # ---- frames

    def queue_frame(self, source: CanSocket, frame: bytes) -> None:
        """A program sends.

        Raises:
            OSError: As the kernel would.
        """
        if not self.up:
            raise OSError(errno.ENETDOWN, "Network is down")
        if len(self.queue) >= QUEUE:
            raise OSError(errno.ENOBUFS, "No buffer space available")
        self.queue.append((source, frame))
        self.world.note(f"{source.process.name} sends {frame.hex()}")
        if FRAME.unpack(frame)[0] == VALVE:
            self.on_command(source, Valve(frame[8:12]))
        source.sent += 1
        self._go()

    def put(self, identifier: int, data: bytes) -> None:
        """Another node sends."""
        if len(self.others) < 64:
            self.others.append((identifier, data))
            self._go()

    def _host_may(self) -> bool:
        return bool(self.queue) and self.there and self.up and not self.off and not self.cut

    def _go(self) -> None:
        if self._busy:
            return
        host = self._host_may()
        if not host and not self.others:
            return
        if host and self.others:
            host = FRAME.unpack(self.queue[0][1])[0] <= self.others[0][0]
        self._busy = True
        length = self.queue[0][1][4] if host else len(self.others[0][1])
        duration = (55 + 10 * length) * BIT_S * self.slow
        self.world.at(self.world.now + duration, lambda: self._finish(host))

    def _finish(self, host: bool) -> None:
        self._busy = False
        if host:
            if self._host_may():
                self._host_sent(*self.queue.popleft())
        elif self.others:
            identifier, data = self.others.popleft()
            self._arrive_here(identifier, data)
            if identifier == VALVE:
                self.on_arrival(data)
        self._go()

    def _host_sent(self, source: CanSocket | None, frame: bytes) -> None:
        identifier, length, data = FRAME.unpack(frame)
        if source is None:
            self.on_foreign()
        for each in list(self.sockets):
            each.deliver(frame, identifier, LOCAL | CONFIRM if each is source else LOCAL)
        if identifier == VALVE:
            self.on_arrival(data[:length])

    def _arrive_here(self, identifier: int, data: bytes) -> None:
        if self.there and self.up and not self.off and not self.cut:
            frame = FRAME.pack(identifier, len(data), data)
            if identifier == ENCODER:
                self.on_sensor(*sensed(data))
            elif identifier == VALVE:
                self.on_foreign()
            for each in list(self.sockets):
                each.deliver(frame, identifier, 0)

    def send_local(self, data: bytes) -> None:
        """Another program on this computer sends a command."""
        if self._host_may() or not self.queue:
            self.queue.append((None, FRAME.pack(VALVE, len(data), data)))
            self._go()

    # ---- trouble

    def set_state(self, **state: Any) -> None:
        """Change what is wrong with the interface, with what programs see of it."""
        was_up, was_there, was_off = self.up, self.there, self.off
        for name, value in state.items():
            setattr(self, name, value)
        self.works = all(getattr(self, name) == value for name, value in self.HEALTHY.items())
        self.world.note(f"bus {state}")
        if was_there and not self.there:
            self._tell_error(errno.ENODEV)
            self.sockets.clear()
            self.queue.clear()
        elif was_up and not self.up:
            self._tell_error(errno.ENETDOWN)
            self.queue.clear()
        if not was_off and self.off:
            self.queue.clear()
            self._error_frame(0x040, bytes(8))
        elif was_off and not self.off:
            self._error_frame(0x100, bytes(8))
        self._go()

    def passive(self) -> None:
        """The controller says that it is error passive."""
        self._error_frame(0x004, bytes([0, 0x30, 0, 0, 0, 0, 0, 0]))

    def _tell_error(self, code: int) -> None:
        for each in self.sockets:
            each.errors.append(OSError(code, "the interface"))
            each.changed()

    def _error_frame(self, classes: int, data: bytes) -> None:
        for each in list(self.sockets):
            each.deliver(FRAME.pack(ERR_FLAG | classes, 8, data), ERR_FLAG | classes, 0)
