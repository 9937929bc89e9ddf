"""One open page: its WebSocket, its own connection to the gateway, its view of the rows.

The page sends `{"id", "method", "params"}` as text; it gets answers `{"id", "result"}` or `{"id", "error"}`,
notifications `{"method", "params"}`, and binary blocks (`seod.panel.wire`). An e-stop goes on as it is read.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

from starlette.websockets import WebSocketDisconnect

from seod.gateway.params import Params, read_params
from seod.panel.disk import disk_of
from seod.panel.view import HistoryParams, View, ViewParams
from seod.processes.uplink import Uplink
from seod.protocol.jsonrpc import (
    INVALID_PARAMS,
    NO_ANSWER,
    UNAUTHORISED,
    RpcError,
    hint,
    json_text,
    unknown_method,
)

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from starlette.websockets import WebSocket

    from seod.panel.panel import Panel
    from seod.panel.sessions import Session

FRAME_S: Final = 1.0 / 60.0
STATUS_S: Final = 0.2
AGAIN_S: Final = 0.25
"""Between two attempts to reach the gateway."""
REACH_S: Final = 3.0
"""A question waits this long for the gateway to be reached."""
QUEUED: Final = 400
"""Messages that wait for a page; notifications beyond are dropped, answers are not."""
UNDER_WAY: Final = 16
"""Requests of one page in work."""
PASSED_ON: Final = frozenset(
    {
        "info", "list", "status", "get", "set", "start", "stop", "reset", "drive", "keepalive", "record",
    }
)  # fmt: skip
"""Methods of the gateway."""


class TrendsParams(Params):
    """Estimates of an axis; `since` [s] leaves out what the page has."""

    axis: str
    since: float | None = None


class PageSocket:
    """Serves one page until it goes.

    Args:
        panel: The panel.
        socket: The page's WebSocket, accepted.
        session: Who it is.
    """

    def __init__(self, panel: Panel, socket: WebSocket, session: Session) -> None:
        self._panel, self._socket, self._session = panel, socket, session
        client = socket.client
        self._peer = ("?", 0) if client is None else (client.host, client.port)
        self._uplink: Uplink | None = None
        self._gone, self._reached = asyncio.Event(), asyncio.Event()
        self._view = View(panel.histories, panel.period)
        self._out: deque[str | bytes] = deque()
        self._soon = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._own: dict[str, Callable[[dict[str, Any]], Any]] = {
            "view": self._show,
            "history": self._history,
            "trends": self._trends,
            "take": lambda _: self._take(),
            "release": lambda _: self._release(),
            "events": lambda _: {"events": list(panel.house.events)},
        }

    @property
    def name(self) -> str:
        """What others know it by."""
        return f"the page at {self._peer[0]}:{self._peer[1]}"

    @property
    def session(self) -> Session:
        """Who it is."""
        return self._session

    async def serve(self) -> None:
        """Until the page goes."""
        self._panel.pages.add(self)
        work = [self._receive(), self._send(), self._tell_status(), self._keep_uplink()]
        tasks = [asyncio.create_task(each) for each in work]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._panel.pages.discard(self)
            self._panel.commander.release(self)
            for task in (*tasks, *self._tasks):
                task.cancel()
            await asyncio.gather(*tasks, *self._tasks, return_exceptions=True)
            if self._uplink is not None:
                await self._uplink.close()

    def tell(self, text: str) -> None:
        """Queue a notification; one that it would have to wait long for is dropped."""
        if len(self._out) < QUEUED:
            self._queue(text)

    def _queue(self, data: str | bytes) -> None:
        self._out.append(data)
        self._soon.set()

    # ---- what the page asks

    async def _receive(self) -> None:
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                self._heard(await self._socket.receive_text())

    def _heard(self, text: str) -> None:
        try:
            message = json.loads(text)
            number, method, params = message["id"], message["method"], message.get("params", {})
        except (ValueError, KeyError, TypeError):
            self._queue(json_text({"id": None, "error": "not a request"}))
            return
        if method == "estop":
            self._estop(number)
        elif len(self._tasks) < UNDER_WAY:
            self._spawn(self._answer(number, lambda: self._carry_out(str(method), params)))
        else:
            self._fail(number, "too many requests of this page are in work")

    def _estop(self, number: object) -> None:
        """To the gateway at once; only the answer is waited for."""
        try:
            future = self._need_uplink().put("estop", {})
        except RpcError as error:
            self._fail(number, error.message)
            return
        self._spawn(self._answer(number, lambda: future))

    def _spawn(self, work: Any) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, number: object, make: Callable[[], Awaitable[Any]]) -> None:
        try:
            result = await make()
        except RpcError as error:
            self._fail(number, error.message)
        else:
            self._queue(json_text({"id": number, "result": result}))

    def _fail(self, number: object, why: str) -> None:
        self._queue(json_text({"id": number, "error": why}))

    async def _carry_out(self, method: str, params: Any) -> Any:
        if not isinstance(params, dict):
            raise RpcError(INVALID_PARAMS, "params: must be an object")
        if method in self._own:
            return self._own[method](params)
        if method not in PASSED_ON:
            raise unknown_method(method, {*PASSED_ON, *self._own, "estop"})
        await self._wait_for_uplink()
        if self._session.command:
            self._panel.commander.check(self, method)
        return await self._need_uplink().call(method, params)

    async def _wait_for_uplink(self) -> None:
        """A moment, for a page that has just been opened."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(REACH_S):
                await self._reached.wait()

    def _need_uplink(self) -> Uplink:
        if self._uplink is None:
            raise RpcError(NO_ANSWER, "the gateway is not there at present")
        return self._uplink

    def _known(self, axis: str) -> str:
        if axis not in self._panel.histories:
            raise RpcError(
                INVALID_PARAMS, f"axis: no axis {axis[:40]!r}{hint(axis[:40], self._panel.histories)}"
            )
        return axis

    def _show(self, params: dict[str, Any]) -> dict[str, Any]:
        wanted = read_params(ViewParams, params)
        for axis in wanted.axes:
            self._known(axis)
        number = self._view.show(wanted)
        self._soon.set()
        return {"number": number, "step": self._view.step}

    def _history(self, params: dict[str, Any]) -> dict[str, Any]:
        wanted = read_params(HistoryParams, params)
        self._known(wanted.axis)
        self._queue(self._view.answer(wanted))
        return {"ok": True}

    def _trends(self, params: dict[str, Any]) -> dict[str, Any]:
        wanted = read_params(TrendsParams, params)
        return self._panel.house.trends[self._known(wanted.axis)].columns(wanted.since)

    def _take(self) -> dict[str, Any]:
        if not self._session.command:
            raise RpcError(UNAUTHORISED, "commanding needs the rig file's command_token: log in with it")
        self._panel.commander.take(self)
        return self._panel.commander.seen_by(self)

    def _release(self) -> dict[str, Any]:
        self._panel.commander.release(self)
        return self._panel.commander.seen_by(self)

    # ---- what the page gets

    async def _send(self) -> None:
        """All that waits, then the next frame; a page that reads slowly gets fewer frames, each with more."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # starlette's, once it has gone
            due = 0.0
            while True:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(max(0.0, due - time.monotonic())):
                        await self._soon.wait()
                self._soon.clear()
                while self._out:
                    await self._send_one(self._out.popleft())
                now = time.monotonic()
                if now >= due:
                    due = max(due + FRAME_S, now)
                    if frame := self._view.message():
                        await self._socket.send_bytes(frame)

    async def _send_one(self, data: str | bytes) -> None:
        if isinstance(data, str):
            await self._socket.send_text(data)
        else:
            await self._socket.send_bytes(data)

    async def _tell_status(self) -> None:
        while True:
            status = {**self._panel.status(), "commander": self._panel.commander.seen_by(self)}
            disk = disk_of(self._panel)
            status |= {"reaches_gateway": self._uplink is not None, "disk_free": disk and disk.free}
            self.tell(json_text({"method": "panel", "params": status}))
            await asyncio.sleep(STATUS_S)

    async def _keep_uplink(self) -> None:
        """Reach the gateway, and the next one once it is gone."""
        while True:
            self._gone.clear()
            uplink = Uplink(self._panel.way, self._peer, lambda *_: None, self._gone.set)
            try:
                await uplink.open(self._session.token)
                self._uplink = uplink
                self._reached.set()
                await self._gone.wait()
            except RpcError:  # not there yet
                pass
            finally:
                self._reached.clear()
                self._uplink = None
                await uplink.close()
            await asyncio.sleep(AGAIN_S)
