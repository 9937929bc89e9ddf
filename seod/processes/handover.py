"""How the supervisor starts its two children and what it hands them. Standard library only."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import socket
import sys
from dataclasses import asdict, dataclass

PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class ChildArguments:
    """What a child is given: file descriptors it inherits and where its rig file lies.

    Attributes:
        config_fd: memfd with the validated rig file as JSON.
        shared_fd: memfd of `seod.processes.ring.Shared`.
        supervisor_fd: Connected SOCK_SEQPACKET socket to the supervisor.
        supervisor_pid: The parent; a child whose parent is gone must not go on.
        axes: Number of axes (size of the shared memory).
        rows: Length of the row ring.
        generation: Number of this loop process, from 1.
        record: File to record to, or None.
        config_path: Where the rig file lies, for messages.
        panel_fd: Between gateway and panel or fleet: their clients come through it; -1 without these.
    """

    config_fd: int
    shared_fd: int
    supervisor_fd: int
    supervisor_pid: int
    axes: int
    rows: int
    generation: int
    record: str | None
    config_path: str
    panel_fd: int = -1

    def inherited(self) -> tuple[int, ...]:
        """Descriptors that a child gets."""
        fds = (self.config_fd, self.shared_fd, self.supervisor_fd)
        return fds if self.panel_fd < 0 else (*fds, self.panel_fd)

    def command(self, module: str) -> list[str]:
        """Command line that runs `module` with these arguments."""
        return [sys.executable, "-m", module, json.dumps(asdict(self))]

    @classmethod
    def from_argv(cls) -> ChildArguments:
        """The arguments of this process."""
        return cls(**json.loads(sys.argv[1]))


def read_memfd(fd: int) -> bytes:
    """All of a memfd, whatever its file position."""
    return os.pread(fd, os.fstat(fd).st_size, 0)


def write_memfd(name: str, content: bytes) -> int:
    """A new inheritable memfd with this content."""
    fd = os.memfd_create(name, 0)
    os.pwrite(fd, content, 0)
    return fd


def die_with_parent(parent_pid: int) -> None:
    """Have the kernel send SIGTERM when the parent ends, however it ends.

    Raises:
        SystemExit: The parent is gone already.
    """
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent_pid:
        raise SystemExit("the supervisor is gone")


def send_json(link: socket.socket, message: dict[str, object]) -> bool:
    """Send one datagram without waiting; False if the other end is gone or full."""
    try:
        link.send(json.dumps(message).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
    except OSError:
        return False
    return True


def receive_json(link: socket.socket) -> dict[str, object] | None:
    """The next datagram if there is one; {} at the end of the stream, None if nothing is waiting."""
    try:
        data = link.recv(1 << 20, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    except OSError:
        return {}
    message: dict[str, object] = json.loads(data) if data else {}
    return message
