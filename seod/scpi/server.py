"""SCPI over TCP, a line a message, as instruments have it on raw sockets; a thin shell."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import TYPE_CHECKING, Final

from seod.scpi.parser import MAX_LINE

if TYPE_CHECKING:
    import socket
    import ssl
    from collections.abc import Awaitable, Callable

    from seod.processes.hand_in import Peer
    from seod.scpi.device import Device

CLIENTS: Final = 16
"""At a time."""
WAITING: Final = 256
"""Lines of a client that wait; then no more is read."""


class ScpiServer:
    """Serves clients.

    Args:
        make: Makes a client's device; returns it with what ends it.
    """

    def __init__(
        self, make: Callable[[Peer], Awaitable[tuple[Device, Callable[[], Awaitable[None]]]]]
    ) -> None:
        self._make = make
        self._clients: set[asyncio.Task[None]] = set()

    async def serve(self, opened: socket.socket, context: ssl.SSLContext | None) -> None:
        """Until cancelled."""
        server = await asyncio.start_server(self._welcome, sock=opened, ssl=context, limit=2 * MAX_LINE)
        try:
            await server.serve_forever()
        finally:
            for client in self._clients:
                client.cancel()
            await asyncio.gather(*self._clients, return_exceptions=True)

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if len(self._clients) >= CLIENTS or task is None:
            writer.close()
            return
        self._clients.add(task)
        host, port = writer.get_extra_info("peername")[:2]
        device, end = await self._make((str(host), int(port)))
        try:
            await Client(device, reader, writer).serve()
        except OSError:  # gone
            pass
        finally:
            self._clients.discard(task)
            writer.close()
            await end()


class Client:
    """One connection: lines are carried out in their order, an e-stop as it is read."""

    def __init__(self, device: Device, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._device, self._reader, self._writer = device, reader, writer
        self._lines: deque[bytes] = deque()
        self._more, self._room = asyncio.Event(), asyncio.Event()

    async def serve(self) -> None:
        """Until the client goes."""
        working = asyncio.create_task(self._work())
        try:
            while (line := await self._next_line()) is not None:
                if self._device.is_estop(line):
                    for _ in self._lines:
                        self._device.overtaken()
                    self._lines.clear()
                    await self._tell(line)
                    continue
                self._lines.append(line)
                self._more.set()
                while len(self._lines) > WAITING:
                    self._room.clear()
                    await self._room.wait()
            self._lines.append(b"")
            self._more.set()
        finally:
            working.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await working

    async def _next_line(self) -> bytes | None:
        """None at the end; what is longer than a line may be is cut, and told to be too long."""
        try:
            line = await self._reader.readline()
        except ValueError:  # asyncio's, of a line beyond its limit, which it has dropped
            return b"x" * (MAX_LINE + 1)
        return line if line.endswith(b"\n") else None

    async def _work(self) -> None:
        while True:
            while not self._lines:
                self._more.clear()
                await self._more.wait()
            await self._tell(self._lines.popleft())
            self._room.set()

    async def _tell(self, line: bytes) -> None:
        answer = await self._device.answer(line)
        if answer:
            self._writer.write(answer.encode("ascii", "replace") + b"\n")
            await self._writer.drain()
