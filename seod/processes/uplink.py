"""A connection to the gateway for a client of panel or fleet: JSON-RPC by line, as for any other."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
from typing import TYPE_CHECKING, Any

from seod.processes.hand_in import hand_in
from seod.protocol.jsonrpc import NO_ANSWER, RpcError, json_text

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable

    from seod.processes.hand_in import Peer

ANSWER_S = 25.0
"""Longer than the gateway waits for anything itself."""
LINE_BYTES = 4 << 20
GONE = "the gateway is gone; the supervisor starts it again"


class Uplink:
    """One client's way to the gateway.

    Args:
        way: Where clients are handed in.
        peer: Whom it is for.
        hear: Takes notifications: topic and parameters.
        ended: Called once the gateway has closed it.
    """

    def __init__(
        self,
        way: socket.socket,
        peer: Peer,
        hear: Callable[[str, dict[str, Any]], None],
        ended: Callable[[], None] = lambda: None,
    ) -> None:
        self._way, self._peer = way, peer
        self._hear, self._ended = hear, ended
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[Any]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None

    @property
    def is_open(self) -> bool:
        """Whether the gateway has not closed it."""
        return self._writer is not None

    async def open(self, token: str | None) -> dict[str, bool]:
        """Connect, and authenticate with a token if there is one; returns the rights `read` and `command`.

        Raises:
            RpcError: The gateway is gone, or does not know the token.
        """
        try:
            end = hand_in(self._way, self._peer)
        except OSError:
            raise RpcError(NO_ANSWER, GONE) from None
        reader, self._writer = await asyncio.open_connection(sock=end, limit=LINE_BYTES)
        self._reading = asyncio.create_task(self._read(reader))
        rights: dict[str, bool] = await self.call("authenticate", {"token": token or ""})
        return rights

    async def call(self, method: str, params: dict[str, Any] | None = None) -> Any:
        """Ask, and wait for the answer.

        Raises:
            RpcError: What the gateway says, or that it is gone.
        """
        return await self.put(method, params or {})

    def put(self, method: str, params: dict[str, Any]) -> asyncio.Future[Any]:
        """Ask now, before anything else is done; what is returned gets the answer.

        Raises:
            RpcError: The gateway is gone.
        """
        if self._writer is None:
            raise RpcError(NO_ANSWER, GONE)
        number = next(self._numbers)
        future = self._waiting[number] = asyncio.get_running_loop().create_future()
        text = json_text({"jsonrpc": "2.0", "id": number, "method": method, "params": params})
        self._writer.write(text.encode("ascii") + b"\n")
        alarm = asyncio.get_running_loop().call_later(ANSWER_S, self._give_up, number, method)
        future.add_done_callback(lambda _: alarm.cancel())
        return future

    def _give_up(self, number: int, method: str) -> None:
        future = self._waiting.pop(number, None)
        if future is not None and not future.done():
            future.set_exception(RpcError(NO_ANSWER, f"{method!r} was not answered within {ANSWER_S:g} s"))

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while line := await reader.readline():
                self._take(json.loads(line))
        except (OSError, ValueError):  # gone in the middle of a line
            pass
        finally:
            self._close()
            self._ended()

    def _take(self, message: dict[str, Any]) -> None:
        if "method" in message:
            self._hear(message["method"], message["params"])
            return
        future = self._waiting.pop(message.get("id") or 0, None)
        if future is None or future.done():
            return
        if "error" in message:
            future.set_exception(RpcError(message["error"]["code"], message["error"]["message"]))
        else:
            future.set_result(message["result"])

    def _close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(RpcError(NO_ANSWER, GONE))
                future.exception()  # whoever waits gets it; who has left does not need it
        self._waiting.clear()

    async def close(self) -> None:
        """Let the gateway go."""
        if self._reading is not None:
            self._reading.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._reading
        self._close()
