"""Commands that come through the broker: which are carried out. No sockets; time is an argument."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from seod.config.mqtt import ID_PATTERN
from seod.fleet.topics import decode
from seod.protocol.jsonrpc import hint

if TYPE_CHECKING:
    from seod.fleet.topics import Body

METHODS: Final = frozenset({"set", "start", "stop", "reset", "estop"})
FRESH_S: Final = 5.0
"""A command whose stamp is this far from our clock is not carried out [s]; chosen."""
REMEMBERED: Final = 1000
"""Ids of commands that are not carried out again: QoS 1 brings a message twice now and then."""
ID_MOST: Final = 64


class RefusedError(Exception):
    """A command is not carried out; the message says what would be right."""

    def __init__(self, why: str, identity: str | None = None, client: str | None = None) -> None:
        super().__init__(why)
        self.identity, self.client = identity, client


@dataclass(frozen=True, slots=True)
class Command:
    """A command that may go to the gateway, which judges right, limits and guard.

    Attributes:
        identity: Stands in the answer.
        client: Whose topic the answer goes to; None: everyone's.
        method: Of the gateway.
        params: Its parameters.
        token: For the gateway.
    """

    identity: str
    client: str | None
    method: str
    params: dict[str, Any]
    token: str | None

    @property
    def answer_suffix(self) -> str:
        """Suffix of the topic of its answer."""
        return answer_suffix(self.client)


def answer_suffix(client: str | None) -> str:
    """Suffix of the topic of answers to a client."""
    return "answer" if client is None else f"answer/{client}"


class Commands:
    """Judges commands of one rig."""

    def __init__(self) -> None:
        self._done: deque[str] = deque(maxlen=REMEMBERED)

    def judge(self, payload: object, retained: bool, now: float) -> Command:
        """A command that may be carried out.

        Args:
            payload: As it came.
            retained: The broker had kept it: it may be of any age, and would come again at each connection.
            now: UTC [s].

        Raises:
            RefusedError: It may not.
        """
        body = decode(payload)
        if body is None:
            raise RefusedError("must be a JSON object")
        identity, client = _name_of(body), _client_of(body)
        if retained:
            raise RefusedError("retained: a command must not be kept by the broker", identity, client)
        why = self._why_not(body, now)
        if why or identity is None:
            raise RefusedError(why or f"id: required, text of at most {ID_MOST} characters", identity, client)
        self._done.append(identity)
        token = body.get("token")
        params = body.get("params") or {}
        return Command(
            identity, client, str(body["method"]), params, token if isinstance(token, str) else None
        )

    def _why_not(self, body: Body, now: float) -> str:
        method = body.get("method")
        if not isinstance(method, str) or method not in METHODS:
            known = ", ".join(sorted(METHODS))
            return f"method: must be one of {known}{hint(str(method)[:40], METHODS)}"
        if not isinstance(body.get("params") or {}, dict):
            return "params: must be an object"
        if body.get("id") in self._done:
            return "id: this command was taken before"
        return "" if method == "estop" else _why_late(body.get("at"), now)


def _why_late(at: object, now: float) -> str:
    """Why a stamp (UTC [s]) does not do; an e-stop needs none."""
    if isinstance(at, bool) or not isinstance(at, int | float):
        return "at: required, when it was sent, UTC in seconds"
    if not abs(now - at) <= FRESH_S:
        return f"at: {now - at:.1f} s ago by the rig's clock; {FRESH_S:g} s are the most"
    return ""


def _name_of(body: Body) -> str | None:
    identity = body.get("id")
    return identity if isinstance(identity, str) and 0 < len(identity) <= ID_MOST else None


def _client_of(body: Body) -> str | None:
    client = body.get("client")
    return client if isinstance(client, str) and re.fullmatch(ID_PATTERN, client) else None
