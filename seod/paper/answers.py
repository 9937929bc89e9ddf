"""What the daemon's estimators say to a relay run, one beside the other, with intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.base import UNTOLD_PERIODS
from seod.estimate import make_estimator
from seod.estimate.base import EstimatorSettings, Row
from seod.paper.bench import ENTRY_S, TICK_S

if TYPE_CHECKING:
    from seod.estimate.base import Estimate
    from seod.paper.bench import Bench, Run

SURE: Final = 1.96
"""Standard deviations of a 95 % interval."""

Answer = dict[str, Any]


def rows(run: Run, velocity: bool) -> list[Row]:
    """A run as the rows that estimators are fed with."""
    y = run.area if velocity else run.y
    exciting = run.t >= ENTRY_S
    speed = run.y if velocity else np.full(len(run.t), math.nan)
    reference = np.zeros(len(run.t)) if velocity else run.reference
    columns = (run.t, y, run.u, run.t, reference, run.bias, exciting, run.K_L, speed)
    return [
        Row(t, y, u, t_u, wish, run.e_a, bias, on, K_L=K_L, speed=v)
        for t, y, u, t_u, wish, bias, on, K_L, v in zip(*(c.tolist() for c in columns), strict=True)
    ]


def estimates(bench: Bench, run: Run, method: str, hysteresis: float) -> list[Estimate]:
    """All answers of one method, as they would have come live."""
    axis = bench.view.axis
    settings = EstimatorSettings(
        method=method,
        K_L=float(run.K_L[0]),
        hysteresis=hysteresis,
        delay_s=bench.delay,
        period_s=TICK_S,
        cycles=axis.estimator.cycles,
        lowpass_hz=None,
        lag_s=bench.lag,
        delay_sd=UNTOLD_PERIODS * TICK_S,
        integrated=bench.velocity,
    )
    estimator = make_estimator(settings)
    found = [estimator.update(row) for row in rows(run, bench.velocity)]
    return [each for each in found if each is not None]


def answer(bench: Bench, run: Run, method: str, hysteresis: float) -> Answer:
    """The median of a steady run's answers: values, half widths of 95 % intervals, quality."""
    told = [each for each in estimates(bench, run, method, hysteresis) if each.zeta is not None]
    late = told[len(told) // 3 :]
    if not late:
        return {"zeta": None, "omega_n": None, "quality": "no_oscillation"}
    found: Answer = {"quality": max({e.quality for e in late}, key=[e.quality for e in late].count)}
    for name in ("zeta", "omega_n", "K_L"):
        found |= _middle(late, name)
    for name in ("frequency", "amplitude", "misfit"):
        values = [getattr(each, name) for each in late if getattr(each, name) is not None]
        found[name] = float(np.median(values)) if values else None
    return found


def _middle(told: list[Estimate], name: str) -> Answer:
    values = [getattr(each, name) for each in told if getattr(each, name) is not None]
    sds = [getattr(each, f"{name}_sd") for each in told if getattr(each, f"{name}_sd") is not None]
    return {
        name: float(np.median(values)) if values else None,
        f"{name}_95": SURE * float(np.median(sds)) if sds else None,
    }
