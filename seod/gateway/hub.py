"""Who hears what: subscriptions of clients to feeds. A message is encoded once, whoever gets it.

A client that does not keep up loses messages and is told how many once it does; nobody waits for it.
"""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING, Any, Protocol

from seod.protocol.jsonrpc import notification

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    Key = tuple[str, frozenset[str], float]

UNLIMITED = ("event", "health")
"""Topics that no rate limit thins out."""


class Sink(Protocol):
    """A client's way out. `congested` while it has too much to read; then nothing may be written."""

    @property
    def congested(self) -> bool:
        """Whether it does not keep up."""

    def write(self, data: bytes) -> None:
        """Send."""


class Outlet:
    """One topic of one subscription."""

    def __init__(self, sink: Sink, subscription: int, topic: str) -> None:
        self.sink = sink
        self.subscription = subscription
        self.topic = topic
        self.channels: list[Channel] = []
        self.lost = 0
        self.lost_total = 0

    def offer(self, data: bytes, messages: int) -> None:
        """Send, or count as lost."""
        if self.sink.congested:
            self.lose(messages)
        else:
            self.sink.write(data)

    def lose(self, messages: int) -> None:
        """So many did not come so far."""
        self.lost += messages
        self.lost_total += messages

    def report(self) -> None:
        """Tell the client what it lost since it was last told."""
        if self.lost:
            numbers = {"lost": self.lost, "total": self.lost_total}
            params = {"subscription": self.subscription, "topic": self.topic, **numbers}
            self.lost = 0
            self.sink.write(notification("lost", params))


class Channel:
    """One feed's way to its outlets, which share the same bytes."""

    def __init__(self, number: int, key: Key) -> None:
        self.number = number
        self.key = key
        self.outlets: dict[Outlet, None] = {}
        self.pending: list[bytes] = []

    def flush(self) -> None:
        """Hand on what is queued, in one piece."""
        data, messages = b"".join(self.pending), len(self.pending)
        self.pending.clear()
        for outlet in self.outlets:
            outlet.offer(data, messages)

    def as_message(self, on: bool) -> dict[str, Any]:
        """What the estimating process is told: that the feed begins, or ends."""
        topic, axes, period_s = self.key
        return {"feed": self.number, "on": on, "topic": topic, "axes": sorted(axes), "period_s": period_s}


class Hub:
    """All subscriptions of all clients.

    Args:
        tell: Takes messages for the process that publishes.
    """

    def __init__(self, tell: Callable[[dict[str, Any]], None]) -> None:
        self._tell = tell
        self._numbers, self._channel_numbers = count(1), count(1)
        self._channels: dict[Key, Channel] = {}
        self._by_number: dict[int, Channel] = {}
        self._of_sink: dict[Sink, dict[int, list[Outlet]]] = {}

    def subscribe(self, sink: Sink, topics: Iterable[str], axes: Iterable[str], rate_hz: float | None) -> int:
        """Start sending; returns the subscription's number."""
        number = next(self._numbers)
        outlets = []
        for topic in sorted(set(topics)):
            outlet = Outlet(sink, number, topic)
            for key in keys_of(topic, frozenset(axes), rate_hz):
                channel = self._channel(key)
                channel.outlets[outlet] = None
                outlet.channels.append(channel)
            outlets.append(outlet)
        self._of_sink.setdefault(sink, {})[number] = outlets
        return number

    def _channel(self, key: Key) -> Channel:
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = Channel(next(self._channel_numbers), key)
            self._by_number[channel.number] = channel
            self._tell(channel.as_message(on=True))
        return channel

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
        for outlet in outlets:
            for channel in outlet.channels:
                del channel.outlets[outlet]
                if not channel.outlets:
                    del self._channels[channel.key], self._by_number[channel.number]
                    self._tell(channel.as_message(on=False))

    def numbers(self, sink: Sink) -> list[int]:
        """The subscriptions of a client."""
        return sorted(self._of_sink.get(sink, {}))

    def keys(self, sink: Sink) -> list[Key]:
        """What the subscriptions of a client bring: topic, axes, least time between messages [s]."""
        outlets = [outlet for each in self._of_sink.get(sink, {}).values() for outlet in each]
        return [channel.key for outlet in outlets for channel in outlet.channels]

    def wanted(self, topic: str) -> bool:
        """Whether anybody listens."""
        return any(key[0] == topic for key in self._channels)

    def deliver(self, told: Iterable[tuple[list[int], str]]) -> None:
        """Hand messages on: each with the numbers of the feeds that bring it, and its line."""
        touched: dict[Channel, None] = {}
        for numbers, text in told:
            data = text.encode("ascii")
            for number in numbers:
                channel = self._by_number.get(number)
                if channel is not None:
                    channel.pending.append(data)
                    touched[channel] = None
        for channel in touched:
            channel.flush()

    def lose(self, dropped: Iterable[tuple[int, int]]) -> None:
        """So many messages of a feed were never sent here: its number, and how many."""
        for number, messages in dropped:
            channel = self._by_number.get(number)
            for outlet in channel.outlets if channel else ():
                outlet.lose(messages)
                if not outlet.sink.congested:
                    outlet.report()

    def report(self, sink: Sink) -> None:
        """A client reads again: tell it what it lost."""
        for outlets in self._of_sink.get(sink, {}).values():
            for outlet in outlets:
                outlet.report()

    def dropped(self, sink: Sink) -> int:
        """Messages that a client lost so far, over its present subscriptions."""
        return sum(o.lost_total for outlets in self._of_sink.get(sink, {}).values() for o in outlets)


def keys_of(topic: str, axes: frozenset[str], rate_hz: float | None) -> list[Key]:
    """The feeds that a subscription to a topic needs: one for each axis where a rate thins them out."""
    if topic in UNLIMITED:
        return [(topic, axes, 0.0)]
    period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
    return [(topic, frozenset([axis]), period_s) for axis in sorted(axes)]
