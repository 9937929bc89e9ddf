"""Who has logged in at the page: cookies, and against whom they are guarded."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

LIFE_S: Final = 12 * 3600.0
"""A session ends this long after its login."""
MOST: Final = 200
"""Sessions at a time; then the oldest ends."""
WRONG: Final = 5
"""Wrong tokens from one computer within `WRONG_S`; then it has to wait."""
WRONG_S: Final = 60.0


@dataclass(slots=True)
class Session:
    """One browser, logged in.

    Attributes:
        token: The rig file's that it gave; None where there are none.
        read: It may read.
        command: It may command.
        csrf: What its page sends along to show that it is ours.
        born: When it logged in, of CLOCK_MONOTONIC [s].
    """

    token: str | None
    read: bool
    command: bool
    csrf: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    born: float = field(default_factory=time.monotonic)

    def owns(self, csrf: str) -> bool:
        """Whether this comes from its own page."""
        return hmac.compare_digest(csrf.encode(), self.csrf.encode())


class Sessions:
    """All of them, by the value of their cookie."""

    def __init__(self) -> None:
        self.cookie = "seod_session"
        """The cookie's name; it has the port in it, for browsers send cookies to all ports of a computer."""
        self._sessions: dict[str, Session] = {}
        self._wrong: Counter[str] = Counter()
        self._wrong_since = time.monotonic()

    def begin(self, session: Session) -> str:
        """Keep a session; returns the cookie's value."""
        key = secrets.token_urlsafe(32)
        self._sessions[key] = session
        while len(self._sessions) > MOST:
            del self._sessions[next(iter(self._sessions))]
        return key

    def find(self, cookies: Mapping[str, str]) -> Session | None:
        """The session of a request, if it has one that still lives."""
        key = cookies.get(self.cookie, "")
        session = self._sessions.get(key)
        if session is not None and time.monotonic() - session.born > LIFE_S:
            del self._sessions[key]
            return None
        return session

    def end(self, cookies: Mapping[str, str]) -> None:
        """Log out."""
        self._sessions.pop(cookies.get(self.cookie, ""), None)

    def must_wait(self, host: str) -> bool:
        """Whether a computer has given too many wrong tokens of late."""
        if time.monotonic() - self._wrong_since > WRONG_S:
            self._wrong.clear()
            self._wrong_since = time.monotonic()
        return self._wrong[host] >= WRONG

    def was_wrong(self, host: str) -> None:
        """Count a wrong token."""
        self._wrong[host] += 1


def host_name(host: str) -> str:
    """The name in a `Host` header, without its port."""
    name = host.rpartition(":")[0] if not host.endswith("]") and ":" in host else host
    return name.strip("[]").lower()


def is_ours(host: str, listens_on: str) -> bool:
    """Whether a `Host` header may be ours: on loopback only loopback is, so no name of others leads here."""
    name = host_name(host)
    if name in {"localhost", listens_on}:
        return True
    try:
        loopback = ipaddress.ip_address(listens_on).is_loopback
        return ipaddress.ip_address(name).is_loopback or not loopback
    except ValueError:
        return not _is_loopback_name(listens_on)


def _is_loopback_name(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_same_origin(headers: Mapping[str, str], scheme: str) -> bool:
    """Whether a request comes from a page of ours: its `Origin` is the address that it was sent to."""
    return headers.get("origin", "").lower() == f"{scheme}://{headers.get('host', '')}".lower()
