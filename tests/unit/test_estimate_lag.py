"""A sensor that lags, a low-pass before the relay, samples that clip: what the estimators make of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import expm

from seod.estimate import make_estimator
from seod.estimate.base import Estimate, EstimatorSettings, Row
from seod.estimate.limit_cycle.sensor_lag import first_order
from tests.unit.relay_truth import E_A, K_L, TICK

PLANTS = [(0.21, 117.0), (0.45, 145.0), (0.8, 60.0)]


@dataclass(frozen=True)
class LaggingLoop:
    """The plant of Eq. 1 and a lagging sensor; a sampled relay on low-passed readings, a tick late."""

    zeta: float
    omega_n: float
    lag: float = 0.0
    """Time constant of the sensor [s]."""
    lowpass: float = 0.0
    """Cut-off of the low-pass before the relay [Hz]; 0 for none."""
    hysteresis: float = 0.0

    def rows(self, seconds: float) -> list[Row]:
        w, slow = self.omega_n, self.lag or 1e-9
        a = np.zeros((5, 5))  # position, speed, acceleration, reading, voltage
        a[:4] = [
            [0, 1, 0, 0, 0],
            [0, 0, 1, 0, 0],
            [0, -w * w, -2 * self.zeta * w, 0, K_L * w * w],
            [1 / slow, 0, 0, -1 / slow, 0],
        ]
        move = expm(a * TICK)[:4]
        smoothing = -math.expm1(-2 * math.pi * self.lowpass * TICK) if self.lowpass else 1.0
        state, u, smooth, rows = np.zeros(4), E_A, 0.0, []
        for k in range(int(seconds / TICK)):
            t, y, applied = 7.0 + k * TICK, float(state[3]), u
            smooth += smoothing * (y - smooth)
            if -smooth > self.hysteresis:
                u = E_A
            elif -smooth < -self.hysteresis:
                u = -E_A
            rows.append(Row(t, y, u, t + TICK, 0.0, E_A, 0.0, exciting=True))
            state = move @ np.append(state, applied)
        return rows


def settings(method: str = "exact", **changes: float) -> EstimatorSettings:
    known = {"K_L": K_L, "hysteresis": 0.0, "delay_s": 0.0, "period_s": TICK, "lowpass_hz": None} | changes
    return EstimatorSettings(method=method, cycles=4, **known)  # type: ignore[arg-type]


def answers(rows: list[Row], known: EstimatorSettings) -> list[Estimate]:
    estimator = make_estimator(known)
    return [answer for row in rows if (answer := estimator.update(row)) is not None]


def bias(found: list[Estimate], zeta: float, omega_n: float) -> tuple[float, float]:
    """Relative errors of the mean of the last answers, all ok: single ones wander with the relay's ticks."""
    newest = found[-20:]
    assert {answer.quality for answer in newest} == {"ok"}
    mean_zeta = np.mean([answer.zeta for answer in newest if answer.zeta is not None])
    mean_omega_n = np.mean([answer.omega_n for answer in newest if answer.omega_n is not None])
    return float(mean_zeta) / zeta - 1.0, float(mean_omega_n) / omega_n - 1.0


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
@pytest.mark.parametrize("lag", [0.5e-3, 2e-3])
def test_a_known_lag_of_the_sensor_is_taken_back(zeta: float, omega_n: float, lag: float) -> None:
    rows = LaggingLoop(zeta, omega_n, lag, hysteresis=2e-3).rows(2.0)
    found = answers(rows, settings(lag_s=lag, hysteresis=2e-3))
    assert bias(found, zeta, omega_n) == pytest.approx((0.0, 0.0), abs=4e-3)
    assert found[-1].fitness == pytest.approx(1.0, abs=0.03)
    ignored = bias(answers(rows, settings(hysteresis=2e-3)), zeta, omega_n)
    assert abs(ignored[1]) > 1e-2


def test_a_hysteresis_is_one_of_the_lagging_signal() -> None:
    """The relay turns where the smaller signal crosses it: the motion is further then."""
    rows = LaggingLoop(0.21, 117.0, 4e-3, hysteresis=0.12).rows(2.5)
    found = answers(rows, settings(lag_s=4e-3, hysteresis=0.12))
    assert bias(found, 0.21, 117.0) == pytest.approx((0.0, 0.0), abs=4e-3)


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
@pytest.mark.parametrize("cutoff", [60.0, 200.0])
def test_the_low_pass_before_the_relay_leaves_exact_unbiased(
    zeta: float, omega_n: float, cutoff: float
) -> None:
    """It only turns the relay later, and when the relay turns is measured."""
    found = answers(LaggingLoop(zeta, omega_n, lowpass=cutoff).rows(2.0), settings())
    assert bias(found, zeta, omega_n) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_peaks_tells_how_far_its_low_pass_lags() -> None:
    rows = LaggingLoop(0.21, 117.0).rows(1.0)
    assert answers(rows, settings("peaks"))[-1].delay_s is None
    found = answers(rows, settings("peaks", lowpass_hz=50.0, lag_s=1e-3))[-1]
    w = found.frequency
    assert w is not None
    assert found.delay_s == pytest.approx((math.atan(w / (2 * math.pi * 50.0)) + math.atan(w * 1e-3)) / w)


def test_a_first_order_lag_delays_and_shrinks_a_harmonic() -> None:
    tau, w = 3e-3, 200.0
    response = 1.0 / complex(1.0, w * tau)
    lag = first_order(tau, w)
    assert lag.ratio == pytest.approx(1.0 / abs(response))
    assert lag.delay == pytest.approx(-np.angle(response) / w)
    assert first_order(tau, 1e-6).delay == pytest.approx(tau)


def test_clipped_samples_make_the_answer_saturated_until_they_are_gone() -> None:
    rows = LaggingLoop(0.45, 145.0).rows(2.0)
    clip, half = 0.9 * max(row.y for row in rows[2000:]), len(rows) // 2
    marked = [row._replace(saturated=row.y > clip) if k < half else row for k, row in enumerate(rows)]
    assert answers(marked[:half], settings())[-1].quality == "saturated"
    assert answers(marked, settings())[-1].quality == "ok"
