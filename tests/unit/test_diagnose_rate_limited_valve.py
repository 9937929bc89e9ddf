"""A valve of limited speed under a relay, which two linear causes come near: each is told as what it is."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plant_truth import PLACE, Plant
from relay_records import NOISE, TICK, TRUTH, VOLTS, N, T, grid_once
from scipy.linalg import expm

from seod.data import Recording
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments, sparse

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _same_grids(monkeypatch):
    monkeypatch.setattr("seod.diagnose.search.screen.grid_plants", grid_once)


RATE = 60.0
SUBTICKS = 20
CAUSES = {"valve_lag": {"time": 0.0015}, "load_resonance": {"inertia": 0.1, "omega": 190.0, "zeta": 0.08}}
"""So small that a slow valve leaves but 1.02 times the noise of them."""


class SlowValve:
    """Eq. 1 behind a valve no faster than `rate`, by exact transitions of twentieths of a tick."""

    truth, rate = TRUTH, RATE

    def __init__(self):
        square, self.dt = self.truth["omega_n"] ** 2, TICK / SUBTICKS
        slope = np.zeros((4, 4))  # position, speed, acceleration, where the valve is
        slope[0, 1] = slope[1, 2] = 1.0
        slope[2, 1:] = -square, -2.0 * self.truth["zeta"] * self.truth["omega_n"], self.truth["K_L"] * square
        self.step, self.w, self.valve = expm(slope * self.dt), np.zeros(4), 0.0

    def follow(self, u):
        """One tick."""
        for _ in range(SUBTICKS):
            before, most = self.valve, self.rate * self.dt
            self.valve += min(max(u - self.valve, -most), most)
            self.w[3] = 0.5 * (before + self.valve)
            self.w = self.step @ self.w

    @property
    def place(self):
        return self.w[0]


class Lightly(SlowValve):
    """Ramps of four tenths of the limit cycle; once steady it looks like shorter ones of another plant."""

    truth, rate = {"K_L": 11.0, "omega_n": 97.0, "zeta": 0.137}, 59.8


class TwoCauses:
    """A lag of the valve and a swinging load."""

    def __init__(self):
        self.plant, self.t = Plant(*TRUTH.values(), CAUSES), 0.0

    def follow(self, u):
        self.plant.command(u)
        self.t += TICK
        self.plant.advance(self.t)

    @property
    def place(self):
        return self.plant.w[PLACE]


@cache
def relayed(kind):
    """A recording of a plant under a relay."""
    plant, y, u = kind(), np.empty(N), np.empty(N)
    for k in range(N):
        y[k] = plant.place
        u[k] = -VOLTS if y[k] > 0.0 else VOLTS
        plant.follow(u[k])
    y = y + np.random.default_rng(4).normal(0.0, NOISE * np.std(y), N)
    rows = np.arange(1, N + 1)
    return Recording((Path("relay.csv"),), T, u, y, None, None, None, rows, {}, {}, ())


@pytest.mark.parametrize("kind", [SlowValve, Lightly])
def test_the_grid_has_the_plant_behind_a_slow_valve(kind):
    few = sparse(segments(cut([series(relayed(kind))])[0]))
    slow = [plant for plant in grid_once(few) if "valve_rate_limit" in plant.causes]
    numbers = [(one.sizes["valve_rate_limit.rate"], one.K_L, one.omega_n, one.zeta) for one in slow]
    truth = pytest.approx((kind.rate, *kind.truth.values()), rel=0.05)
    assert any(each == truth for each in numbers), numbers


@pytest.mark.parametrize("kind", [SlowValve, Lightly])
def test_a_slow_valve_is_named(kind):
    told = diagnose([relayed(kind)], (), Options(effort="quick"))
    (found,) = told.effects
    assert (told.verdict, found.name) == ("effects", "valve_rate_limit")
    assert found.parameters["rate"].value == pytest.approx(kind.rate, rel=0.01)
    plant = told.extended
    assert (plant.K_L, plant.omega_n, plant.zeta) == pytest.approx(tuple(kind.truth.values()), rel=0.03)


def test_two_causes_that_come_near_are_no_slow_valve():
    assert "valve_rate_limit" not in {each.name for each in diagnose([relayed(TwoCauses)]).effects}
