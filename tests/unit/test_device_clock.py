"""A board's clock on the loop's clock: simulated boards whose true times are known."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import pytest

from drivers.device_clock import WRAP, DeviceClock

PERIOD_S = 2e-3


@dataclass
class Line:
    """A line with latencies, and a board whose clock is fast by `drift` and wraps after five seconds."""

    drift: float = 0.0
    there_s: float = 80e-6
    back_s: float = 80e-6
    jitter_s: float = 50e-6
    acknowledges: bool = True
    start_us: int = WRAP - 5_000_000

    def __post_init__(self) -> None:
        self.random = Random(7)
        self.clock = DeviceClock()

    def us(self, t: float) -> int:
        return (self.start_us + int((t - 100.0) * (1.0 + self.drift) * 1e6)) % WRAP

    def delay(self, least: float) -> float:
        stalled = 4e-3 if self.random.random() < 0.01 else 0.0
        return least + self.random.expovariate(1.0 / self.jitter_s) + stalled

    def run(self, first: float, last: float) -> list[float]:
        """Errors of the samples' times [s]."""
        errors, t = [], first
        while t < last:
            taken = self.clock.heard(self.us(t), t + self.delay(self.back_s))
            if self.acknowledges:
                set_at = t - 3e-4
                self.clock.acknowledged(self.us(set_at), set_at - self.delay(self.there_s))
            errors.append(taken - t)
            t += PERIOD_S
        return errors


def worst(errors: list[float]) -> float:
    return max(map(abs, errors))


@pytest.mark.parametrize("drift", [0.0, 1e-4, -5e-3])
def test_with_acknowledgements_the_latency_of_the_line_is_known(drift: float) -> None:
    line = Line(drift)
    line.run(100.0, 104.0)
    assert worst(line.run(104.0, 110.0)) < 5e-6
    assert line.clock.drift == pytest.approx(-drift / (1.0 + drift), abs=2e-6)
    assert line.clock.resets == 0


@pytest.mark.parametrize("drift", [0.0, 1e-4])
def test_without_the_times_are_late_by_the_shortest_latency(drift: float) -> None:
    line = Line(drift, acknowledges=False)
    line.run(100.0, 104.0)
    assert all(75e-6 < error < 90e-6 for error in line.run(104.0, 110.0))


def test_a_one_sided_latency_costs_half_its_difference() -> None:
    line = Line(there_s=100e-6, back_s=300e-6)
    line.run(100.0, 104.0)
    assert all(90e-6 < error < 110e-6 for error in line.run(104.0, 106.0))


def test_no_sample_is_from_the_future() -> None:
    line = Line()
    for t in (100.0, 100.1, 100.2):
        assert line.clock.heard(line.us(t), t + 1e-4) <= t + 1e-4


def test_a_pause_of_the_reader_is_no_reset() -> None:
    line = Line()
    line.run(100.0, 103.0)
    behind = [line.clock.heard(line.us(103.0 + k * PERIOD_S), 104.0) for k in range(500)]
    assert max(abs(t - 103.0 - k * PERIOD_S) for k, t in enumerate(behind)) < 20e-6
    assert line.clock.resets == 0


def test_a_clock_that_is_set_anew_is_followed_and_counted() -> None:
    line = Line()
    line.run(100.0, 103.0)
    line.start_us += 3_000_000_000
    errors = line.run(103.0, 106.0)
    assert line.clock.resets == 1
    assert worst(errors[1000:]) < 20e-6


def test_a_restart_forgets_the_old_clock() -> None:
    line = Line()
    line.run(100.0, 103.0)
    line.clock.restart()
    line.start_us = 1234
    assert worst(line.run(103.0, 106.0)[1000:]) < 20e-6
    assert line.clock.resets == 0
