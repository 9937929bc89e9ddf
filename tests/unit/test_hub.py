import json
import math

from hypothesis import given
from hypothesis import strategies as st

from seod.gateway.hub import Hub as Subscriptions
from seod.observe.feeds import WAITING_BYTES, Feed, Feeds


class Hub(Subscriptions):
    """With the feeds that it asks for, as if there were no process between the two."""

    def __init__(self):
        self.feeds = Feeds(self)
        self.waiting = 0
        super().__init__(lambda message: self.feeds.obey(json.loads(json.dumps(message))))

    def send(self, message):
        message = json.loads(json.dumps(message))
        self.deliver(message.get("told", ()))
        self.lose(message.get("dropped", ()))

    def publish(self, *message):
        self.feeds.publish(*message)

    def flush(self):
        self.feeds.flush()


class Sink:
    def __init__(self):
        self.congested = False
        self.data = b""

    def write(self, data):
        self.data += data

    @property
    def messages(self):
        return [json.loads(line) for line in self.data.splitlines()]

    @property
    def numbers(self):
        return [m["params"]["n"] for m in self.messages if m["method"] != "lost"]


def publish(hub, numbers, topic="sample", axis="motor", period=0.001):
    for n in numbers:
        hub.publish(topic, axis, n * period, lambda n=n: {"n": n})
    hub.flush()


def test_each_message_is_made_once_whoever_gets_it():
    hub, sinks, made = Hub(), [Sink() for _ in range(5)], []
    for sink in sinks:
        hub.subscribe(sink, ["sample"], ["motor"], None)
        hub.subscribe(sink, ["sample"], ["motor"], 10.0)
    hub.publish("sample", "motor", 1.0, lambda: made.append(1) or {"n": 1})
    hub.flush()
    assert made == [1]
    assert [sink.numbers for sink in sinks] == [[1, 1]] * 5


def test_nothing_is_made_when_nobody_listens():
    hub = Hub()
    hub.subscribe(Sink(), ["event"], ["motor"], None)
    hub.publish("sample", "motor", 1.0, lambda: 1 / 0)


def test_topics_and_axes_are_kept_apart():
    hub, sink = Hub(), Sink()
    hub.subscribe(sink, ["sample", "event"], ["roll"], None)
    publish(hub, [1], axis="pitch")
    publish(hub, [2], topic="event", axis="pitch")
    publish(hub, [3], topic="health", axis=None)
    publish(hub, [4], axis="roll")
    publish(hub, [5], topic="event", axis=None)  # concerns all axes
    assert sink.numbers == [4, 5]


@given(st.floats(1.0, 3000.0), st.floats(0.0003, 0.02))
def test_at_most_rate_hz_messages_a_second_and_nearly_as_many(rate_hz, period):
    feed = Feed("sample", frozenset(["motor"]), 1 / rate_hz)
    times = [5.0 + k * period for k in range(2000)]
    passed = [t for t in times if feed.wants("motor", t)]
    lasting = times[-1] - times[0]
    assert len(passed) <= lasting * rate_hz + 1
    assert len(passed) >= min(lasting * rate_hz, len(times)) * 0.5 - 1
    seconds = {}
    for t in passed:
        seconds[int(t)] = seconds.get(int(t), 0) + 1
    assert max(seconds.values()) <= math.ceil(rate_hz) + 1


def test_a_rate_that_divides_that_of_the_samples_is_met_exactly():
    hub, sink = Hub(), Sink()
    hub.subscribe(sink, ["sample"], ["motor"], 100.0)
    publish(hub, range(2000), period=0.0005)
    assert len(sink.numbers) == 100


def test_the_rate_counts_for_each_axis_by_itself():
    hub, sink = Hub(), Sink()
    hub.subscribe(sink, ["sample"], ["pitch", "roll"], 1.0)
    publish(hub, [1], axis="pitch")
    publish(hub, [2], axis="roll")
    assert sink.numbers == [1, 2]


def test_events_are_never_thinned_out():
    hub, sink = Hub(), Sink()
    hub.subscribe(sink, ["event"], ["motor"], 1.0)
    publish(hub, range(50), topic="event")
    assert sink.numbers == list(range(50))


def test_time_that_jumps_back_stops_nothing():
    hub, sink = Hub(), Sink()
    hub.subscribe(sink, ["sample"], ["motor"], 10.0)
    publish(hub, [5000])
    publish(hub, [100])
    assert sink.numbers == [5000, 100]


def test_a_slow_client_loses_and_is_told_while_others_get_all():
    hub, slow, quick = Hub(), Sink(), Sink()
    number = hub.subscribe(slow, ["sample", "event"], ["motor"], None)
    hub.subscribe(quick, ["sample"], ["motor"], None)
    publish(hub, [1])
    slow.congested = True
    publish(hub, [2, 3])
    publish(hub, [4])
    assert slow.numbers == [1]
    assert hub.dropped(slow) == 3
    slow.congested = False
    hub.report(slow)
    publish(hub, [5])
    lost = {"subscription": number, "topic": "sample", "lost": 3, "total": 3}
    assert slow.messages[1] == {"jsonrpc": "2.0", "method": "lost", "params": lost}
    assert slow.numbers == [1, 5]
    assert quick.numbers == [1, 2, 3, 4, 5]
    assert hub.dropped(quick) == 0
    slow.congested = True
    publish(hub, [6])
    slow.congested = False
    hub.report(slow)
    hub.report(slow)
    assert [m["params"] for m in slow.messages if m["method"] == "lost"][1:] == [
        lost | {"lost": 1, "total": 4}
    ]


def test_what_is_unsubscribed_ends_and_leaves_nothing_behind():
    hub, sink, other = Hub(), Sink(), Sink()
    first = hub.subscribe(sink, ["sample", "estimate"], ["motor"], None)
    second = hub.subscribe(sink, ["sample"], ["motor"], None)
    assert hub.numbers(sink) == [first, second]
    assert not hub.unsubscribe(other, first)
    assert hub.unsubscribe(sink, first)
    assert not hub.unsubscribe(sink, first)
    publish(hub, [1])
    assert sink.numbers == [1]
    hub.drop(sink)
    publish(hub, [2])
    assert sink.numbers == [1]
    assert not hub.wanted("sample")
    assert hub.numbers(sink) == []
    assert not hub._channels
    assert not hub._of_sink


def test_what_the_gateway_cannot_take_is_dropped_and_told():
    hub, sink = Hub(), Sink()
    number = hub.subscribe(sink, ["sample"], ["motor"], None)
    publish(hub, [1])
    hub.waiting = WAITING_BYTES + 1
    publish(hub, [2, 3, 4])
    hub.waiting = 0
    publish(hub, [5])
    lost = {"subscription": number, "topic": "sample", "lost": 3, "total": 3}
    assert [m["params"] for m in sink.messages] == [{"n": 1}, lost, {"n": 5}]


def test_a_client_that_ends_is_forgotten_by_the_feeds():
    hub, sink, other = Hub(), Sink(), Sink()
    for rate in range(1, 9):
        hub.subscribe(sink, ["sample", "estimate", "event"], ["pitch", "roll"], float(rate))
    hub.subscribe(other, ["event"], ["pitch"], None)
    hub.drop(sink)
    assert {topic: len(feeds) for topic, feeds in hub.feeds._of_topic.items()} == {
        "estimate": 0,
        "event": 1,
        "sample": 0,
    }
    assert not hub.feeds.wanted("sample", "pitch")
