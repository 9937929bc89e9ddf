"""What stands in for `socket`: pairs between processes, and the interface to the bus."""

from __future__ import annotations

import errno
import socket
from collections import deque
from typing import Any

from tests.dst.shells import Shell
from tests.dst.world import End, World

PACKETS = 278
"""Datagrams that a socket pair holds."""


class Holder:
    """A process' hold on an end of a socket pair."""

    def __init__(self, world: World, end: PairEnd) -> None:
        self.world, self.end = world, end
        self.open = True
        end.holders += 1
        self._process = world.current.process if world.current is not None else None
        if self._process is not None:
            self._process.held.append(self)

    def give_back(self) -> None:
        """Closed, by the process or by its end."""
        if self.open:
            self.open = False
            self.end.drop()

    # ---- as `socket.socket`

    def setblocking(self, _: bool) -> None:
        """It never blocks."""

    def setsockopt(self, *_: object) -> None:
        """Its buffers are as they are."""

    def fileno(self) -> int:
        """Its descriptor."""
        return self.end.fd

    def send(self, data: bytes, *_: object) -> int:
        """One datagram."""
        self.world.me()
        return self.end.send(data)

    def recv(self, *_: object) -> bytes:
        """One datagram; b"" at the end."""
        self.world.me()
        return self.end.recv()

    def close(self) -> None:
        """Give it back."""
        if self._process is not None and self in self._process.held:
            self._process.held.remove(self)
        self.give_back()

    def __enter__(self) -> Holder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class PairEnd(End):
    """One end of a pair of SOCK_SEQPACKET sockets."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.fd = next(world.fds)
        world.ends[self.fd] = self
        self.inbox: deque[bytes] = deque()
        self.other: PairEnd
        self.holders = 0
        self.closed = False

    def readable(self) -> bool:
        return bool(self.inbox) or self.other.closed

    def send(self, data: bytes) -> int:
        if self.other.closed:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")
        if len(self.other.inbox) >= PACKETS:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        self.other.inbox.append(bytes(data))
        self.other.changed()
        return len(data)

    def recv(self) -> bytes:
        if self.inbox:
            return self.inbox.popleft()
        if self.other.closed:
            return b""
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    def drop(self) -> None:
        self.holders -= 1
        if self.holders == 0:
            self.closed = True
            self.other.changed()


class Sockets(Shell):
    """Socket pairs between processes; raw CAN sockets by `tests.dst.bus`."""

    def __init__(self, world: World, can_socket: type | None = None) -> None:
        super().__init__(world, socket)
        self._can = can_socket
        self.socket: Any = _Sock(world, can_socket)

    def socketpair(self, *_: object) -> tuple[Holder, Holder]:
        """Two connected ends."""
        a, b = PairEnd(self._world), PairEnd(self._world)
        a.other, b.other = b, a
        return Holder(self._world, a), Holder(self._world, b)


class _Sock:
    """`socket.socket`, called."""

    def __init__(self, world: World, can_socket: Any) -> None:
        self._world, self._can = world, can_socket

    def __call__(self, family: int = -1, *_: object, fileno: int | None = None) -> Any:
        if fileno is not None:
            return Holder(self._world, self._world.ends[fileno])
        if family == socket.AF_CAN:
            return self._can(self._world)
        raise OSError(errno.EAFNOSUPPORT, f"no socket of family {family} here")
