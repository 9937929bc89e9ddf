"""The daemon's own estimators on recordings: what they would have said live, and what that comes to."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.estimate import make_estimator
from seod.estimate.advice import advise
from seod.estimate.base import EstimatorSettings
from seod.identify.answer import Result
from seod.identify.fit import at
from seod.identify.problem import NAMES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.base import Estimate, Row
    from seod.estimate.limit_cycle import Array
    from seod.identify.record import Record

CYCLES: Final = 6
"""Window where no rig file tells it."""


class Beforehand(NamedTuple):
    """What the estimators need to know, by options or rig file.

    Attributes:
        K_L: [unit/s/V]
        K_L_sd: inf where it is a first guess only.
        delay: [s]
        delay_sd: inf where it is a first guess only.
        hysteresis: Half-width of the relay's [unit].
        cycles: Window.
    """

    K_L: float
    K_L_sd: float = 0.0
    delay: float = 0.0
    delay_sd: float = 0.0
    hysteresis: float = 0.0
    cycles: int = CYCLES


def answers(rows: Sequence[Row], record: Record, method: str, known: Beforehand) -> list[Estimate]:
    """All estimates that the daemon would have told."""
    settings = EstimatorSettings(
        method=method,
        K_L=known.K_L,
        hysteresis=known.hysteresis,
        delay_s=known.delay,
        period_s=record.tick,
        cycles=known.cycles,
        lowpass_hz=None,
        K_L_sd=known.K_L_sd,
        delay_sd=known.delay_sd,
        integrated=record.output == "velocity",
    )
    estimator = make_estimator(settings)
    found = [estimator.update(row) for row in rows]
    return [each for each in found if each is not None]


def summary(records: Sequence[Record], told: Sequence[Estimate], method: str, known: Beforehand) -> Result:
    """One answer of many: the mean of windows that share no sample, by their weights."""
    counts = dict(Counter(each.quality for each in told).most_common())
    good = [each for each in told if each.quality == "ok" and each.zeta and each.omega_n]
    apart = _apart(good, known.cycles)
    if not apart:
        word = told[-1].quality if told else "no_oscillation"
        message = f"no answer to be believed: {told[-1].advice if told else 'the relay never switches'}"
        return Result(None, word, message, method=method, answers=counts)
    value, sd = _mean(apart, known)
    fit = at(records, value, np.diag([sd[name] ** 2 for name in NAMES]))
    return Result(fit, "ok", advice=advise(value, sd), method=method, answers=counts)


def _apart(good: Sequence[Estimate], cycles: int) -> list[Estimate]:
    """Those whose windows do not overlap, the newest first."""
    chosen: list[Estimate] = []
    for each in reversed(good):
        span = cycles * 2.0 * math.pi / (each.frequency or math.inf)
        if not chosen or each.t <= chosen[-1].t - span:
            chosen.append(each)
    return chosen


def _mean(apart: Sequence[Estimate], known: Beforehand) -> tuple[dict[str, float], dict[str, float]]:
    """Weighted means; standard deviations that hold their scatter, too."""
    is_free = known.delay_sd > 0.0 and apart[0].method == "wave"
    columns = {
        "omega_n": [(each.omega_n, each.omega_n_sd) for each in apart],
        "zeta": [(each.zeta, each.zeta_sd) for each in apart],
        "delay": [(each.delay_s, None) for each in apart] if is_free else [(known.delay, 0.0)],
        "K_L": [(each.K_L, each.K_L_sd or 0.0) for each in apart],
    }
    pairs = {name: _weighted([(x or 0.0, sd or 0.0) for x, sd in column]) for name, column in columns.items()}
    return {name: pair[0] for name, pair in pairs.items()}, {name: pair[1] for name, pair in pairs.items()}


def _weighted(column: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean and standard deviation of values with theirs."""
    x, sd = (np.array(each) for each in zip(*column, strict=True))
    if not (sd > 0.0).all():
        scatter = float(np.std(x, ddof=1)) / math.sqrt(len(x)) if len(x) > 1 else 0.0
        return float(np.mean(x)), scatter
    weight: Array = sd**-2
    mean = float(weight @ x / weight.sum())
    excess = float(weight @ (x - mean) ** 2) / max(len(x) - 1, 1)
    return mean, math.sqrt(max(excess, 1.0) / float(weight.sum()))
