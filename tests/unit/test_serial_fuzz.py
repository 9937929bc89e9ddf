"""Any bytes at any times into the serial driver: parsers, handshake, clock and commands together."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.serial import SerialDriver
from drivers.serial_ascii import seal
from drivers.serial_counters import COMMANDS
from drivers.serial_frame import COMMAND, Block, BoardSample, Splitter, decode, encode, hello, sample
from tests.unit.serial_bench import make_options

if TYPE_CHECKING:
    from collections.abc import Callable

BLOCK = Block("iB")
BYTES, WORDS = st.integers(0, 255), st.integers(0, (1 << 32) - 1)


class Line:
    """Stands for the port: what the other end sends is put in, what it is sent is kept."""

    def __init__(self) -> None:
        self.down, self.is_open = "", True
        self.coming = b""
        self.sent: list[bytes] = []
        self.full = False

    def open(self) -> None: ...

    def close(self) -> None: ...

    def drop_output(self) -> None: ...

    def flush(self) -> bool:
        return not self.full

    def reopen(self, t: float) -> bool:
        return False

    def wait(self, timeout: float) -> bool:
        return bool(self.coming)

    def read(self) -> bytes:
        data, self.coming = self.coming, b""
        return data

    def send(self, data: bytes) -> bool:
        if not self.full:
            self.sent.append(data)
        return not self.full


HELLOS = st.builds(
    hello,
    version=st.sampled_from([1, 1, 1, 2]),
    layout=st.sampled_from(["iB/h", "iB/h", "f/f", "", "i" * 60]),
    rate_hz=st.sampled_from([2000.0, 1.0, 4e6]),
    watchdog_s=st.sampled_from([0.05, 0.0, 65.0]),
    name=st.text(max_size=20),
)
READINGS = st.tuples(st.integers(-(1 << 31), (1 << 31) - 1), BYTES)
SAMPLES = st.builds(
    BoardSample, BYTES, WORDS | st.integers(0, 10_000), BYTES, BYTES, st.integers(0, 70_000), READINGS
).map(lambda s: sample(BLOCK, s))
NUMBER = st.one_of(
    WORDS.map(str),
    BYTES.map(str),
    st.sampled_from(["nan", "-inf", "1e999", "+1", "0x1", "", "1_0", "٣", "-0"]),
)
LINES = st.one_of(
    st.lists(NUMBER, min_size=5, max_size=7).map(lambda words: ",".join(words).encode() + b"\n"),
    st.lists(BYTES.map(str), min_size=6, max_size=6).map(lambda words: seal(",".join(words))),
    st.sampled_from([b"# seod 1 mine\n", b"# seod 2\n", b"#\n", b"\n", b"*\n", b"1,2*\n", b"\r\r\n"]),
)
FRAMES = st.builds(encode, BYTES, BYTES, st.binary(max_size=40))
GARBAGE = st.one_of(st.binary(max_size=60), st.binary(min_size=1, max_size=4).map(lambda part: part * 200))


@st.composite
def streams(draw: st.DrawFn) -> bytes:
    """Whole messages, cut ones, damaged ones and garbage."""
    data = bytearray(draw(st.one_of(HELLOS, SAMPLES, SAMPLES, LINES, LINES, FRAMES, GARBAGE)))
    if data and draw(st.integers(0, 4)) == 0:
        data[draw(st.integers(0, len(data) - 1))] ^= draw(st.integers(1, 255))
    return bytes(data[draw(st.integers(0, 3)) :] if draw(st.integers(0, 4)) == 0 else data)


EVENTS = st.tuples(
    st.lists(streams(), max_size=4).map(b"".join),
    st.sampled_from([0.0, 5e-4, 5e-4, 0.02, 0.3, 5.0]),
    st.sampled_from(["write", "write", "neutral", "wait"]),
    st.floats(allow_nan=False, allow_infinity=False),
    st.booleans(),
)


def command_values(data: bytes) -> list[bytes]:
    """Bodies of the commands in what was sent."""
    frames = [decode(each) for each in Splitter(b"\0", 400).feed(data) if each]
    return [frame.body for frame in frames if frame.type == COMMAND]


def driver_on(line: Line, clock: Callable[[], float], **changes: object) -> SerialDriver:
    driver = SerialDriver(make_options(**changes), clock)
    driver._link = line  # type: ignore[assignment]
    line.coming = hello(1, "iB/h", 2000.0, 0.05, "fuzz")
    driver.open(("angle", "enable"), ("valve",))
    driver.start()
    return driver


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [{}, {"format": "ascii", "fields": ["time", "sequence", "ack", "age", "angle", "enable"]}],
    ids=["binary", "ascii"],
)
@settings(max_examples=150, deadline=None)
@given(events=st.lists(EVENTS, max_size=40))
def test_whatever_comes_whenever_the_driver_stands(
    changes: dict[str, object], events: list[tuple[bytes, float, str, float, bool]]
) -> None:
    line, now = Line(), [1000.0]
    driver = driver_on(line, lambda: now[0], **changes)
    times, counts = [driver.read(now[0])[0].t], list(driver.counters)
    for data, after, call, value, full in events:
        now[0] += after
        line.coming += data
        line.full = full
        told = driver.read(now[0])[0]
        times.append(told.t)
        assert told.t <= now[0] + 1e-9
        assert math.isnan(told.value) or math.isfinite(told.value)
        stranger = driver._handshake.state in ("asking", "refused")
        before = len(line.sent)
        if call == "wait":
            line.coming = b""
            driver.wait(now[0])
        elif call == "write":
            driver.write(now[0], [value])
        else:
            driver.neutral(now[0])
        assert not (stranger and call != "wait") or line.sent[before:] == []
        assert all(math.isnan(t) or 0.0 <= t <= now[0] for t in driver.left())
        assert all(new >= old for new, old in zip(driver.counters, counts, strict=True))
        counts = list(driver.counters)
    assert all(a <= b for a, b in pairwise(times))
    assert all(sd >= 0.0 or math.isnan(sd) for sd in driver.stamp_error())


@settings(max_examples=100, deadline=None)
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=30))
def test_no_value_makes_a_command_beyond_its_type_and_no_more_wait_than_may(values: list[float]) -> None:
    line = Line()
    driver = driver_on(line, lambda: 1000.0, max_in_flight=4)
    line.sent.clear()
    for value in values:
        driver.write(1000.0, [value])
    assert len(line.sent) == min(len(values), 4) == driver.counters[COMMANDS]
    bodies = [body for data in line.sent for body in command_values(data)]
    told = [int.from_bytes(body, "little", signed=True) for body in bodies]
    assert told == [round(min(max(value / 1e-3, -32768.0), 32767.0)) for value in values[:4]]
