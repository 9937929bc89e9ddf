"""The kernel in a process of its own, because importing numba holds a process up for seconds."""

from __future__ import annotations

import socket
import subprocess
import sys
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from seod.config.model import RigConfig
    from seod.model_monitor.window import Array, Segment

_END_S: Final = 1.0


class RemoteModel:
    """As `KernelModel`; the process starts with the first segment.

    Args:
        config: The rig file.
        axis: Name of the axis.
    """

    name = "kernel"

    def __init__(self, config: RigConfig, axis: str) -> None:
        self._about = config.model_dump_json(), axis
        self._process: subprocess.Popen[bytes] | None = None
        self._link: Connection | None = None

    def residual(self, segment: Segment) -> Array:
        """See `Model`.

        Raises:
            ValueError: The model cannot be simulated.
            OSError: The process is gone; the machine may not allow compiled code.
        """
        link = self._link or self._start()
        try:
            link.send(segment)
            answer: Array | str = link.recv()
        except (EOFError, BrokenPipeError, ConnectionResetError) as error:
            raise OSError("the process that simulates it has died") from error
        if isinstance(answer, str):
            raise ValueError(answer)  # noqa: TRY004 - what the other side raised
        return answer

    def close(self) -> None:
        """End the process, which ends a segment that is under way, and hang up."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._link is not None:
            self._link.close()

    def _start(self) -> Connection:
        ours, theirs = socket.socketpair()
        with theirs:
            words = [sys.executable, "-m", "seod.model_monitor.worker", str(theirs.fileno())]
            self._process = subprocess.Popen(  # noqa: S603 - our own module
                words, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL
            )
        self._link = Connection(ours.detach())
        self._link.send(self._about)
        return self._link
