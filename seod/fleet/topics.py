"""Topics and payloads, without sockets. Topics are `seod/v1/RIG/...`; payloads are JSON objects in UTF-8."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

PREFIX: Final = "seod/v1"
ALL: Final = f"{PREFIX}/#"
KINDS: Final = ("event", "state", "health", "estimate")
"""What is stored and sent in order. Those behind are given up before those in front."""
RETAINED: Final = frozenset({"state"})
"""Of these, what the broker keeps for those who come later."""
MOST_BYTES: Final = 256 * 1024
"""Longest payload that is looked at."""

Body = dict[str, Any]


class Key(NamedTuple):
    """Place of a message among all of its rig: the publisher's session, and its number in it."""

    session: int
    seq: int


NOTHING: Final = Key(0, 0)


def topic_of(rig: str, suffix: str) -> str:
    """The topic of a rig, such as `seod/v1/press/estimate/motor`."""
    return f"{PREFIX}/{rig}/{suffix}"


def split_topic(topic: str) -> tuple[str, str] | None:
    """Rig and suffix of a topic; None for a foreign one."""
    parts = topic.split("/", 3)
    return (parts[2], parts[3]) if len(parts) == 4 and topic.startswith(PREFIX + "/") else None


def kind_of(suffix: str) -> str:
    """`estimate` of `estimate/motor`."""
    return suffix.partition("/")[0]


def encode(body: Mapping[str, Any]) -> bytes:
    """JSON in one line; numbers that are not finite become null."""
    return json.dumps(_finite(body), separators=(",", ":")).encode()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, list | tuple) else value


def decode(payload: object) -> Body | None:
    """The object in a payload; None if there is none."""
    if not isinstance(payload, bytes | bytearray) or len(payload) > MOST_BYTES:
        return None
    try:
        body = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    return body if isinstance(body, dict) else None


def key_of(value: object) -> Key | None:
    """A key from `[session, seq]`; None if it is none."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        return None
    session, seq = value
    whole = type(session) is int and type(seq) is int
    return Key(session, seq) if whole and session >= 0 and seq >= 0 else None


def enveloped(head: Mapping[str, Any], body: bytes) -> bytes:
    """A stored body with what is known of it only as it is sent, in front."""
    return encode(head)[:-1] + (b"," if len(body) > 2 else b"") + body[1:]
