"""A load that grows with time: told of one run of a recording, where thirds that no fit saw are foretold."""

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import recording
from scipy.signal import detrend

from seod.diagnose.causes.scales import Scales
from seod.diagnose.extend.model import Model
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.load_drift import drifting_load
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut
from seod.diagnose.verdict.remarks import other_zeros

RATE, LASTS, SUBSTEPS = 200, 24.0, 8
K_L, LAG, FRICTION, LOAD, DRIFT = 0.17, 2.1, 0.2, -0.03, 1.2e-3
SIZES = Scales(4.0, 0.1, 1.0, 0.1, 0.2, 0.05, 84.0, LASTS, 1.0 / RATE)
NUMBERS = {
    "K_L": K_L,
    "omega_n": 40.0 * LAG,
    "zeta": 20.0,
    "coulomb_friction.level": FRICTION,
    "load_bias.acceleration": LOAD,
}


def slide(drift: float, gusts: np.ndarray, period: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Command and position of a slide under a loop: a lag, dry friction, a load. Written apart."""
    rows = len(gusts)
    phase = (np.arange(rows + 1) / RATE / period) % 1.0
    wanted = 0.2 * np.interp(phase, [0.0, 0.4, 0.5, 0.9, 1.0], [0.0, 1.0, 1.0, 0.0, 0.0])
    step, y, v = 1.0 / RATE / SUBSTEPS, 0.0, 0.0
    u, seen = np.empty(rows), np.empty(rows)
    for k in range(rows):
        seen[k] = y
        u[k] = 60.0 * (wanted[k] - y) + 3.0 * ((wanted[k + 1] - wanted[k]) * RATE - v)
        load = LOAD + drift * k / RATE + gusts[k]
        for _ in range(SUBSTEPS):
            force = LAG * (K_L * u[k] - v) - load
            if v == 0.0 and abs(force) <= FRICTION:
                continue
            against = math.copysign(1.0, v or force)
            after = v + step * (force - FRICTION * against)
            after = 0.0 if v * after < 0.0 else after
            y += 0.5 * step * (v + after)
            v = after
    return u, seen


def gusts(size: float, seed: int, lasts: float = LASTS, *, trend: bool = False) -> np.ndarray:
    """A random force with a memory of 0.2 s, with what trend it happens to have or without."""
    rng, rows, kept = np.random.default_rng(seed), int(lasts * RATE), float(np.exp(-5.0 / RATE))
    out, now = np.empty(rows), 0.0
    for k in range(rows):
        now = kept * now + size * np.sqrt(1.0 - kept**2) * rng.standard_normal()
        out[k] = now
    return out if trend else detrend(out)


def found(u: np.ndarray, y: np.ndarray):
    """The right causes, fitted to one run, and the recording."""
    read = replace(recording(u, y, noise=1e-4), t=np.arange(len(u)) / RATE)
    one = series(read, np.zeros(len(u), np.bool_), sees_speed=False)
    model = baseline_model(SIZES, 1.0, False, {}).with_effect("coulomb_friction").with_effect("load_bias")
    whole = Cut([one], ((0, 0, len(one.t)),))
    x = model.searched(NUMBERS)
    return fit(model, whole, x, begun_states(model, x, whole), most=12), one


@pytest.mark.slow
def test_a_load_that_grows_is_found_with_its_size_and_foretells_thirds_that_no_fit_saw():
    begun, one = found(*slide(DRIFT, gusts(0.005, 1)))
    told = drifting_load(begun, [one], map, lambda: False)
    assert told is not None
    values = told.fitted.model.values(told.fitted.x)
    assert values["load_bias.drift"] == pytest.approx(DRIFT, rel=0.15)
    assert values["load_bias.acceleration"] == pytest.approx(LOAD, abs=0.005)
    assert told.with_it < 0.6 * told.without


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gusts_alone_are_no_drift(seed):
    begun, one = found(*slide(0.0, gusts(0.05, seed)))
    assert drifting_load(begun, [one], map, lambda: False) is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 8])
def test_gusts_with_a_trend_bend_each_third_their_own_way(seed):
    """Of twelve such slides these two had thirds that a drift foretold."""
    begun, one = found(*slide(0.0, gusts(0.05, seed, trend=True)))
    assert drifting_load(begun, [one], map, lambda: False) is None


@pytest.mark.slow
def test_nothing_is_told_once_the_work_is_used_or_under_a_sweep():
    begun, one = found(*slide(DRIFT, gusts(0.0, 1)))
    assert drifting_load(begun, [one], map, lambda: True) is None
    t = one.t
    swept = replace(one, u=np.sin(t * t))
    assert drifting_load(begun, [swept], map, lambda: False) is None


def test_a_recording_with_another_zero_is_told_but_no_other():
    rng = np.random.default_rng(4)
    y = np.sin(0.05 * np.arange(2000.0))
    read = recording(y, y, noise=0.0)
    one = series(read, np.zeros(2000, np.bool_), sees_speed=True)
    near = y + 0.02 * rng.standard_normal(2000)
    (said,) = other_zeros([one, one, one], [near, near + 0.1, near], seen=1)
    assert said.startswith("held-out recording 1: one run is off by 14 % of y's deviation")
    assert "a constant of 14 %" in said
    assert said.endswith("But for that 2.8 % is left")
    assert other_zeros([one, one], [near + 0.1, near], seen=1) == []
    placed = series(read, np.zeros(2000, np.bool_), sees_speed=False)
    assert other_zeros([placed], [near + 0.1], seen=0) == [], "a position's run begins where it is fitted"


def test_a_rig_file_has_the_mean_load_of_the_recording():
    """It runs for hours: a load that went on growing would push it to its end."""
    load = {"load_bias": {"acceleration": 1.0, "drift": 0.2}, "load_spring": {"stiffness": 3.0}}
    drifting = Model(1.0, 50.0, 0.3, load)
    told = drifting.steady(10.0).effects
    assert told == {"load_bias": {"acceleration": 2.0}, "load_spring": {"stiffness": 3.0}}
    plain = Model(1.0, 50.0, 0.3, {"load_spring": {"stiffness": 3.0}})
    assert plain.steady(10.0) is plain
