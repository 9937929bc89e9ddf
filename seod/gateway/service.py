"""The protocol's methods: who may call them, what they take and what they answer."""

from __future__ import annotations

import hmac
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from seod.config.axis import METHODS
from seod.config.settings import LOOP_SETTINGS, refusal
from seod.gateway.hub import keys_of
from seod.gateway.params import (
    TOPICS,
    AuthenticateParams,
    AxisParams,
    DriveParams,
    EstopParams,
    Params,
    RecordParams,
    SetParams,
    SubscribeParams,
    UnsubscribeParams,
    in_si,
    read_params,
)
from seod.processes.ring import OVERTAKEN, bin_edges_us
from seod.protocol.jsonrpc import (
    BUSY,
    INVALID_PARAMS,
    REFUSED,
    TOO_MANY_CLIENTS,
    UNAUTHORISED,
    Call,
    JsonText,
    Refusal,
    Request,
    RpcError,
    hint,
    unknown_method,
)

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Awaitable, Callable

    from pydantic import SecretStr

    from seod.config.server import ServerConfig
    from seod.gateway.desk import Axis, Desk
    from seod.gateway.hub import Hub, Key, Sink

Result = dict[str, Any] | JsonText
Right = Literal["none", "read", "command"]
MAX_SUBSCRIPTIONS = 16
RATES_HZ = {"estimate": 100.0, "model_error": 10.0, "event": 10.0, "health": 1.0}
"""About what a topic brings of an axis at most; samples come at the loop's rate."""
MOST = 2.0
"""Messages for one client, over all samples of the rig: twice what a program needs that listens to all,"""
SLOW_TOPICS_HZ = 2000.0
"""and so many more, for all other topics."""
WITHOUT_SEAT = ("authenticate", "estop")
"""Methods for clients beyond `server.max_clients` as well."""


@dataclass(eq=False, slots=True)
class Session:
    """One client: its way out, what it may do, and how often it gave a wrong token."""

    sink: Sink
    may_read: bool
    may_command: bool
    wrong_tokens: int = 0
    holds: bool = False
    """It has called keepalive."""
    take_seat: Callable[[], bool] = lambda: True
    """Whether it is one of `server.max_clients`."""


@dataclass(frozen=True, slots=True)
class Method:
    """One method: the right it needs, its parameters, and what it does at once or after a while."""

    right: Right
    params: type[Params]
    call: Callable[[Session, Any], Result | Awaitable[Result]]


class Service:
    """Answers requests about one rig."""

    def __init__(self, config: ServerConfig, rig: Desk, hub: Hub) -> None:
        self._config = config
        self._rig = rig
        self._hub = hub
        self._holders: set[int] = set()
        self.overtake: Callable[[Sink], None] = lambda _: None
        """Called at an e-stop by a client, to refuse what waits; the server sets it."""
        self.methods: dict[str, Method] = {
            "info": Method("read", Params, lambda *_: rig.ask("info")),
            "list": Method("read", Params, self._list),
            "status": Method("read", Params, lambda *_: rig.ask("status")),
            "get": Method("read", AxisParams, self._get),
            "subscribe": Method("read", SubscribeParams, self._subscribe),
            "unsubscribe": Method("read", UnsubscribeParams, self._unsubscribe),
            "authenticate": Method("none", AuthenticateParams, self._authenticate),
            "set": Method("command", SetParams, self._set),
            "drive": Method("command", DriveParams, self._drive),
            "start": Method("command", AxisParams, self._command("start")),
            "stop": Method("command", AxisParams, self._command("stop")),
            "estop": Method("command", EstopParams, self._estop),
            "reset": Method("command", AxisParams, self._reset),
            "keepalive": Method("command", Params, self._keepalive),
            "record": Method("command", RecordParams, self._record),
        }

    def session(self, sink: Sink) -> Session:
        """A new client; without tokens in the rig file it may do everything."""
        free = not self.needs_token()
        return Session(sink, free, free)

    def needs_token(self) -> bool:
        """Whether clients must authenticate."""
        return self._config.read_token is not None or self._config.command_token is not None

    def right_of(self, call: Call) -> Right:
        """The right that a call needs; `none` for what is answered at once."""
        methods = [self.methods.get(each.method) for each in call.requests if isinstance(each, Request)]
        rights = {method.right for method in methods if method is not None}
        if "command" in rights:
            return "command"
        return "read" if "read" in rights or call.batch else "none"

    def overtaken(self, call: Call) -> list[Refusal]:
        """What the sender of a call is told that an e-stop has overtaken."""
        error = RpcError(REFUSED, OVERTAKEN)
        answered = [each for each in call.requests if isinstance(each, Refusal) or each.answered]
        return [Refusal(each.id, error) for each in answered]

    def gone(self, session: Session, name: str) -> None:
        """A client has ended; the last one that held the rig lets it go."""
        if session.holds:
            self._holders.discard(id(session))
            if not self._holders:
                self._rig.mailbox.send("let_go", None, {"client": name})

    def call(self, session: Session, request: Request) -> Result | Awaitable[Result]:
        """Carry out a request; commands to the loop take time.

        Raises:
            RpcError: It cannot be done; says why.
        """
        method = self.methods.get(request.method)
        if method is None:
            raise unknown_method(request.method, self.methods)
        self._check_right(session, method.right)
        if request.method not in WITHOUT_SEAT and not session.take_seat():
            most = f"server.max_clients is {self._config.max_clients}"
            raise RpcError(TOO_MANY_CLIENTS, f"too many clients: {most}; only an e-stop is carried out")
        params = self._in_si(request.params) if method.params is SetParams else request.params
        return method.call(session, read_params(method.params, params))

    def _check_right(self, session: Session, right: Right) -> None:
        if right == "read" and not session.may_read:
            raise RpcError(
                UNAUTHORISED, "authenticate first, with the rig file's read_token or command_token"
            )
        if right == "command" and not session.may_command:
            raise RpcError(
                UNAUTHORISED, "commanding needs the rig file's command_token: authenticate with it"
            )

    def _authenticate(self, session: Session, params: AuthenticateParams) -> Result:
        command = self._is_token(params.token, self._config.command_token)
        read = self._is_token(params.token, self._config.read_token)
        if self.needs_token() and not (command or read):
            session.wrong_tokens += 1
            raise RpcError(UNAUTHORISED, "wrong token")
        session.may_read |= command or read
        session.may_command |= command
        session.take_seat()
        return {"read": session.may_read, "command": session.may_command}

    @staticmethod
    def _is_token(given: str, right: SecretStr | None) -> bool:
        # surrogates come through JSON but not through UTF-8; compared in constant time
        if right is None:
            return False
        return hmac.compare_digest(given.encode(errors="replace"), right.get_secret_value().encode())

    def _axis(self, name: str | None) -> Axis:
        axes = self._rig.axes
        if name is None and len(axes) == 1:
            return next(iter(axes.values()))
        if name is None:
            raise RpcError(INVALID_PARAMS, f"axis: required, one of {', '.join(axes)}")
        if name not in axes:
            raise RpcError(INVALID_PARAMS, f"axis: no axis {name[:40]!r}{hint(name[:40], axes)}")
        return axes[name]

    def _index(self, name: str | None) -> int | None:
        return None if name is None else list(self._rig.axes).index(self._axis(name).name)

    def _list(self, session: Session, _: Params) -> Result:
        return {
            "axes": list(self._rig.axes),
            "topics": list(TOPICS),
            "methods": list(self.methods),
            "subscriptions": self._hub.numbers(session.sink),
            "histogram_edges_us": bin_edges_us(),
        }

    def _get(self, _: Session, params: AxisParams) -> Awaitable[Result]:
        return self._rig.ask("get", self._axis(params.axis).name)

    def _subscribe(self, session: Session, params: SubscribeParams) -> Result:
        axes = [self._axis(name).name for name in params.axes or self._rig.axes]
        if len(self._hub.numbers(session.sink)) >= MAX_SUBSCRIPTIONS:
            raise RpcError(BUSY, f"{MAX_SUBSCRIPTIONS} subscriptions are the most for one client")
        self._check_work(session, params, frozenset(axes))
        number = self._hub.subscribe(session.sink, params.topics, axes, params.rate_hz)
        return {"subscription": number}

    def _check_work(self, session: Session, params: SubscribeParams, axes: frozenset[str]) -> None:
        """Hold what a client has subscribed to, and wants to, against what one may cost."""
        new = [key for topic in set(params.topics) for key in keys_of(topic, axes, params.rate_hz)]
        asked = sum(map(self._rate_of, [*self._hub.keys(session.sink), *new]))
        most = MOST * self._rate_of(("sample", frozenset(self._rig.axes), 0.0)) + SLOW_TOPICS_HZ
        if asked > most:
            what = f"rate_hz: this client would get {asked:.0f} messages a second"
            raise RpcError(BUSY, f"{what}; {most:.0f} are the most for one")

    def _rate_of(self, key: Key) -> float:
        """About how many messages a second a feed brings at most."""
        topic, axes, period_s = key
        rate_hz = RATES_HZ.get(topic, self._rig.config.loop.rate_hz)
        return len(axes) * (min(rate_hz, 1.0 / period_s) if period_s else rate_hz)

    def _unsubscribe(self, session: Session, params: UnsubscribeParams) -> Result:
        if not self._hub.unsubscribe(session.sink, params.subscription):
            numbers = ", ".join(map(str, self._hub.numbers(session.sink))) or "none"
            what = f"subscription: no subscription {params.subscription} of this client; it has {numbers}"
            raise RpcError(INVALID_PARAMS, what)
        return {"unsubscribed": params.subscription}

    def _command(self, op: str) -> Callable[[Session, Any], Awaitable[Result]]:
        def begin(_: Session, params: Params) -> Awaitable[Result]:
            return self._carry_out(op, self._index(getattr(params, "axis", None)))

        return begin

    def _estop(self, session: Session, _: Params) -> Awaitable[Result]:
        """Stop before anything else is done; only the answer is waited for."""
        estop = self._rig.mailbox.estop()
        self.overtake(session.sink)
        return self._stopped(estop)

    async def _stopped(self, estop: asyncio.Future[None]) -> Result:
        await self._rig.mailbox.stopped(estop)
        return {"ok": True}

    def _keepalive(self, session: Session, _: Params) -> Awaitable[Result]:
        session.holds = True
        self._holders.add(id(session))
        return self._carry_out("keepalive", None)

    async def _record(self, _: Session, params: RecordParams) -> Result:
        """Begin a recording, or end the one that was begun so; answers what `health` says of the recorder."""
        answer: dict[str, Any] = json.loads(await self._rig.ask("record_on" if params.on else "record_off"))
        if answer["error"]:
            raise RpcError(REFUSED, answer["error"])
        return {"recorder": answer["recorder"]}

    async def _carry_out(self, op: str, axis: int | None, values: dict[str, Any] | None = None) -> Result:
        await self._rig.mailbox.post(op, axis, values)
        return {"ok": True}

    def _reset(self, _: Session, params: AxisParams) -> Awaitable[Result]:
        return self._leave_fault(self._index(params.axis))

    async def _leave_fault(self, axis: int | None) -> Result:
        await self._rig.reset(axis)
        return {"ok": True}

    def _drive(self, _: Session, params: DriveParams) -> Awaitable[Result]:
        axis = self._axis(params.axis)
        check_drive(axis, params)
        return self._carry_out(
            "drive", self._index(axis.name), params.model_dump(exclude={"axis"}, exclude_defaults=True)
        )

    def _in_si(self, params: object) -> object:
        """Settings with units as numbers, where the axis is known; else what is wrong is told later."""
        name = params.get("axis") if isinstance(params, dict) else None
        if name is None and len(self._rig.axes) == 1:
            name = next(iter(self._rig.axes))
        axis = self._rig.axes.get(name) if isinstance(name, str) else None
        return params if axis is None else in_si(params, axis.config.setting_units)

    def _set(self, _: Session, params: SetParams) -> Awaitable[Result]:
        axis = self._axis(params.axis)
        values = params.values()
        check_settings(axis, values)
        return self._change(axis, values)

    async def _change(self, axis: Axis, values: dict[str, Any]) -> Result:
        for_loop = {key: values[key] for key in LOOP_SETTINGS if key in values}
        if for_loop:
            await self._rig.mailbox.post("set", self._index(axis.name), for_loop)
        self._rig.change(axis, values, told={key: values[key] for key in values.keys() - for_loop.keys()})
        return {"axis": axis.name, "settings": dict(axis.settings)}


def check_drive(axis: Axis, params: DriveParams) -> None:
    """Hold a drive against the axis' limits.

    Raises:
        RpcError: INVALID_PARAMS; names the parameter and the limit.
    """
    limits = axis.config.limits
    volts, most = abs(params.volts) + abs(axis.settings["bias"]), limits.output
    if volts > most:
        unit = axis.config.command_unit
        what = (
            f"|volts| + |bias| = {volts:g} {unit} is over limits.output = {most:g} {unit} of axis {axis.name}"
        )
        raise RpcError(INVALID_PARAMS, f"volts: {what}")
    if params.duration > limits.excitation:
        what = f"must be at most limits.excitation = {limits.excitation:g} s of axis {axis.name}"
        raise RpcError(INVALID_PARAMS, f"duration: {what}, got {params.duration:g}")


def check_settings(axis: Axis, values: dict[str, Any]) -> None:
    """Hold new settings against the axis' limits; e_a and bias count together with what is in force.

    Raises:
        RpcError: INVALID_PARAMS; names the parameter and the limit.
    """
    if not values:
        raise RpcError(INVALID_PARAMS, f"give at least one of {', '.join(axis.settings)}")
    now = {key: value for key, value in axis.settings.items() if key in LOOP_SETTINGS and value is not None}
    why = refusal(axis.config, now, {key: values[key] for key in LOOP_SETTINGS if key in values})
    if why is not None:
        raise RpcError(INVALID_PARAMS, f"{why} of axis {axis.name}")
    given = values.get("method", axis.settings["method"])[:40]
    if given not in METHODS:
        raise RpcError(INVALID_PARAMS, f"method: no estimator {given!r}{hint(given, METHODS)}")
