"""Loop and gateway in one process, on simulated time: what a daemon does, the same in each run."""

from __future__ import annotations

import os
from collections import defaultdict
from typing import TYPE_CHECKING, Any

from seod.estimate import make_estimator
from seod.observe.rig import Rig
from seod.processes.ring import Shared

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.unit.loop_bench import Bench

POLL_S = 5e-3


class Listener:
    """Takes the place of the hub: keeps what is published."""

    def __init__(self) -> None:
        self.messages: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
        """By topic."""

    def publish(self, topic: str, _axis: str | None, _t: float, make: Callable[[], dict[str, Any]]) -> None:
        self.messages[topic].append(make())

    def wanted(self, topic: str, _axis: str) -> bool:
        return topic == "sample"

    def flush(self) -> None:
        """Nothing waits here."""


class WholeRig:
    """A loop bench, and a gateway that takes its rows and events every few ticks."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        ours = self.bench.shared
        self.shared = Shared(ours.axes, ours.rows, os.dup(ours.fd))
        self.hub = Listener()
        hub: Any = self.hub
        self.gateway = Rig(
            self.bench.config, self.shared, hub, make_estimator, self.bench.pacer.now, self.send
        )

    def send(self, op: str, axis: int, values: dict[str, Any]) -> None:
        """What the gateway does with it."""
        self.shared.commands.put({"id": 0, "op": op, "axis": axis, "values": values})

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / POLL_S)):
            self.bench.run(POLL_S)
            self.gateway.poll()

    def run_until(self, what: Callable[[], Any], seconds: float) -> bool:
        """Whether it came true within so much simulated time."""
        for _ in range(round(seconds / POLL_S)):
            self.run(POLL_S)
            if what():
                return True
        return False

    def told(self, topic: str, **fields: Any) -> list[dict[str, Any]]:
        """Messages of a topic that have these fields."""
        messages = self.hub.messages[topic]
        return [each for each in messages if all(each.get(key) == value for key, value in fields.items())]

    def newest(self, topic: str) -> dict[str, Any]:
        """The last message of a topic; empty before there is one."""
        messages = self.hub.messages[topic]
        return messages[-1] if messages else {}

    def close(self) -> None:
        self.gateway.close()
        self.shared.close()
        self.bench.close()
