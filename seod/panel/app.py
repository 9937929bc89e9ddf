"""The panel over HTTP: its page, the login, the WebSocket."""

from __future__ import annotations

import hashlib
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qs

from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder
from starlette.applications import Starlette
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute

from seod.panel.files import Files
from seod.panel.foxglove import FoxgloveSocket, choose_protocol
from seod.panel.metrics import RigCollector
from seod.panel.page_socket import PageSocket
from seod.panel.sessions import LIFE_S, Session, is_ours, is_same_origin
from seod.processes.uplink import Uplink
from seod.protocol.jsonrpc import RpcError

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from starlette.requests import HTTPConnection, Request
    from starlette.types import ASGIApp, Message, Receive, Scope, Send
    from starlette.websockets import WebSocket

    from seod.panel.panel import Panel

    Handler = Callable[[Request], Awaitable[Response]]

PROTOCOL: Final = "seod.panel.1"
"""Sub-protocol of the page's WebSocket; the second one offered is `csrf.` and its session's word."""
CSRF_HEADER: Final = "x-seod-csrf"
POLICY: Final = "; ".join(
    [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "manifest-src 'self'",
        "form-action 'self'",
        "frame-ancestors 'none'",
        "base-uri 'none'",
    ]
)
HEADERS: Final = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",  # with no-referrer a form says that it comes from nowhere
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "x-frame-options": "DENY",
    "cache-control": "no-store",
}
TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
FORM_BYTES: Final = 4096


class Guarded:
    """Puts our headers on each answer, and turns away who came by a name that is not ours.

    Args:
        app: What is guarded.
        listens_on: Address of the server.
    """

    def __init__(self, app: ASGIApp, listens_on: str) -> None:
        self._app, self._listens_on = app, listens_on

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        host = dict(scope.get("headers", [])).get(b"host", b"").decode("latin-1")
        if not is_ours(host, self._listens_on):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008})
            else:
                refusal = PlainTextResponse("this name is not the panel's", 421, headers=HEADERS)
                await refusal(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name for name, _ in message["headers"]}
                ours = [(k.encode(), v.encode()) for k, v in HEADERS.items() if k.encode() not in given]
                message["headers"] = [*message["headers"], *ours]
            await send(message)

        await self._app(scope, receive, with_headers)


class Pages:
    """Answers requests.

    Args:
        panel: What the clients share.
        scheme: http or https.
    """

    def __init__(self, panel: Panel, scheme: str) -> None:
        self._panel, self._scheme = panel, scheme
        server = panel.config.server
        self._needs_token = server.read_token is not None or server.command_token is not None
        self._registry = CollectorRegistry()
        self._registry.register(RigCollector(panel))
        self._bearers: set[bytes] = set()
        """Digests of tokens that may read, as the gateway has said."""
        self._files = {
            each.name: each.read_bytes()
            for each in (files("seod.panel") / "page").iterdir()
            if each.is_file() and "." + each.name.rpartition(".")[2] in TYPES
        }

    def session(self, request: HTTPConnection) -> Session | None:
        """Who asks, if that is known and may read."""
        found = self._panel.sessions.find(request.cookies)
        return found if found is not None and found.read else None

    def of_our_page(self, request: Request, session: Session) -> bool:
        """Whether a request that changes something comes from our own page in that session."""
        ours = is_same_origin(request.headers, self._scheme)
        return ours and session.owns(request.headers.get(CSRF_HEADER, ""))

    async def page(self, request: Request) -> Response:
        """The page, or where to log in."""
        if self.session(request) is not None:
            return self._file("index.html")
        if self._needs_token:
            return RedirectResponse("/login", 303)
        answer = self._file("index.html")
        self._begin(answer, Session(None, read=True, command=True))
        return answer

    async def login_page(self, _: Request) -> Response:
        """Where the token is asked for."""
        return self._file("login.html")

    async def login(self, request: Request) -> Response:
        """Take a token; it goes to the gateway, which says what it allows."""
        host = "?" if request.client is None else request.client.host
        if not is_same_origin(request.headers, self._scheme):
            return PlainTextResponse("only the panel's own page may log in", 403)
        if self._panel.sessions.must_wait(host):
            return PlainTextResponse("too many wrong tokens: wait a minute", 429)
        token = parse_qs(await body_of(request, FORM_BYTES)).get("token", [""])[0].strip()
        rights = await self._rights(token, host)
        if not rights["read"]:
            self._panel.sessions.was_wrong(host)
            return RedirectResponse("/login?wrong", 303)
        answer = RedirectResponse("/", 303)
        self._begin(answer, Session(token, read=rights["read"], command=rights["command"]))
        return answer

    async def logout(self, request: Request) -> Response:
        """Forget who asks."""
        session = self.session(request)
        if session is None or not self.of_our_page(request, session):
            return PlainTextResponse("only the panel's own page may log out", 403)
        self._panel.sessions.end(request.cookies)
        answer = RedirectResponse("/login", 303)
        answer.delete_cookie(self._panel.sessions.cookie)
        return answer

    async def about(self, request: Request) -> Response:
        """What a page needs to know first."""
        session = self.session(request)
        if session is None:
            return JSONResponse({"error": "log in"}, 401)
        config = self._panel.config
        return JSONResponse(
            {
                "csrf": session.csrf,
                "read": session.read,
                "command": session.command,
                "needs_token": self._needs_token,
                "rig": config.rig,
                "simulated": config.simulation is not None,
                "axes": {name: self._axis(name) for name in config.axes},
                "rate_hz": config.loop.rate_hz,
                "dead_man": config.guard.dead_man,
                "fleet": self._panel.fleet is not None,
            }
        )

    async def fleet(self, request: Request) -> Response:
        """All rigs at the broker, for the page."""
        if self.session(request) is None:
            return JSONResponse({"error": "log in"}, 401)
        if self._panel.fleet is None:
            return JSONResponse({"error": "the rig file has no section mqtt"}, 404)
        return JSONResponse(self._panel.fleet.answer())

    def _axis(self, name: str) -> dict[str, Any]:
        axis = self._panel.config.axes[name]
        units = axis.setting_units
        return {
            "mode": axis.mode,
            "command_unit": axis.command_unit,
            "unit": axis.measured_unit,
            "signal_unit": units["hysteresis"],
            "units": units,
            "output": axis.limits.output,
        }

    async def estop(self, request: Request) -> Response:
        """An e-stop from a page whose WebSocket does not answer."""
        session = self.session(request)
        if session is None or not self.of_our_page(request, session):
            return JSONResponse({"error": "only the panel's own page may ask for it"}, 403)
        peer = ("?", 0) if request.client is None else (request.client.host, request.client.port)
        uplink = Uplink(self._panel.way, peer, lambda *_: None)
        try:
            await uplink.open(session.token)
            await uplink.call("estop")
        except RpcError as error:
            return JSONResponse({"error": error.message}, 503)
        finally:
            await uplink.close()
        return JSONResponse({"ok": True})

    async def metrics(self, request: Request) -> Response:
        """For Prometheus: free where no token is asked for, else for a session or a bearer of a token."""
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ").strip()
        allowed = not self._needs_token or self.session(request) is not None
        if not allowed and not (bearer and await self._may_read(bearer, request)):
            return PlainTextResponse("a token of the rig file, please", 401, {"www-authenticate": "Bearer"})
        encode, content_type = choose_encoder(request.headers.get("accept", ""))
        return Response(encode(self._registry), headers={"content-type": content_type})

    async def _may_read(self, token: str, request: HTTPConnection) -> bool:
        host = "?" if request.client is None else request.client.host
        if self._panel.sessions.must_wait(host):
            return False
        known = hashlib.sha256(token.encode()).digest()
        if known not in self._bearers:
            if not (await self._rights(token, host))["read"]:
                self._panel.sessions.was_wrong(host)
                return False
            self._bearers.add(known)
        return True

    async def file(self, request: Request) -> Response:
        """Style, scripts."""
        return self._file(request.path_params["name"])

    async def socket(self, socket: WebSocket) -> None:
        """The page's WebSocket."""
        session = self.session(socket)
        offered = [each.strip() for each in socket.headers.get("sec-websocket-protocol", "").split(",")]
        scheme = self._scheme
        ours = session is not None and is_same_origin(socket.headers, scheme) and len(offered) == 2
        if session is None or not ours or not session.owns(offered[1].removeprefix("csrf.")):
            await socket.close(1008)
            return
        await socket.accept(PROTOCOL)
        await PageSocket(self._panel, socket, session).serve()

    async def foxglove(self, socket: WebSocket) -> None:
        """Live topics for Foxglove, Lichtblick and programs; a token comes as `?token=`."""
        server = self._panel.config.server
        origin = socket.headers.get("origin")
        known = (
            origin is None
            or origin in server.foxglove_origins
            or is_same_origin(socket.headers, self._scheme)
        )
        chosen = choose_protocol(socket.headers.get("sec-websocket-protocol", ""))
        if not server.foxglove or not known or chosen is None or not await self._may_listen(socket):
            await socket.close(1008)
            return
        await socket.accept(chosen)
        await FoxgloveSocket(self._panel, socket).serve()

    async def _may_listen(self, socket: WebSocket) -> bool:
        token = socket.query_params.get("token", "")
        free = not self._needs_token or self.session(socket) is not None
        return free or (bool(token) and await self._may_read(token, socket))

    def _file(self, name: str) -> Response:
        data = self._files.get(name)
        if data is None:
            return PlainTextResponse("no such file", 404)
        return Response(data, media_type=TYPES["." + name.rpartition(".")[2]])

    def _begin(self, answer: Response, session: Session) -> None:
        key = self._panel.sessions.begin(session)
        secure = self._scheme == "https"
        name, age = self._panel.sessions.cookie, int(LIFE_S)
        answer.set_cookie(name, key, max_age=age, httponly=True, samesite="strict", secure=secure)

    async def _rights(self, token: str, host: str) -> dict[str, bool]:
        """What the gateway allows who has this token."""
        uplink = Uplink(self._panel.way, (host, 0), lambda *_: None)
        try:
            return await uplink.open(token)
        except RpcError:
            return {"read": False, "command": False}
        finally:
            await uplink.close()


async def body_of(request: Request, most: int) -> str:
    """A request's body; what is longer is cut off."""
    data = b""
    async for chunk in request.stream():
        data += chunk
        if len(data) > most:
            break
    return data[:most].decode(errors="replace")


def make_app(panel: Panel, scheme: str) -> tuple[ASGIApp, Files]:
    """All that is served over HTTP, and what has files and processes to let go of in the end."""
    pages = Pages(panel, scheme)
    own = Files(panel, pages.session, pages.of_our_page)
    routes = [
        Route("/api/recordings", own.recordings),
        Route("/api/recordings/{name}", own.recording),
        Route("/api/recordings/{name}/rows", own.rows),
        Route("/api/jobs", own.begin_job, methods=["POST"]),
        Route("/api/jobs/{number:int}", own.job),
        Route("/api/jobs/{number:int}", own.cancel_job, methods=["DELETE"]),
        Route("/api/jobs/{number:int}/files/{name}", own.job_file),
        Route("/api/rigfile", own.rig_file),
        Route("/api/rigfile", own.save_rig, methods=["PUT"]),
        Route("/api/rigfile/check", own.check_rig, methods=["POST"]),
        Route("/", pages.page),
        Route("/login", pages.login_page),
        Route("/login", pages.login, methods=["POST"]),
        Route("/logout", pages.logout, methods=["POST"]),
        Route("/metrics", pages.metrics),
        Route("/estop", pages.estop, methods=["POST"]),
        Route("/api/about", pages.about),
        Route("/api/fleet", pages.fleet),
        Route("/static/{name}", pages.file),
        WebSocketRoute("/ws", pages.socket),
        WebSocketRoute("/foxglove", pages.foxglove),
    ]
    return Guarded(Starlette(routes=routes), panel.config.server.host), own
