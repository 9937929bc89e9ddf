"""A child process of the supervisor. Standard library only."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.processes.handover import ChildArguments

LOOK_S = 0.25
STOP_TIMEOUT_S = 3.0
"""A child that has not ended this long after SIGTERM is killed."""


class Child:
    """A child process with its pidfd and its socket."""

    def __init__(self, module: str, arguments: ChildArguments) -> None:
        self.link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            mine = replace(arguments, supervisor_fd=theirs.fileno())
            self.process = subprocess.Popen(  # noqa: S603 - our own module
                mine.command(module),
                pass_fds=mine.inherited(),
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # ctrl-C in a terminal is for the supervisor to act on, in order
            )
        self.pidfd = os.pidfd_open(self.process.pid)
        self.ready = False
        self.failure = ""

    def signal(self, number: signal.Signals) -> None:
        """Signal exactly this process, never another that got its number."""
        try:
            signal.pidfd_send_signal(self.pidfd, number)
        except ProcessLookupError:
            return

    def end_of(self) -> str:
        """How the process ended, for people. Waits for it."""
        code = self.process.wait()
        if code < 0:
            return f"killed by signal {-code} ({signal.Signals(-code).name})"
        return self.failure or f"ended with exit code {code}"

    def close(self) -> None:
        """Give the descriptors back."""
        os.close(self.pidfd)
        self.link.close()

    def end(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """SIGTERM, and SIGKILL if that does not help in time; `meanwhile` is called now and then."""
        self.signal(signal.SIGTERM)
        if not self._ends(meanwhile):
            self.signal(signal.SIGKILL)
            self.process.wait()
        self.close()

    def _ends(self, meanwhile: Callable[[], None]) -> bool:
        for _ in range(round(STOP_TIMEOUT_S / LOOK_S)):
            meanwhile()
            try:
                self.process.wait(LOOK_S)
            except subprocess.TimeoutExpired:
                continue
            return True
        return False
