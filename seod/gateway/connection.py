"""One TCP client: its bytes, its requests, and what it may cost."""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Awaitable, Coroutine
from typing import TYPE_CHECKING, Any, Protocol, cast

from seod.protocol.jsonrpc import (
    TOO_MANY_CLIENTS,
    Call,
    LineSplitter,
    LineTooLongError,
    Refusal,
    Request,
    RpcError,
    error_text,
    parse,
    result_text,
    too_long,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.gateway.hub import Hub, Sink
    from seod.gateway.service import Result, Service
    from seod.gateway.turns import Turns
    from seod.processes.hand_in import Peer

    Outcome = Result | RpcError | Awaitable[Result]

BACKLOG_BYTES = 256 * 1024
"""A client that leaves more than this unread loses messages until it has read most of it."""
SEND_BUFFER_BYTES = 128 * 1024
"""The kernel's share: small, so that a client that falls behind soon gets what is new."""
READ_BYTES = 16 * 1024
"""Read of one client before others get their turn."""
AHEAD_BYTES = 128 * 1024
"""Read ahead of the requests in work; no more is read before. An e-stop among it is seen at once."""
UNDER_WAY = {"command": 4, "read": 4}
"""Requests of one client in work, for each right; its others wait their turn."""
SORTED = 16
"""Requests of one client that are parsed and wait, for each right."""
ESTOP_BYTES = 1024
"""Longest line that is looked at before its turn."""
ESTOP_LOOKS = 8
"""Lines with an e-stop's name that are looked at before their turn, in one read."""
WRONG_TOKENS = 5

_chunk = memoryview(bytearray(READ_BYTES))
"""What is read goes on from here before anybody else reads."""


class Host(Protocol):
    """What a connection needs of the server that took it."""

    hub: Hub
    service: Service
    turns: Turns

    def admit(self, connection: Connection) -> RpcError | None:
        """Take it in; why not, where it may not come in."""

    def forget(self, connection: Connection) -> None:
        """It is closed."""


class Connection(asyncio.BufferedProtocol):
    """One client. `congested` while it leaves too much unread: then no more of its requests are begun.

    Args:
        server: Took it.
        peer: Where it comes from, if the socket does not tell.
    """

    def __init__(self, server: Host, peer: Peer | None = None) -> None:
        self._server = server
        self._peer = peer
        self._turns = server.turns
        self.session = server.service.session(self)
        self._splitter = LineSplitter()
        self._overtaken = 0
        """Bytes that came before the last e-stop."""
        self._waiting: dict[str, deque[Call]] = {"command": deque(), "read": deque()}
        self._under_way = dict.fromkeys(UNDER_WAY, 0)
        self._tasks: dict[asyncio.Task[None], None] = {}  # in the order in which they began
        self._out: list[bytes] = []
        self._out_bytes = 0
        self._paused = False
        self._ending = False
        self._transport: asyncio.Transport
        self.deadline: asyncio.Handle | None = None
        self.closed = asyncio.Event()

    # ---- asyncio's calls

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Welcome."""
        self._transport = transport = cast("asyncio.Transport", transport)
        transport.set_write_buffer_limits(high=BACKLOG_BYTES, low=BACKLOG_BYTES // 4)
        tcp = transport.get_extra_info("socket")
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        refused = self._server.admit(self)
        if refused is not None:
            self.write(error_text(None, refused).encode() + b"\n")
            self.close()

    def get_buffer(self, _: int) -> memoryview:
        """Where bytes are read to."""
        return _chunk

    def buffer_updated(self, count: int) -> None:
        """Bytes have come: an e-stop among them is carried out at once, all else in its turn."""
        self._splitter.feed(_chunk[:count])
        if self.session.may_command:
            self._look_for_estops()
        if len(self._splitter) >= AHEAD_BYTES:
            self._transport.pause_reading()
        self._turns.lines.add(self.sort_line)

    def pause_writing(self) -> None:
        """The client does not keep up."""
        self._paused = True

    def resume_writing(self) -> None:
        """It does again: tell it what it missed, and go on with its requests."""
        self._paused = False
        self._server.hub.report(self)
        self._go_on()

    def connection_lost(self, _: Exception | None) -> None:
        """The client is gone."""
        if self.deadline is not None:
            self.deadline.cancel()
        for task in self._tasks:
            task.cancel()
        for rotation, work in self._work():
            rotation.discard(work)
        self._server.forget(self)
        self.closed.set()

    # ---- ours

    @property
    def name(self) -> str:
        """The client's address."""
        host, port = self._address
        return f"{host}:{port}"

    @property
    def host(self) -> str:
        """The address of its computer."""
        return self._address[0]

    @property
    def _address(self) -> Peer:
        if self._peer is not None:  # the panel's
            return self._peer
        host, port = self._transport.get_extra_info("peername")[:2]
        return str(host), int(port)

    @property
    def congested(self) -> bool:
        """Whether it leaves too much unread."""
        return self._paused or self._out_bytes > BACKLOG_BYTES

    def write(self, data: bytes) -> None:
        """Send in its turn, unless the client is gone."""
        if not self._transport.is_closing():
            self._out.append(data)
            self._out_bytes += len(data)
            self._turns.sending.add(self.send)

    def send(self) -> bool:
        """Give the kernel what waits."""
        if self._out:
            self._transport.write(b"".join(self._out))
            self._out.clear()
            self._out_bytes = 0
        if self._ending:
            self._transport.close()
        return False

    def close(self) -> None:
        """Send what is left, then close."""
        self._ending = True
        self.send()

    def abort(self) -> None:
        """Close at once."""
        self._transport.abort()

    def overtake(self, by: Sink) -> None:
        """An e-stop came: what was asked before, and has not begun, is not carried out."""
        self._overtaken = 0 if by is self else len(self._splitter)
        waiting = self._waiting["command"]
        for call in [*waiting]:
            self._refuse(call, self._server.service.overtaken(call))
        waiting.clear()

    def sort_line(self) -> bool:
        """Parse one line and put it where its like waits; True if there may be more."""
        if self.congested or self._ending or any(len(each) >= SORTED for each in self._waiting.values()):
            return False
        overtaken = self._overtaken > 0
        before = len(self._splitter)
        try:
            line = self._splitter.next_line()
        except LineTooLongError:
            line, call = b"", Call((too_long(),))
        else:
            if line is None:
                self._transport.resume_reading()
                return False
            call = parse(line)
        self._overtaken = max(0, self._overtaken - before + len(self._splitter))
        self._sort(call, overtaken)
        return True

    def begin_command(self) -> bool:
        """Begin the next command, if not too many are under way."""
        return self._begin_next("command")

    def begin_query(self) -> bool:
        """Begin the next query, if not too many are under way and the answers are read."""
        return not self.congested and self._begin_next("read")

    def _work(self) -> list[tuple[Any, Callable[[], bool]]]:
        turns = self._turns
        return [
            (turns.lines, self.sort_line),
            (turns.commands, self.begin_command),
            (turns.queries, self.begin_query),
            (turns.sending, self.send),
        ]

    def _go_on(self) -> None:
        """Something that held its requests up does so no longer."""
        if not self._transport.is_closing():
            for rotation, work in self._work()[:3]:
                rotation.add(work)

    def _look_for_estops(self) -> None:
        for _ in range(ESTOP_LOOKS):
            found = self._splitter.look(b"estop")
            if found is None:
                return
            start, end = found
            call = parse(self._splitter.peek(start, end)) if end - start <= ESTOP_BYTES else Call(())
            request = call.requests[0] if len(call.requests) == 1 and not call.batch else None
            if isinstance(request, Request) and request.method == "estop":
                self._splitter.remove(start, end)
                self._begin(call, "command")
                self._overtaken = start

    def _sort(self, call: Call, overtaken: bool) -> None:
        service = self._server.service
        right = service.right_of(call)
        if right == "command" and overtaken:
            self._refuse(call, service.overtaken(call))
        elif right == "none":
            for request in call.requests:
                self._reply(reply_to(request, self._outcome(request)))
        else:
            self._waiting[right].append(call)
            rotation, work = self._work()[1 if right == "command" else 2]
            rotation.add(work)

    def _refuse(self, call: Call, refusals: list[Refusal]) -> None:
        replies = [reply for each in refusals if (reply := reply_to(each, each.error))]
        if replies:
            self._reply(in_one(replies) if call.batch else replies[0])

    def _begin_next(self, right: str) -> bool:
        waiting = self._waiting[right]
        if not waiting or self._under_way[right] >= UNDER_WAY[right]:
            return False
        self._begin(waiting.popleft(), right)
        if len(waiting) == SORTED - 1:
            self._turns.lines.add(self.sort_line)
        return bool(waiting)

    def _begin(self, call: Call, right: str) -> None:
        """Carry out a call; one that takes no time is answered now, but for a batch."""
        if call.batch:
            self._spawn(self._answer_batch(call), right)
            return
        request = call.requests[0]
        outcome = self._outcome(request)
        if isinstance(outcome, Awaitable):
            under_way = asyncio.ensure_future(outcome)
            task = self._spawn(self._answer_later(request, under_way), right)
            task.add_done_callback(lambda _: forget(under_way))
        else:
            self._reply(reply_to(request, outcome))

    def _spawn(self, work: Coroutine[Any, Any, None], right: str) -> asyncio.Task[None]:
        self._under_way[right] += 1
        task = asyncio.get_running_loop().create_task(work)
        self._tasks[task] = None
        task.add_done_callback(lambda task: self._done(task, right))
        return task

    async def _answer_later(self, request: Request | Refusal, outcome: Outcome) -> None:
        self._reply(reply_to(request, await settle(outcome)))

    async def _answer_batch(self, call: Call) -> None:
        replies = [reply_to(request, await settle(self._outcome(request))) for request in call.requests]
        answered = [reply for reply in replies if reply is not None]
        if answered:
            self._reply(in_one(answered))

    def _outcome(self, request: Request | Refusal) -> Outcome:
        if isinstance(request, Refusal):
            return request.error
        try:
            return self._server.service.call(self.session, request)
        except RpcError as error:
            self._ending |= error.code == TOO_MANY_CLIENTS
            return error

    def _reply(self, reply: str | None) -> None:
        if reply is not None:
            self.write(reply.encode("ascii") + b"\n")
        if self.session.wrong_tokens >= WRONG_TOKENS or self._ending:
            self.close()

    def _done(self, task: asyncio.Task[None], right: str) -> None:
        self._tasks.pop(task, None)
        self._under_way[right] -= 1
        self._go_on()


async def settle(outcome: Outcome) -> Outcome:
    """Wait for an outcome that takes time."""
    if not isinstance(outcome, Awaitable):
        return outcome
    try:
        return await outcome
    except RpcError as error:
        return error


def forget(under_way: asyncio.Future[Any]) -> None:
    """Nobody waits for an outcome any more: where its client left at once, its error is not told."""
    if under_way.done() and not under_way.cancelled():
        under_way.exception()
    under_way.cancel()


def reply_to(request: Request | Refusal, outcome: Outcome) -> str | None:
    """The reply; None for a notification."""
    if isinstance(request, Request) and not request.answered:
        return None
    if isinstance(outcome, RpcError):
        return error_text(request.id, outcome)
    return result_text(request.id, outcome)


def in_one(replies: list[str]) -> str:
    """The reply to a batch."""
    return f"[{','.join(replies)}]"
