"""Who hears what: topics, axes and rate limits. A message is encoded once, whoever gets it.

A client that does not keep up loses messages and is told how many once it does; nobody waits for it.
"""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING, Any, Protocol

from seod.protocol import notification

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

UNLIMITED = ("event", "health")
"""Topics that no rate limit thins out."""


class Sink(Protocol):
    """A client's way out. `congested` while it has too much to read; then nothing may be written."""

    congested: bool

    def write(self, data: bytes) -> None:
        """Send."""


class Outlet:
    """One topic of one subscription."""

    def __init__(self, sink: Sink, subscription: int, topic: str) -> None:
        self.sink = sink
        self.subscription = subscription
        self.topic = topic
        self.lost = 0
        self.lost_total = 0

    def offer(self, data: bytes, messages: int) -> None:
        """Send, or count as lost."""
        if self.sink.congested:
            self.lost += messages
            self.lost_total += messages
        else:
            self.sink.write(data)

    def report(self) -> None:
        """Tell the client what it lost since it was last told."""
        if self.lost:
            numbers = {"lost": self.lost, "total": self.lost_total}
            params = {"subscription": self.subscription, "topic": self.topic, **numbers}
            self.lost = 0
            self.sink.write(notification("lost", params))


class Feed:
    """One topic at one rate for some axes: all its outlets share the same bytes."""

    def __init__(self, topic: str, axes: frozenset[str], period_s: float) -> None:
        self.topic = topic
        self.axes = axes
        self.period_s = period_s
        self.outlets: list[Outlet] = []
        self._due = 0.0
        self._pending: list[bytes] = []

    def wants(self, axis: str | None, t: float) -> bool:
        """Whether a message of time `t` [s] passes; without an axis it concerns all."""
        if axis is not None and axis not in self.axes:
            return False
        if self._due - self.period_s <= t < self._due:  # earlier still: time has jumped back
            return False
        on_grid = self._due + self.period_s
        self._due = on_grid if t < on_grid else t + self.period_s
        return True

    def put(self, data: bytes) -> None:
        """Queue for the next flush."""
        self._pending.append(data)

    def flush(self) -> None:
        """Send what is queued, in one piece."""
        if self._pending:
            data = b"".join(self._pending)
            for outlet in self.outlets:
                outlet.offer(data, len(self._pending))
            self._pending.clear()


class Hub:
    """All subscriptions of all clients."""

    def __init__(self) -> None:
        self._numbers = count(1)
        self._feeds: dict[tuple[str, frozenset[str], float], Feed] = {}
        self._of_sink: dict[Sink, dict[int, list[Outlet]]] = {}

    def subscribe(self, sink: Sink, topics: Iterable[str], axes: Iterable[str], rate_hz: float | None) -> int:
        """Start sending; returns the subscription's number."""
        number = next(self._numbers)
        outlets = []
        for topic in sorted(set(topics)):
            outlet = Outlet(sink, number, topic)
            for feed in self._feeds_for(topic, frozenset(axes), rate_hz):
                feed.outlets.append(outlet)
            outlets.append(outlet)
        self._of_sink.setdefault(sink, {})[number] = outlets
        return number

    def _feeds_for(self, topic: str, axes: frozenset[str], rate_hz: float | None) -> list[Feed]:
        unlimited = topic in UNLIMITED or rate_hz is None
        period_s = 0.0 if unlimited or rate_hz is None else 1.0 / rate_hz
        groups = [axes] if topic in UNLIMITED else [frozenset([axis]) for axis in sorted(axes)]
        keys = [(topic, group, period_s) for group in groups]
        return [self._feeds.setdefault(key, Feed(*key)) for key in keys]

    def unsubscribe(self, sink: Sink, number: int) -> bool:
        """End one subscription; False if this client has no such one."""
        outlets = self._of_sink.get(sink, {}).pop(number, None)
        self._forget(outlets or [])
        return outlets is not None

    def drop(self, sink: Sink) -> None:
        """A client is gone."""
        for outlets in self._of_sink.pop(sink, {}).values():
            self._forget(outlets)

    def _forget(self, outlets: list[Outlet]) -> None:
        for key, feed in list(self._feeds.items()):
            feed.outlets = [each for each in feed.outlets if each not in outlets]
            if not feed.outlets:
                del self._feeds[key]

    def numbers(self, sink: Sink) -> list[int]:
        """The subscriptions of a client."""
        return sorted(self._of_sink.get(sink, {}))

    def wanted(self, topic: str, axis: str | None = None) -> bool:
        """Whether anybody listens."""
        return any(f.topic == topic and (axis is None or axis in f.axes) for f in self._feeds.values())

    def publish(self, topic: str, axis: str | None, t: float, params: Callable[[], dict[str, Any]]) -> None:
        """Queue a message for those who want it; `params` is called at most once."""
        data = None
        for feed in self._feeds.values():
            if feed.topic == topic and feed.wants(axis, t):
                data = data or notification(topic, params())
                feed.put(data)

    def flush(self) -> None:
        """Send everything queued."""
        for feed in list(self._feeds.values()):
            feed.flush()

    def report(self, sink: Sink) -> None:
        """A client reads again: tell it what it lost."""
        for outlets in self._of_sink.get(sink, {}).values():
            for outlet in outlets:
                outlet.report()

    def dropped(self, sink: Sink) -> int:
        """Messages that a client lost so far, over its present subscriptions."""
        return sum(o.lost_total for outlets in self._of_sink.get(sink, {}).values() for o in outlets)
