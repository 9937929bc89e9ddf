"""A valve of limited speed under a relay, which two linear causes come near."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from diagnose_models import sized_model
from plant_truth import PLACE, Plant
from relay_records import NOISE, TICK, TRUTH, VOLTS, N, T
from scipy.linalg import expm

from seod.data import Recording
from seod.diagnose import command
from seod.diagnose.choose import Choice
from seod.diagnose.command import diagnose
from seod.diagnose.coordinates import Scales
from seod.diagnose.fit import fit
from seod.diagnose.judge import Judged
from seod.diagnose.ramped import ramped_instead, with_ramps
from seod.diagnose.select import Grown
from seod.diagnose.states import simulated_states
from seod.diagnose.windows import cut, pieces, series

pytestmark = pytest.mark.slow

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
            self.valve += np.clip(u - self.valve, -most, most)
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


def fitted(recording, *names):
    """Causes, fitted from the values of `CAUSES`."""
    one = series(recording)
    every = pieces(cut([one])[0])
    model = sized_model(one, Scales(VOLTS, 10.0, 600.0, 0.0, 1.0, 0.5, 100.0, 8.0, TICK), TRUTH, names)
    values = {f"{name}.{of}": value for name in names for of, value in CAUSES[name].items()}
    x = model.searched(TRUTH | values)
    return fit(model, every, x, simulated_states(model, x, every))


@pytest.mark.parametrize("kind", [SlowValve, Lightly])
def test_a_slow_valve_is_told_from_two_causes_that_come_near(kind):
    found = ramped_instead(fitted(relayed(kind), *CAUSES), sees_speed=False)
    assert found is not None
    assert found.rate == pytest.approx(kind.rate, rel=0.01)
    values = found.found.model.values(found.found.x)
    assert values == pytest.approx(kind.truth, rel=0.03)
    assert f"{found.rate:.4g} V/s" in found.said


@pytest.mark.parametrize(
    ("kind", "names"),
    [(TwoCauses, tuple(CAUSES)), (SlowValve, ("valve_lag",)), (SlowValve, ())],
    ids=["it is the two", "one cause alone", "none"],
)
def test_what_needs_no_more_numbers_stays(kind, names):
    assert ramped_instead(fitted(relayed(kind), *names), sees_speed=False) is None


@pytest.mark.parametrize("rate", [100.0, 5.0], ids=["they end", "they turn before"])
def test_steps_stand_for_ramps(rate):
    levels = np.repeat([1.0, -1.0, 2.0, 0.5], N // 4)
    (ramped,) = with_ramps([replace(series(relayed(SlowValve)), u=levels, t_u=0.1 * T)], rate)
    dt, valve = 1e-5, np.zeros(80000)
    for k, level in enumerate(np.repeat([1.0, -1.0, 2.0, 0.5], 20000)[:-1]):
        valve[k + 1] = valve[k] + np.clip(level - valve[k], -rate * dt, rate * dt)
    seen = ramped.u[np.searchsorted(ramped.t_u, np.arange(80000) * dt + 1e-9) - 1]
    assert np.max(np.abs(seen - valve)) < 0.6 * 3.0 / 16.0
    assert abs(np.mean(seen - valve)) < 2e-4


def test_what_a_slow_valve_explains_is_no_cause_of_the_list(monkeypatch):
    near, asked = fitted(relayed(SlowValve), *CAUSES), []
    monkeypatch.setattr(command, "grow", lambda _, roots, *__: Grown(list(roots[:1])))
    monkeypatch.setattr(command, "choose", lambda base, *_: Choice(base, Judged.of(near, base.held.cut), {}))
    monkeypatch.setattr(command, "found_effects", lambda chosen, *_: asked.append(chosen.found) or ())
    told = diagnose([relayed(SlowValve)])
    assert told.verdict == "unexplained"
    assert [found.model.names for found in asked] == [()]
    assert any("V/s, which is not on the list" in remark for remark in told.remarks)
