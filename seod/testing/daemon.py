"""A daemon as a process of a test."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Self

from seod.client import Client, UnreachableError

if TYPE_CHECKING:
    from pathlib import Path

    from seod.api.rig_file import RigFile

READY_S = 60.0
"""The daemon must answer within this time: it may have to compile the plant."""
END_S = 20.0


class Daemon:
    """`seod run` on a rig file, from `with` to its end.

    Args:
        rig: The rig file, saved, with a port of its own.
        log: Where its output goes.

    Attributes:
        rig: See above.
        port: Where it listens, on loopback.
    """

    def __init__(self, rig: RigFile, log: Path) -> None:
        self.rig, self.port = rig, rig.config.server.port
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        with self._log.open("wb") as output:
            self._process = subprocess.Popen(  # noqa: S603 - our own
                [sys.executable, "-m", "seod.cli", "run", str(self.rig.path)],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        deadline = time.monotonic() + READY_S
        try:
            while not self._answers():
                self._check(deadline)
                time.sleep(0.05)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is None or self._process.poll() is not None:
            return
        self._process.terminate()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def client(self) -> Client:
        """A new connection; a context."""
        return Client(port=self.port, wait=READY_S)

    def log(self) -> str:
        """What it has printed."""
        return self._log.read_text("utf-8", "replace")

    def _check(self, deadline: float) -> None:
        if self._process is not None and self._process.poll() is not None:
            raise RuntimeError(f"the daemon ended: {self.log()}")
        if time.monotonic() > deadline:
            raise RuntimeError(f"the daemon does not answer: {self.log()}")

    def _answers(self) -> bool:
        try:
            with Client(port=self.port) as client:
                return bool(client.info()["rig"] == self.rig.rig)
        except UnreachableError:
            return False


def own_rig(rig: RigFile, folder: Path) -> RigFile:
    """A shipped rig with a name and a port of its own, and patience with a busy computer.

    Two daemons of one name, or on one port, would not run beside each other.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    values = {
        "rig": f"{rig.rig}-{os.getpid()}-{port}",
        "server.port": port,
        "loop.hang_timeout": "1 s",
        "guard.stale": "100 ms",
        "guard.overruns": {"count": 150, "window": "100 ms"},
    }
    made = rig.with_values(values)
    return type(rig)(made.save(folder / "rig.yaml"))
