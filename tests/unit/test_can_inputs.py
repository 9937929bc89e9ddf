"""What arrives at the CAN driver: frames, their order and times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base import NO_SAMPLE
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


def test_lost_repeated_and_reordered_frames_are_told_apart(rig: Rig) -> None:
    for value, counter in enumerate([10, 11, 14, 14, 13, 15]):
        rig.encoder(value, counter)
    assert rig.angle() == pytest.approx(5)
    assert (rig.count("lost"), rig.count("repeated"), rig.count("reordered")) == (2, 1, 1)
    assert rig.count("frames_received") == 4


def test_an_older_frame_never_replaces_a_newer_one(rig: Rig) -> None:
    rig.encoder(1.0, 255)
    rig.encoder(2.0, 0)
    rig.encoder(1.0, 255)
    assert rig.angle() == pytest.approx(2.0)
    assert rig.count("reordered") == 1


@settings(max_examples=40)
@given(st.lists(st.sampled_from(["next", "skip", "repeat", "back"]), max_size=60))
def test_the_sequence_check_against_a_plain_count(steps: list[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        rig = Rig(patch)
        newest, wanted = 1000, {"lost": 0, "repeated": 0, "reordered": 0}
        rig.encoder(0.0, newest)
        for step in steps:
            sent = newest + {"next": 1, "skip": 5, "repeat": 0, "back": -3}[step]
            name = {"skip": "lost", "repeat": "repeated", "back": "reordered"}.get(step)
            if name:
                wanted[name] += 4 if step == "skip" else 1
            newest = max(newest, sent)
            rig.encoder(float(sent - 1000), sent)
        assert rig.angle() == pytest.approx(newest - 1000)
        assert {name: rig.count(name) for name in wanted} == wanted
        rig.driver.close()


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
