"""What arrives at the CAN driver: frames, their order and times."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base import NO_SAMPLE
from drivers.can_counters import COUNTER_NAMES
from drivers.can_sequence import NEW, Sequence
from tests.unit.can_bench import CODEC, ENCODER, VALVE, Rig, rigs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    yield from rigs(monkeypatch)


@pytest.fixture
def rig(make: Callable[..., Rig]) -> Rig:
    return make()


def test_the_filters_pass_exactly_the_frames_that_are_needed(rig: Rig) -> None:
    assert rig.asked[0]["can_filters"] == [
        {"can_id": ENCODER, "can_mask": 0x7FF, "extended": False},
        {"can_id": VALVE, "can_mask": 0x7FF, "extended": False},
    ]


def test_a_frame_becomes_a_sample_at_the_kernels_time(rig: Rig) -> None:
    assert list(rig.driver.read(rig.clock.t)) == [NO_SAMPLE, NO_SAMPLE]
    rig.clock.t += 0.002
    rig.encoder(0.5, 0, at=rig.clock.t - 0.0015)
    angle, enable = rig.driver.read(rig.clock.t)
    assert angle.value == pytest.approx(0.5)
    assert enable.value == 1
    assert angle.t == enable.t == pytest.approx(rig.clock.t - 0.0015, abs=1e-6)


def counts(rig: Rig) -> dict[str, int]:
    names = ("lost", "repeated", "reordered", "garbage", "counter_restarts")
    return {name: found for name in names if (found := rig.count(name))}


def feed(rig: Rig, *counters: int) -> dict[str, int]:
    """Frames with these counters; what the driver counts then."""
    for counter in counters:
        rig.encoder(float(counter % 256), counter)
        rig.driver.read(rig.clock.t)
    return counts(rig)


def test_lost_repeated_and_reordered_frames_are_told_apart(rig: Rig) -> None:
    assert feed(rig, 10, 11, 14, 14, 13, 15) == {"repeated": 1, "reordered": 1}
    assert rig.angle() == pytest.approx(15)
    assert rig.count("frames_received") == 4
    assert feed(rig, *range(16, 30)) == {"lost": 1, "repeated": 1, "reordered": 1}, "12 never came"


def test_a_reordered_frame_is_not_lost(rig: Rig) -> None:
    swapped = [n + (1 if n % 2 else -1) for n in range(1, 401)]
    assert feed(rig, 0, *swapped) == {"reordered": 200}


def test_an_older_frame_never_replaces_a_newer_one(rig: Rig) -> None:
    assert feed(rig, 255, 256, 255) == {"repeated": 1}
    assert rig.angle() == pytest.approx(0.0)


@pytest.mark.parametrize("jump", [9, 100, 128, 200, 247])
def test_a_counter_that_jumps_is_garbage_and_its_values_are_not_used(rig: Rig, jump: int) -> None:
    assert feed(rig, 10, 11, 11 + jump) == {}
    assert rig.angle() == pytest.approx(11.0)
    assert feed(rig, *range(12, 40)) == {"garbage": 1}
    assert rig.angle() == pytest.approx(39.0)


def test_nothing_but_garbage_is_garbage(rig: Rig) -> None:
    assert feed(rig, 10, 110, 210, 60, 160) == {"garbage": 3}, "the last one may still be the first of many"
    assert rig.angle() == pytest.approx(10.0)


def test_a_long_gap_is_believed_with_its_second_frame(rig: Rig) -> None:
    assert feed(rig, 10, 61) == {}
    assert rig.angle() == pytest.approx(10.0)
    assert feed(rig, 62) == {"lost": 50}
    assert rig.angle() == pytest.approx(62.0)


def test_a_counter_that_begins_anew_is_no_loss(rig: Rig) -> None:
    assert feed(rig, *range(100), 0, 1, 2, 3) == {"counter_restarts": 1}
    assert rig.angle() == pytest.approx(3.0)


@settings(max_examples=80)
@given(st.lists(st.sampled_from(["next", "skip", "repeat", "back", "swap", "garbage"]), max_size=60))
def test_the_sequence_check_against_a_plain_count(steps: list[str]) -> None:
    """The truth knows the whole numbers of the frames; the driver has their last eight bits."""
    with pytest.MonkeyPatch.context() as patch:
        rig = Rig(patch)
        came, newest, wanted = {1000}, 1000, Counter[str]()
        feed(rig, newest)
        for step in steps:
            for sent in {
                "next": [newest + 1],
                "skip": [newest + 5],
                "repeat": [newest],
                "back": [newest - 3],
                "swap": [newest + 2, newest + 1],
                "garbage": [newest + 100, newest + 1],
            }[step]:
                if sent == newest + 100:
                    wanted["garbage"] += 1
                elif sent in came or sent < 1000:
                    wanted["repeated"] += 1
                else:
                    wanted["reordered"] += sent < newest
                    came.add(sent)
                    newest = max(newest, sent)
                feed(rig, sent)
        wanted["lost"] = len(set(range(1000, newest - 8)) - came)
        assert rig.angle() == pytest.approx(newest % 256)
        assert counts(rig) == dict(+wanted)
        rig.driver.close()


@settings(max_examples=80)
@given(st.lists(st.integers(0, 255), max_size=80), st.sampled_from([2, 4, 16, 256]))
def test_any_counters_leave_counts_that_only_grow(counters: list[int], period: int) -> None:
    counted = [0] * len(COUNTER_NAMES)
    sequence = Sequence(period, counted)
    for counter in counters:
        before = list(counted)
        sequence.judge(counter % period)
        assert all(new >= old for new, old in zip(counted, before, strict=True))
    last = sequence.last or 0
    for ahead in range(1, 2 * 256):  # whatever came before, frames that count are used again after two
        assert sequence.judge((last + period // 2 + ahead) % period) == NEW or ahead <= 256


def test_repeated_frames_are_told_and_not_each_of_them(rig: Rig) -> None:
    feed(rig, 10, 10, 10)
    rig.clock.t += 5.0
    feed(rig, 10)
    told = list(rig.driver.remarks)
    assert [code for code, _ in told] == ["repeated_frames"]
    assert "Encoder: 1 frames with the same counter as one before" in told[0][1]
    rig.clock.t += 6.0
    rig.driver.read(rig.clock.t)
    assert "Encoder: 3 frames" not in told[0][1]
    assert "Encoder: 2 frames" in rig.driver.remarks[1][1]


def test_garbage_is_told(rig: Rig) -> None:
    feed(rig, 10, 110, 11)
    assert [code for code, _ in rig.driver.remarks] == ["garbage_frames"]


def test_why_a_sample_is_old_is_known(rig: Rig) -> None:
    feed(rig, 10, 17)
    assert rig.driver.why_old(0) == ""
    feed(rig, 17, 17)
    assert (
        "the counter counter stands still at 17: the sender repeats its frame, 2 times"
        in rig.driver.why_old(0)
    )
    assert rig.driver.why_old(1) == rig.driver.why_old(0), "both signals are of one message"
    rig.arrive(ENCODER, bytes(5))
    bad = bytearray(CODEC.encode("Encoder", {"angle": 9.0}, 18))
    bad[0] ^= 1
    rig.arrive(ENCODER, bytes(bad))
    rig.driver.read(rig.clock.t)
    assert "1 of a wrong length, 1 with a wrong checksum" in rig.driver.why_old(0)
    feed(rig, 18)
    assert rig.driver.why_old(0) == ""


def test_a_rig_that_starts_again_is_heard_after_a_few_frames(rig: Rig) -> None:
    rig.encoder(1.0, 3)
    for counter in range(8):
        rig.encoder(2.0, counter)
    assert rig.angle() == pytest.approx(2.0)


def test_broken_frames_are_counted_and_not_used(rig: Rig) -> None:
    rig.encoder(1.0, 0)
    bad = bytearray(CODEC.encode("Encoder", {"angle": 9.0}, 1))
    bad[0] ^= 1
    rig.arrive(ENCODER, bytes(bad))
    rig.arrive(ENCODER, bytes(5))
    rig.arrive(ENCODER, b"", is_remote_frame=True)
    rig.arrive(0x300, bytes(8))
    supply = CODEC.layout("Supply").message  # not asked for: it came before the filters
    rig.arrive(supply.frame_id, bytes(supply.length))
    assert rig.angle() == pytest.approx(1.0)
    assert rig.count("checksum_errors") == 1
    assert rig.count("wrong_length") == 1
    assert rig.count("unknown_frames") == 3
    rig.encoder(2.0, 1)  # the broken frame's counter is not believed either
    assert rig.angle() == pytest.approx(2.0)
    assert rig.count("lost") == 0


def test_late_frames_are_counted_where_the_rate_is_known(make: Callable[..., Rig]) -> None:
    rig = make(messages={"Encoder": {"rate_hz": 1000}})
    for counter, gap in enumerate([0, 0.001, 0.0011, 0.004, 0.001]):
        rig.clock.t += gap
        rig.encoder(0.0, counter)
        rig.driver.read(rig.clock.t)
    assert rig.count("late") == 1


def test_two_frames_with_one_stamp_are_two_samples(rig: Rig) -> None:
    rig.encoder(1.0, 0)
    first = rig.driver.read(rig.clock.t)[0]
    rig.encoder(1.0, 1)
    assert rig.driver.read(rig.clock.t)[0].t > first.t


def test_wait_ends_at_a_new_sample_or_at_the_deadline(rig: Rig) -> None:
    deadline = rig.clock.t + 0.01
    rig.arrive(0x300, bytes(8))
    rig.encoder(1.0, 0)
    rig.encoder(1.0, 0)
    assert rig.driver.wait(deadline)
    assert not rig.driver.wait(deadline)  # a repeated frame is no new sample
    assert rig.clock.t >= deadline
