"""Pacers: deadlines are absolute, missed ones are skipped, simulated time waits for its reader."""

from __future__ import annotations

import threading

import pytest

from seod.loop import pacer as module
from seod.loop.pacer import SensorPacer, SimulatedPacer, TimerPacer
from seod.processes.ring import Shared, Word


class FakeTime:
    """A clock that only sleeping moves, with a delay on waking."""

    def __init__(self) -> None:
        self.now = 100.0
        self.late = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + self.late


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    fake = FakeTime()
    monkeypatch.setattr(module, "time", fake)
    return fake


def test_deadlines_do_not_drift(clock: FakeTime) -> None:
    pacer = TimerPacer(1e-3)
    clock.late = 2e-4
    for k in range(1, 1001):
        assert pacer.next() == pytest.approx(100.0 + k * 1e-3 + 2e-4, abs=1e-9)
        assert pacer.lateness == pytest.approx(2e-4, abs=1e-9)


def test_missed_deadlines_are_skipped_not_made_up(clock: FakeTime) -> None:
    pacer = TimerPacer(1e-3)
    pacer.next()
    clock.now += 5.5e-3  # a tick that took far too long
    pacer.next()
    assert pacer.lateness == pytest.approx(4.5e-3)
    pacer.next()
    assert clock.now == pytest.approx(100.0 + 7e-3)
    assert pacer.lateness == pytest.approx(0.0, abs=1e-9)


def test_a_loop_that_cannot_keep_its_rate_gives_way_and_recovers(clock: FakeTime) -> None:
    pacer = TimerPacer(1e-3)
    began, work, ticks = clock.now, 1.5e-3, 1000
    for _ in range(ticks):
        pacer.next()
        clock.now += work  # each tick takes longer than its period
    slept = clock.now - began - ticks * work
    assert slept > 0.3 * ticks * work
    pacer.next()
    assert pacer.lateness > 1e-3  # and it is told as late
    for _ in range(300):
        pacer.next()
    assert pacer.lateness == pytest.approx(0.0, abs=1e-9)


def test_sensor_pacer_ticks_without_a_sample_too(clock: FakeTime) -> None:
    class Silent:
        def wait(self, deadline: float) -> bool:
            clock.now = deadline
            return False

    pacer = SensorPacer(Silent(), 1e-3)  # type: ignore[arg-type] # only wait is used
    pacer.next()
    assert clock.now == pytest.approx(100.002)
    assert pacer.lateness == pytest.approx(1e-3)


def test_simulated_time_waits_for_its_reader() -> None:
    shared = Shared(1, 64)
    pacer = SimulatedPacer(0.5, shared)
    start = pacer.now()
    shared.row_ring.head[0] = 40  # more than half of the ring unread
    done = threading.Event()

    def step() -> None:
        pacer.next()
        done.set()

    thread = threading.Thread(target=step)
    thread.start()
    assert not done.wait(0.05)
    shared.words[Word.CONSUMED] = 40
    assert done.wait(10.0)
    thread.join()
    assert pacer.now() == start + 0.5
    shared.close()
