"""A supervisor whose children, poll, clock and rig are in the hands of a test."""

from __future__ import annotations

import os
import select
import socket
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from seod.processes.handover import receive_json, send_json
from seod.processes.ring import Word
from seod.supervisor import process as supervising
from seod.supervisor.arguments import SupervisorArguments
from seod.supervisor.process import Supervisor

if TYPE_CHECKING:
    import signal
    from collections.abc import Callable, Iterable, Mapping

    import pytest

    from seod.processes.handover import ChildArguments


class FakeChild:
    """A child that never runs: what it says comes from a test."""

    def __init__(self, module: str, arguments: ChildArguments) -> None:
        self.module, self.arguments = module, arguments
        self.link, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.pidfd = os.dup(self.link.fileno())
        self.ready, self.failure = False, ""
        self.how = "ended with exit code 1"
        self.done: list[str] = []
        self.process = SimpleNamespace(returncode=0, wait=lambda: self.done.append("waited for"))

    def signal(self, number: signal.Signals) -> None:
        self.done.append(number.name)

    def end_of(self) -> str:
        return self.failure or self.how

    def end(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        meanwhile()
        self.done.append("ended")
        self.close()

    def close(self) -> None:
        if self.pidfd >= 0:
            os.close(self.pidfd)
        self.pidfd = -1
        self.link.close()
        self.theirs.close()
        self.done.append("closed")

    def says(self, **message: Any) -> None:
        assert send_json(self.theirs, message)

    def hangs_up(self) -> None:
        """It has nothing more to say."""
        self.theirs.close()

    def heard(self) -> list[dict[str, object]]:
        """What it was told."""
        messages = []
        while message := receive_json(self.theirs):
            messages.append(message)
        return messages


@dataclass
class Poller:
    """`select.poll`, whose turns are scripted."""

    turns: Iterable[Any] = ()
    watched: dict[int, int] = field(default_factory=dict)
    timeouts: list[float] = field(default_factory=list)

    def register(self, fd: int, mask: int) -> None:
        self.watched[fd] = mask

    def unregister(self, fd: int) -> None:
        del self.watched[fd]

    def poll(self, timeout: float) -> list[tuple[int, int]]:
        self.timeouts.append(timeout)
        return [(fd, select.POLLIN) for fd in next(self.turns)()]  # type: ignore[call-overload]


@dataclass
class Rig:
    """What neutral is written to."""

    why: str = ""
    recipes: list[Mapping[str, Any]] = field(default_factory=list)
    done: list[object] = field(default_factory=list)

    def open(self, recipe: Mapping[str, Any]) -> Rig:
        self.recipes.append(recipe)
        self.done.append("open")
        return self

    def write(self, commands_sent: int) -> str:
        self.done.append(commands_sent)
        return self.why

    def close(self) -> None:
        self.done.append("close")


class Bench:
    """A supervisor on the bench."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
        self.now = 100.0
        self.poller, self.rig = Poller(), Rig()
        self.children: list[FakeChild] = []
        self.notified: list[str] = []
        self.told: list[tuple[str, int, dict[str, str]]] = []
        clock = SimpleNamespace(monotonic=lambda: self.now)
        monkeypatch.setattr(supervising, "time", clock)
        monkeypatch.setattr(
            supervising, "select", SimpleNamespace(poll=lambda: self.poller, POLLIN=select.POLLIN)
        )
        monkeypatch.setattr(supervising, "Child", self._child)
        monkeypatch.setattr(supervising, "notify", self.notified.append)
        monkeypatch.setattr(supervising.journal, "tell", self._tell)
        self.arguments = SupervisorArguments(
            **{
                "config_fd": 71,
                "config_path": "/etc/seod/press.yaml",
                "rig": "press",
                "axes": 2,
                "rows": 64,
                "priority": 50,
                "hang_timeout": 0.0625,
                "gateway_timeout": 1.0,
                "duration": None,
                "record": None,
                "parent": None,
                **changes,
            }
        )
        self.supervisor = Supervisor(self.arguments)
        monkeypatch.setattr(supervising, "open_neutral", self.rig.open)

    def _child(self, module: str, arguments: ChildArguments) -> FakeChild:
        self.children.append(FakeChild(module, arguments))
        return self.children[-1]

    def _tell(self, message: str, priority: int, **fields: str) -> bool:
        self.told.append((message, priority, fields))
        return True

    @property
    def loop(self) -> FakeChild:
        child: Any = self.supervisor.loop
        assert child is not None
        return child

    @property
    def gateway(self) -> FakeChild:
        child: Any = self.supervisor.gateway
        assert child is not None
        return child

    @property
    def words(self) -> Any:
        return self.supervisor.shared.words

    def started(self) -> Bench:
        """Gateway and loop run, are ready, and the loop has ticked."""
        supervisor = self.supervisor
        supervisor.start_gateway()
        supervisor.start_loop()
        self.loop.says(loop="open", recipe={"kind": "test"})
        supervisor.hear_loop(self.loop)  # type: ignore[arg-type]
        self.loop.says(loop="ready", warnings=[])
        supervisor.hear_loop(self.loop)  # type: ignore[arg-type]
        self.gateway.says(gateway="ready", port=4700)
        supervisor.hear_gateway(self.gateway)  # type: ignore[arg-type]
        self.words[Word.TICKS] = 1
        supervisor.announce()
        self.gateway.heard()
        self.forget()
        return self

    def forget(self) -> None:
        """Look at what comes from now on only."""
        self.rig.done.clear()
        self.notified.clear()
        self.told.clear()

    def close(self) -> None:
        for child in self.children:
            if child.pidfd >= 0:
                child.close()
        os.close(self.supervisor.wake_read)
        os.close(self.supervisor.wake_write)
        if self.supervisor.way is not None:
            self.supervisor.way.close()
        self.supervisor.shared.close()


def silence(bench: Bench) -> None:
    """The loop does not tick until it is fenced."""
    for _ in range(bench.supervisor.hang_polls + 1):
        bench.supervisor.watch_ticks()
