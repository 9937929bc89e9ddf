"""The fault line without a bus: frames in, frames out."""

from __future__ import annotations

import math
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from sim.faults import KINDS, Fault, FaultLine, Frame

KNOWN = {(0x101, False), (0x102, False)}


def frame(number: int, message: str = "Encoder") -> Frame:
    return Frame(message, 0x101 if message == "Encoder" else 0x102, False, number.to_bytes(4))


def make_line(*faults: Fault, seed: int = 3) -> FaultLine:
    line = FaultLine(Random(seed), KNOWN)
    for fault in faults:
        line.set(0.0, fault)
    return line


def passed(line: FaultLine, frames: int) -> list[Frame]:
    """What comes out of a line that is fed a frame each millisecond and looked at as often."""
    out = []
    for number in range(frames):
        line.put(number * 1e-3, frame(number))
        out += line.take(number * 1e-3)
    return out


def test_without_faults_every_frame_passes_at_once_and_in_order() -> None:
    line = make_line()
    for number in range(3):
        line.put(1.0, frame(number))
    assert line.next_due() == 1.0
    assert line.take(1.0) == [frame(0), frame(1), frame(2)]
    assert line.next_due() == math.inf


def test_drop_loses_its_share() -> None:
    line = make_line(Fault(kind="drop", probability=0.1))
    out = passed(line, 4000)
    assert len(out) + line.counts["drop"] == 4000
    assert line.counts["drop"] == pytest.approx(400, abs=5 * math.sqrt(4000 * 0.1 * 0.9))
    assert out == sorted(out, key=lambda f: f.data)


def test_a_fault_of_one_message_leaves_the_others_alone() -> None:
    line = make_line(Fault(kind="drop", probability=1.0, message="Supply"))
    line.put(0.0, frame(1, "Supply"))
    line.put(0.0, frame(2, "Encoder"))
    assert line.take(0.0) == [frame(2)]


def test_delay_makes_frames_late_by_exactly_that() -> None:
    line = make_line(Fault(kind="delay", seconds=0.25))
    line.put(1.0, frame(1))
    assert line.next_due() == 1.25
    assert line.take(1.2499) == []
    assert line.take(1.25) == [frame(1)]


def test_reorder_swaps_neighbours_and_loses_none() -> None:
    line = make_line(Fault(kind="reorder", probability=1.0))
    assert [f.data[-1] for f in passed(line, 6)] == [1, 0, 3, 2, 5, 4]
    some = passed(make_line(Fault(kind="reorder", probability=0.3)), 500)
    numbers = [int.from_bytes(f.data) for f in some]
    assert sorted(numbers) == list(range(len(numbers)))
    assert numbers != sorted(numbers)
    assert max(abs(place - number) for place, number in enumerate(numbers)) == 1


@given(seed=st.integers(0, 1000), data=st.binary(max_size=8))
def test_corrupt_changes_one_byte_and_not_the_length(seed: int, data: bytes) -> None:
    line = make_line(Fault(kind="corrupt", probability=1.0), seed=seed)
    line.put(0.0, Frame("Encoder", 0x101, False, data))
    (out,) = line.take(0.0)
    assert len(out.data) == len(data)
    assert sum(a != b for a, b in zip(out.data, data, strict=True)) == (1 if data else 0)


def test_garbage_is_added_at_its_rate_and_never_passes_for_a_message() -> None:
    line = make_line(Fault(kind="garbage", rate_hz=500.0))
    out = passed(line, 1000)
    garbage = [f for f in out if f.message == ""]
    assert len(garbage) == pytest.approx(500, abs=1)
    assert [f for f in out if f.message] == [frame(number) for number in range(1000)]
    kinds = {(f.frame_id, f.extended) in KNOWN for f in garbage}
    assert kinds == {True, False}
    assert all(len(f.data) != 4 for f in garbage if (f.frame_id, f.extended) in KNOWN)


def test_stop_sends_nothing_until_cleared() -> None:
    line = make_line(Fault(kind="stop"), Fault(kind="garbage", rate_hz=10.0))
    line.take(0.0)
    line.put(0.0, frame(1))
    line.clear()
    line.put(0.0, frame(2))
    assert line.take(100.0) == [frame(2)]
    assert line.next_due() == math.inf


def test_what_is_delayed_survives_a_clear() -> None:
    line = make_line(Fault(kind="delay", seconds=1.0))
    line.put(0.0, frame(1))
    line.clear()
    line.put(0.5, frame(2))
    assert line.take(0.5) == [frame(2)]
    assert line.take(1.0) == [frame(1)]


@given(
    faults=st.lists(
        st.sampled_from(
            [
                Fault(kind="drop", probability=0.3),
                Fault(kind="delay", seconds=0.0125),
                Fault(kind="reorder", probability=0.4),
                Fault(kind="reorder", probability=0.4, message="Supply"),
            ]
        )
    ),
    seed=st.integers(0, 10_000),
    sent=st.lists(st.sampled_from(["Encoder", "Supply"]), max_size=60),
)
def test_frames_are_neither_doubled_nor_invented_nor_kept(
    faults: list[Fault], seed: int, sent: list[str]
) -> None:
    line = make_line(*faults, seed=seed)
    frames = [frame(number, message) for number, message in enumerate(sent)]
    out = []
    for number, each in enumerate(frames):
        line.put(number * 1e-3, each)
        out += line.take(number * 1e-3)
    out += line.take(10.0)
    assert len(set(out)) == len(out)
    assert set(out) <= set(frames)
    held = len(frames) - len(out) - line.counts["drop"]
    assert 0 <= held <= 2  # one of each message may still wait for the next to swap with


def test_the_seed_decides_which_frames_are_hit() -> None:
    def survivors(seed: int) -> list[Frame]:
        return passed(make_line(Fault(kind="drop", probability=0.5), seed=seed), 50)

    assert survivors(1) == survivors(1)
    assert survivors(1) != survivors(2)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"kind": "drop"}, "drop needs probability"),
        ({"kind": "drop", "probability": 1.5}, "less than or equal to 1"),
        ({"kind": "delay", "probability": 0.5}, "delay takes no probability"),
        ({"kind": "garbage"}, "garbage needs rate_hz"),
        ({"kind": "stop", "seconds": 1.0}, "stop takes no seconds"),
        ({"kind": "melt"}, "'drop', 'delay'"),
        ({"kind": "stop", "colour": "red"}, "colour"),
    ],
)
def test_a_fault_that_makes_no_sense_says_why(values: dict[str, object], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        Fault.model_validate(values)


def test_every_kind_can_be_had() -> None:
    assert list(KINDS) == list(Fault.model_json_schema()["properties"]["kind"]["enum"])
