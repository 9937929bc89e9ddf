"""Processes beside the daemon, panel and fleet: started, and started again; the rig does not depend on them.

Standard library only.
"""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

from seod.processes.handover import receive_json
from seod.supervisor.say import say

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.supervisor.child import Child

RESTARTS = 5


class Way:
    """The way by which such processes hand clients to the gateway; they share their end of it."""

    def __init__(self) -> None:
        self.own_end, self.gateway_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def close(self) -> None:
        """Give both ends back."""
        self.own_end.close()
        self.gateway_end.close()


class Keeper:
    """Keeps one such process.

    Args:
        name: What people call it: `panel`, `fleet`.
        start: Starts the process.
    """

    def __init__(self, name: str, start: Callable[[], Child]) -> None:
        self.name = name
        self._start = start
        self._starts = 0
        self.child: Child | None = None

    def start(self) -> None:
        """Start the process."""
        self._starts += 1
        self.child = self._start()

    def hear(self) -> bool:
        """It says what it does, or why it cannot; False once nothing more comes."""
        message = None if self.child is None else receive_json(self.child.link)
        if self.child is None or not message:
            return message != {}
        if message.get(self.name) == "failed":
            self.child.failure = str(message["why"])
        for line in message.get("says", ()):  # type: ignore[attr-defined] # a list of sentences
            say(str(line))
        return True

    def died(self, drop: Callable[[Child], None]) -> None:
        """It has ended: say why, and start it again unless it cannot do its work."""
        child = self.child
        if child is None:
            return
        self.hear()  # its last words may still be under way
        self.child = None
        why = child.end_of()
        goes_on = f"the {self.name}: {why}; the rig goes on without it"
        say(goes_on if child.failure else f"the {self.name} process {why}")
        drop(child)
        if not child.failure and self._starts <= RESTARTS:
            self.start()

    def end(self) -> None:
        """The daemon ends."""
        if self.child is not None:
            self.child.end()
