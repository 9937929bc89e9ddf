"""The supervisor's part for the panel: it is started, and started again; the rig does not depend on it.

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


class PanelKeeper:
    """Keeps the panel's process, and the way by which it hands clients to the gateway.

    Args:
        start: Starts the process, which inherits this descriptor.
    """

    def __init__(self, start: Callable[[int], Child]) -> None:
        self._start = start
        self._own_end, self.gateway_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._starts = 0
        self.child: Child | None = None

    def start(self) -> None:
        """Start the process."""
        self._starts += 1
        self.child = self._start(self._own_end.fileno())

    def hear(self) -> bool:
        """The panel says where it listens, or why it cannot; False once nothing more comes."""
        message = None if self.child is None else receive_json(self.child.link)
        if self.child is None or not message:
            return message != {}
        if message.get("panel") == "failed":
            self.child.failure = str(message["why"])
        for line in message.get("listens", ()):  # type: ignore[attr-defined] # a list of sentences
            say(str(line))
        return True

    def died(self, drop: Callable[[Child], None]) -> None:
        """It has ended: say why, and start it again unless it cannot listen."""
        child = self.child
        if child is None:
            return
        self.hear()  # its last words may still be under way
        self.child = None
        why = child.end_of()
        say(f"the panel: {why}; the rig goes on without it" if child.failure else f"the panel process {why}")
        drop(child)
        if not child.failure and self._starts <= RESTARTS:
            self.start()

    def end(self) -> None:
        """The daemon ends."""
        if self.child is not None:
            self.child.end()
        self._own_end.close()
        self.gateway_end.close()
