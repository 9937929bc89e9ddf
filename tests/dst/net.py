"""The gateway's event loop on simulated time, and its connections to simulated clients."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import math
from typing import TYPE_CHECKING, Any

from tests.dst.world import INJECTED, Dead

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from tests.dst.world import End, World

NET_S = (2e-5, 3e-4)
"""From one end of a connection to the other [s]."""


class SimLoop(asyncio.BaseEventLoop):
    """Waits in the world instead of in a selector."""

    def __init__(self, world: World, network: Network) -> None:
        super().__init__()
        self.world, self.network = world, network
        self.process = world.me().process
        self._readers: dict[End, asyncio.Handle] = {}
        self._selector = self
        self.nudge = Nudge(world)

    def time(self) -> float:
        return self.world.now

    def _write_to_self(self) -> None:
        self.nudge.set = True
        self.nudge.changed()

    def select(self, timeout: float | None) -> list[asyncio.Handle]:
        """As a selector: what may be called now."""
        ends = [self.nudge, *self._readers]
        if (timeout is None or timeout > 0) and not any(end.readable() for end in ends):
            self.world.block(math.inf if timeout is None else self.world.now + timeout, ends)
        elif self.process.pending:
            self.world.block(self.world.now)
        self.world.me()
        self.nudge.set = False
        return [handle for end, handle in self._readers.items() if end.readable()]

    def _process_events(self, event_list: list[asyncio.Handle]) -> None:
        for handle in event_list:
            self._add_callback(handle)  # type: ignore[attr-defined]

    def add_reader(self, fd: Any, callback: Callable[..., Any], *args: Any) -> None:
        end = self.world.ends[fd if isinstance(fd, int) else fd.fileno()]
        self._readers[end] = asyncio.Handle(callback, args, self)

    def remove_reader(self, fd: Any) -> bool:
        end = self.world.ends[fd if isinstance(fd, int) else fd.fileno()]
        handle = self._readers.pop(end, None)
        if handle is not None:
            handle.cancel()
        return handle is not None

    def add_signal_handler(self, sig: int, callback: Callable[..., Any], *args: Any) -> None:
        self.process.handlers[sig] = lambda *_: self.call_soon(callback, *args)

    async def create_server(self, protocol_factory: Any, host: Any = None, port: Any = None, **_: Any) -> Any:
        return self.network.listen(self, protocol_factory, port)

    def call_exception_handler(self, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, Dead):
            raise Dead  # asyncio keeps all but the end of a process
        if not self.process.alive:
            return
        if error is None or error.args != (INJECTED,):
            self.world.fail(f"gateway: {context['message']}: {error!r}")


class Nudge:
    """Wakes the event loop up from within."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.set = False
        self.watchers: dict[Any, None] = {}

    def readable(self) -> bool:
        return self.set

    def changed(self) -> None:
        for task in list(self.watchers):
            self.world.wake(task)


def _in_order(loop: SimLoop) -> list[asyncio.Task[Any]]:
    """What is not done yet, as it began: a set of them is in the order of their addresses."""
    return sorted(asyncio.all_tasks(loop), key=lambda task: (len(task.get_name()), task.get_name()))


def _cancel_all(loop: SimLoop) -> None:
    """What is not done yet is cancelled and waited for, as `asyncio.run` does."""
    tasks = _in_order(loop)
    for task in tasks:
        task.cancel()
    if tasks:
        loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))


def runner(world: World, network: Network) -> Callable[[Coroutine[Any, Any, Any]], Any]:
    """`asyncio.run` on simulated loops."""

    def run(main: Coroutine[Any, Any, Any]) -> Any:
        loop = SimLoop(world, network)
        try:
            return loop.run_until_complete(main)
        finally:
            if loop.process.alive:
                _cancel_all(loop)
            for task in _in_order(loop):  # here and now: later their ends would meet another world
                with contextlib.suppress(Dead, RuntimeError):
                    task.get_coro().close()  # type: ignore[union-attr]
            loop.close()

    return run


class AsyncioShell:
    """`asyncio` but for `run`."""

    def __init__(self, world: World, network: Network) -> None:
        self.run = runner(world, network)

    def __getattr__(self, name: str) -> Any:
        value = getattr(asyncio, name)
        setattr(self, name, value)  # asked once: what follows finds it here
        return value


class Listening:
    """The gateway's listening socket."""

    def __init__(self, network: Network, loop: SimLoop, factory: Callable[[], Any], port: int) -> None:
        self.network, self.loop, self.factory, self.port = network, loop, factory, port
        self.open = True
        self.sockets = [self]
        loop.process.held.append(self)

    def fileno(self) -> int:
        return -1

    def getsockname(self) -> tuple[str, int]:
        return "127.0.0.1", self.port

    def close(self) -> None:
        self.open = False
        if self.network.listening is self:
            self.network.listening = None

    give_back = close

    async def wait_closed(self) -> None:
        """At once."""


class Network:
    """Connections of clients to whichever gateway listens."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.listening: Listening | None = None
        self.ports = 40_000
        self.on_bytes: Callable[[bytes], None] = lambda _: None
        """Told what has arrived at the gateway."""

    def listen(self, loop: SimLoop, factory: Callable[[], Any], port: int) -> Listening:
        if self.listening is not None:
            raise OSError(errno.EADDRINUSE, "Address already in use")
        self.listening = Listening(self, loop, factory, port)
        return self.listening

    def connect(self, client: Any) -> Transport | None:
        """A client connects; None if nobody listens."""
        here = self.listening
        if here is None or not here.open:
            return None
        self.ports += 1
        return Transport(self, here.loop, here.factory(), client, self.ports)


class Transport(asyncio.Transport):
    """The gateway's end of a connection; `client` has `receive(data)` and `hung_up()`."""

    def __init__(self, network: Network, loop: SimLoop, protocol: Any, client: Any, port: int) -> None:
        super().__init__({"socket": self, "peername": ("127.0.0.1", port)})
        self.network, self.loop, self.protocol, self.client = network, loop, protocol, client
        self.world = network.world
        self._inbox = bytearray()
        self._reading = True
        self._closing = False
        self._lost = False
        self._unread = 0
        self._high, self._low = 1 << 16, 1 << 14
        self._paused = False
        self._rng = loop.process.rng
        self._left = False
        self._next_out = self._next_in = 0.0
        loop.process.held.append(self)
        self._soon(protocol.connection_made, self)

    def _soon(self, do: Callable[..., Any], *arguments: Any) -> None:
        if self.loop.process.alive and not self.loop.is_closed():
            self.loop.call_soon(do, *arguments)
            self.loop._write_to_self()

    # ---- the client's side

    def feed(self, data: bytes) -> None:
        """Bytes from the client, after their way."""
        self._next_in = max(self._next_in, self.world.now + self._rng.uniform(*NET_S))
        self.world.at(self._next_in, lambda: self._arrive(data))

    def _arrive(self, data: bytes) -> None:
        if self._lost or self._closing:
            return
        self._inbox += data
        self.network.on_bytes(data)
        self._soon(self._read)

    def hang_up(self) -> None:
        """The client is gone."""
        self._left = True
        self._next_in = max(self._next_in, self.world.now + self._rng.uniform(*NET_S))
        self.world.at(self._next_in, lambda: self._soon(self._lose))

    def _deliver(self, data: bytes) -> None:
        """To the client, unless it has hung up: it may have another connection by now."""
        if not self._left:
            self.client.receive(data)

    def took(self, count: int) -> None:
        """The client has read so many bytes."""
        self._unread -= count
        if self._paused and self._unread <= self._low:
            self._paused = False
            self._soon(self.protocol.resume_writing)

    # ---- the gateway's side

    def _read(self) -> None:
        while self._inbox and self._reading and not (self._closing or self._lost):
            buffer = self.protocol.get_buffer(-1)
            count = min(len(buffer), len(self._inbox))
            buffer[:count] = self._inbox[:count]
            del self._inbox[:count]
            self.protocol.buffer_updated(count)

    def _lose(self) -> None:
        if not self._lost:
            self._lost = self._closing = True
            if self in self.loop.process.held:
                self.loop.process.held.remove(self)
            self.protocol.connection_lost(None)

    def setsockopt(self, *_: object) -> None:
        """Buffers are as they are."""

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        self._high, self._low = high or 0, low or 0

    def pause_reading(self) -> None:
        self._reading = False

    def resume_reading(self) -> None:
        if not self._reading:
            self._reading = True
            self._soon(self._read)

    def is_closing(self) -> bool:
        return self._closing

    def write(self, data: Any) -> None:
        self.world.touch("answer")
        if self._lost:
            return
        self._unread += len(data)
        sent = bytes(data)
        self._next_out = max(self._next_out, self.world.now + self._rng.uniform(*NET_S))
        self.world.at(self._next_out, lambda: self._deliver(sent))
        if self._unread > self._high and not self._paused:
            self._paused = True
            self.protocol.pause_writing()

    def close(self) -> None:
        if not self._closing:
            self._closing = True
            self._soon(self._lose)
            self.world.at(self._next_out, self.client.hung_up)

    def abort(self) -> None:
        self.close()

    def give_back(self) -> None:
        """The gateway has died."""
        self._lost = self._closing = True
        self.world.at(max(self._next_out, self.world.now), self.client.hung_up)
