"""A real Mosquitto as a second process on loopback, which tests kill and start again."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.peers import free_port, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

PROGRAM = shutil.which("mosquitto") or "/usr/sbin/mosquitto"


class Mosquitto:
    """The broker; what it keeps lives in its folder, unless it is killed before it has written it."""

    def __init__(self, folder: Path, *more: str) -> None:
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        self._log = folder / "mosquitto.log"
        lines = [
            f"listener {self.port} 127.0.0.1",
            "max_queued_messages 0",
            "max_inflight_messages 1000",
            *more,
        ]
        if not any(line.startswith("password_file") for line in more):
            lines.append("allow_anonymous true")
        self._config.write_text("\n".join(lines) + "\n")
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self._log.open("ab") as log:
            self.process = subprocess.Popen([PROGRAM, "-c", self._config], stdout=log, stderr=log)
        until("the broker", lambda: port_open(self.port), 20)
        assert self.process.poll() is None, self._log.read_text()

    def kill(self, number: signal.Signals = signal.SIGKILL) -> None:
        assert self.process is not None
        self.process.send_signal(number)
        self.process.wait()
        self.process = None


@contextmanager
def mosquitto(folder: Path, *more: str) -> Iterator[Mosquitto]:
    """The broker, up."""
    if not Path(PROGRAM).exists():
        why = "no broker: apt-get install mosquitto"
        if os.environ.get("SEOD_REQUIRE_VM") == "1":
            pytest.fail(why)
        pytest.skip(why)
    folder.mkdir(exist_ok=True)
    broker = Mosquitto(folder, *more)
    broker.start()
    try:
        yield broker
    finally:
        if broker.process is not None:
            broker.kill(signal.SIGTERM)
