"""Single commands that act later than told: their steps are no noise, and intervals know of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from relay_truth import E_A, K_L, TICK, Loop, rows, settings
from scipy.integrate import solve_ivp

from seod.estimate import make_estimator
from seod.estimate.known import Known
from seod.estimate.plant.free_motion import Dynamics
from seod.estimate.plant.response import StepwiseVoltage
from seod.estimate.wave.fit import fit, fit_late
from seod.estimate.wave.window import Window

if TYPE_CHECKING:
    from seod.estimate.base import Estimate, Row

OMEGA_N, ZETA = 145.0, 0.45


def jittered(seed: int, most: float, noise: float = 0.002) -> list[Row]:
    """Rows whose `t_u` says too early, for each switch by another part of `most` ticks."""
    rng, feed = (
        np.random.default_rng(seed),
        rows(Loop(ZETA, OMEGA_N, 1.5, noise=noise, start=0.2, seed=seed), 0.8),
    )
    early, told, u = 0.0, [], math.nan
    for row in feed:
        if row.u != u:
            early, u = most * TICK * float(rng.random()), row.u
        told.append(row._replace(t_u=row.t_u - early))
    return told


def last(feed: list[Row]) -> Estimate:
    estimator = make_estimator(settings("wave", delay_sd=2.0 * TICK))
    return [each for row in feed if (each := estimator.update(row)) and each.quality == "ok"][-1]


@pytest.mark.slow
def test_intervals_hold_the_truth_where_a_device_looks_once_a_tick():
    z = []
    for seed in range(12):
        answer = last(jittered(seed, 1.0))
        z.append([(answer.omega_n - OMEGA_N) / answer.omega_n_sd, (answer.zeta - ZETA) / answer.zeta_sd])
        assert abs(answer.delay_s - 0.5 * TICK) < 4.0 * answer.delay_sd_s
    assert math.sqrt(np.mean(np.square(z))) < 1.6
    assert np.max(np.abs(z)) < 4.0


def window(late: float, speed: bool = False) -> tuple[Window, float]:
    """Eight switches of which one comes `late` [s]; and the noise's deviation."""
    rng = np.random.default_rng(4)
    t_u = np.cumsum([0.0, *(0.024 + 0.003 * rng.random(8))])
    u = E_A * (-1.0) ** np.arange(9)
    t = np.arange(0.005, t_u[-1] + 0.02, TICK)
    real = t_u.copy()
    real[4] += late

    def slope(at, x):
        drive = u[max(int(np.searchsorted(real, at, side="right")) - 1, 0)]
        return [x[1], x[2], OMEGA_N**2 * (K_L * drive - x[1]) - 2.0 * ZETA * OMEGA_N * x[2]]

    run = solve_ivp(slope, (0.0, t[-1]), [0.0, 0.0, 0.0], t_eval=t, max_step=TICK / 4, rtol=1e-8, atol=1e-10)
    sigma = 1e-4 * (OMEGA_N if speed else 1.0)
    y = run.y[1 if speed else 0] + sigma * rng.standard_normal(len(t))
    return Window(t, y, StepwiseVoltage(t_u, u, t, speed), Known(K_L), Known(0.0, 2.0 * TICK)), sigma


@pytest.mark.parametrize("speed", [False, True])
def test_one_switch_that_comes_late_is_found_out(speed):
    seen, sigma = window(1e-3, speed)
    before = fit(seen, OMEGA_N, ZETA)
    found = fit_late(seen, before)
    assert found.noise < 1.6 * sigma  # linear in 1 ms
    assert found.noise < 0.5 * before.noise
    assert abs(found.omega_n - OMEGA_N) < 3.0 * found.sd("omega_n")
    assert abs(found.zeta - ZETA) < 3.0 * found.sd("zeta")


def test_where_all_come_as_told_nothing_of_the_kind_is_found():
    seen, _ = window(0.0)
    assert fit_late(seen, fit(seen, OMEGA_N, ZETA)) is None


@pytest.mark.parametrize("speed", [False, True])
def test_derivatives_by_single_times_are_differences(speed):
    plant = Dynamics(117.0, 0.3, 1e-3)
    t_u, u = np.array([0.0, 0.01, 0.03, 0.05]), np.array([1.0, -1.0, 1.0, -0.5])
    t, step = np.arange(0.005, 0.08, TICK) + 1e-5, 1e-7

    def output(moved: int, by: float) -> np.ndarray:
        return StepwiseVoltage(t_u + by * (np.arange(4) == moved), u, t, speed).output(plant)

    slopes = StepwiseVoltage(t_u, u, t, speed).by_times(plant, slice(1, 4))
    for k in (1, 2, 3):
        difference = (output(k, step) - output(k, -step)) / (2.0 * step)
        assert slopes[k - 1] == pytest.approx(difference, abs=2e-4 * np.max(np.abs(slopes)))
