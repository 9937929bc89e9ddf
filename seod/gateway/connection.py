"""One TCP client: its bytes, its requests, and what it may cost."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable
from typing import TYPE_CHECKING, Any, cast

from seod.protocol import (
    Call,
    LineSplitter,
    LineTooLongError,
    Refusal,
    Request,
    RpcError,
    encode,
    error_message,
    parse,
    result_message,
    too_long,
)

if TYPE_CHECKING:
    from seod.gateway.server import Server
    from seod.gateway.service import Result

    Outcome = Result | RpcError | Awaitable[Result]

BACKLOG_BYTES = 256 * 1024
"""A client that leaves more than this unread loses messages until it has read most of it."""
SEND_BUFFER_BYTES = 128 * 1024
"""The kernel's share: small, so that a client that falls behind soon gets what is new."""
LINES_A_TURN = 32
"""Requests of one client that are handled before others get their turn."""
REQUESTS_UNDER_WAY = 64
AUTHENTICATE_S = 10.0
WRONG_TOKENS = 5


class Connection(asyncio.Protocol):
    """One client. `congested` while it leaves too much unread: then nothing but replies is written."""

    def __init__(self, server: Server) -> None:
        self.congested = False
        self._server = server
        self._session = server.service.session(self)
        self._splitter = LineSplitter()
        self._tasks: set[asyncio.Task[None]] = set()
        self._pump_handle: asyncio.Handle | None = None
        self._deadline: asyncio.Handle | None = None
        self._transport: asyncio.Transport
        self.closed = asyncio.Event()

    # ---- asyncio's calls

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Welcome, or refuse where there are too many."""
        self._transport = transport = cast("asyncio.Transport", transport)
        transport.set_write_buffer_limits(high=BACKLOG_BYTES, low=BACKLOG_BYTES // 4)
        tcp = transport.get_extra_info("socket")
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        refused = self._server.admit(self)
        if refused is None:
            loop = asyncio.get_running_loop()
            self._deadline = loop.call_later(AUTHENTICATE_S, self._check_authenticated)
        else:
            self.write(encode(error_message(None, refused)))
            transport.close()

    def data_received(self, data: bytes) -> None:
        """Requests, or parts of them."""
        self._splitter.feed(data)
        self._pump()

    def pause_writing(self) -> None:
        """The client does not keep up."""
        self.congested = True

    def resume_writing(self) -> None:
        """It does again: tell it what it missed, and go on with its requests."""
        self.congested = False
        self._server.hub.report(self)
        self._pump_soon()

    def connection_lost(self, _: Exception | None) -> None:
        """The client is gone."""
        for handle in (self._pump_handle, self._deadline):
            if handle is not None:
                handle.cancel()
        for task in self._tasks:
            task.cancel()
        self._server.forget(self)
        self.closed.set()

    # ---- ours

    @property
    def name(self) -> str:
        """The client's address."""
        host, port = self._transport.get_extra_info("peername")[:2]
        return f"{host}:{port}"

    def write(self, data: bytes) -> None:
        """Send, unless the client is gone."""
        if not self._transport.is_closing():
            self._transport.write(data)

    def close(self) -> None:
        """Send what is left, then close."""
        self._transport.close()

    def abort(self) -> None:
        """Close at once."""
        self._transport.abort()

    def _check_authenticated(self) -> None:
        if not (self._session.may_read or self._session.may_command):
            self._transport.close()

    def _pump_soon(self) -> None:
        if self._pump_handle is None and not self._transport.is_closing():
            self._pump_handle = asyncio.get_running_loop().call_soon(self._pump)

    def _pump(self) -> None:
        """Handle a few lines; read no more from a client that has many under way."""
        self._pump_handle = None
        for _ in range(LINES_A_TURN):
            if self.congested or len(self._tasks) >= REQUESTS_UNDER_WAY or self._transport.is_closing():
                self._transport.pause_reading()
                return
            try:
                line = self._splitter.next_line()
            except LineTooLongError:
                self._answer(Call((too_long(),)))
                continue
            if line is None:
                self._transport.resume_reading()
                return
            self._answer(parse(line))
        self._transport.pause_reading()
        self._pump_soon()

    def _answer(self, call: Call) -> None:
        if call.batch or any(map(self._server.service.takes_time, call.requests)):
            self._spawn(self._finish(call))
            return
        for request in call.requests:
            self._reply(reply_to(request, self._begin(request)))

    async def _finish(self, call: Call) -> None:
        replies = []
        for request in call.requests:
            outcome = self._begin(request)
            replies.append(reply_to(request, await settle(outcome)))
        answered = [reply for reply in replies if reply is not None]
        if answered:
            self._reply(answered if call.batch else answered[0])

    def _begin(self, request: Request | Refusal) -> Outcome:
        if isinstance(request, Refusal):
            return request.error
        try:
            return self._server.service.call(self._session, request)
        except RpcError as error:
            return error

    def _reply(self, reply: Any) -> None:
        if reply is not None:
            self.write(encode(reply))
        if self._session.wrong_tokens >= WRONG_TOKENS:
            self._transport.close()

    def _spawn(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._pump_soon()


async def settle(outcome: Outcome) -> Outcome:
    """Wait for an outcome that takes time."""
    if not isinstance(outcome, Awaitable):
        return outcome
    try:
        return await outcome
    except RpcError as error:
        return error


def reply_to(request: Request | Refusal, outcome: Outcome) -> dict[str, Any] | None:
    """The reply; None for a notification."""
    if isinstance(request, Request) and not request.answered:
        return None
    if isinstance(outcome, RpcError):
        return error_message(request.id, outcome)
    return result_message(request.id, outcome)
