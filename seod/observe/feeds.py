"""What is published: each message is encoded once, for all feeds that want it.

The gateway says which feeds there are, and hands what they bring to its clients (`seod.gateway.hub`).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any

from seod.protocol.jsonrpc import notification

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.processes.link import Link

TEXT_A_MESSAGE = 32_768
"""Characters of notifications that go to the gateway at once: a few hundred samples, 0.2 ms of its time."""
WAITING_BYTES = 4_000_000
"""Of a gateway that takes less than comes; what comes on top is dropped and counted."""


class Feed:
    """One topic at one rate for some axes."""

    def __init__(self, topic: str, axes: frozenset[str], period_s: float) -> None:
        self.topic = topic
        self.axes = axes
        self.period_s = period_s
        self._due = 0.0

    def wants(self, axis: str | None, t: float) -> bool:
        """Whether a message of time `t` [s] passes; without an axis it concerns all."""
        if axis is not None and axis not in self.axes:
            return False
        if self._due - self.period_s <= t < self._due:  # earlier still: time has jumped back
            return False
        on_grid = self._due + self.period_s
        self._due = on_grid if t < on_grid else t + self.period_s
        return True


class Feeds:
    """All feeds, by the numbers that the gateway gave them.

    Args:
        link: The way to the gateway.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._of_topic: defaultdict[str, dict[int, Feed]] = defaultdict(dict)
        self._told: list[tuple[list[int], str]] = []
        self._length = 0
        self._dropped: Counter[int] = Counter()

    def obey(self, message: dict[str, Any]) -> None:
        """Begin a feed, or end one."""
        number, topic = message["feed"], message["topic"]
        if message["on"]:
            self._of_topic[topic][number] = Feed(topic, frozenset(message["axes"]), message["period_s"])
        else:
            self._of_topic[topic].pop(number, None)

    def wanted(self, topic: str, axis: str) -> bool:
        """Whether anybody listens."""
        return any(axis in feed.axes for feed in self._of_topic[topic].values())

    def publish(self, topic: str, axis: str | None, t: float, params: Callable[[], dict[str, Any]]) -> None:
        """Queue a message for those who want it; `params` is called at most once."""
        numbers = [number for number, feed in self._of_topic[topic].items() if feed.wants(axis, t)]
        if not numbers:
            return
        if self._link.waiting > WAITING_BYTES:
            self._dropped.update(numbers)
            return
        text = notification(topic, params()).decode()
        self._told.append((numbers, text))
        self._length += len(text)
        if self._length > TEXT_A_MESSAGE:
            self.flush()

    def flush(self) -> None:
        """Send everything queued, and how many messages were dropped before."""
        if self._dropped and self._link.waiting < WAITING_BYTES // 2:
            self._link.send({"dropped": list(self._dropped.items())})
            self._dropped.clear()
        if self._told:
            self._link.send({"told": self._told})
            self._told, self._length = [], 0
