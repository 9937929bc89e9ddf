"""Who commands through the panel: one at a time, taken over openly. Everybody may stop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from seod.protocol.jsonrpc import REFUSED, RpcError

if TYPE_CHECKING:
    from collections.abc import Callable

FOR_COMMANDERS = frozenset({"set", "start", "reset", "drive", "keepalive"})
"""Methods of the gateway that only the commander may call; the rights it checks come on top."""


class Client(Protocol):
    """A page or an SCPI client."""

    @property
    def name(self) -> str:
        """What others know it by."""

    @property
    def session(self) -> object:
        """Who it is; what it has begun beside its connection may command while it does."""


class Commander:
    """Holds who commands now."""

    def __init__(self) -> None:
        self._now: Client | None = None
        self.taken_from = ""
        """Who commanded before it was last taken over."""
        self.told: Callable[[str], None] = lambda _: None
        """Called with a sentence when it changes."""

    @property
    def now(self) -> Client | None:
        """Who commands."""
        return self._now

    def check(self, client: Client, method: str) -> None:
        """Let a command through; the first who commands becomes commander.

        Raises:
            RpcError: Somebody else commands.
        """
        if method not in FOR_COMMANDERS or self._now is client:
            return
        if self._now is not None:
            raise RpcError(REFUSED, f"{self._now.name} commands at present: take over first")
        self._set(client, f"{client.name} commands now")

    def take(self, client: Client) -> None:
        """Command from now on, whoever did before."""
        if self._now is client:
            return
        before = self._now
        self.taken_from = before.name if before is not None else ""
        over = f", taken over from {before.name}" if before is not None else ""
        self._set(client, f"{client.name} commands now{over}")

    def release(self, client: Client) -> None:
        """Do not command any more."""
        if self._now is client:
            self._set(None, f"{client.name} commands no longer")

    def _set(self, client: Client | None, sentence: str) -> None:
        self._now = client
        self.told(sentence)

    def seen_by(self, client: Client) -> dict[str, Any]:
        """For the page: who commands, and whether that is itself."""
        return {"name": None if self._now is None else self._now.name, "you": self._now is client}
