"""The daemon's own estimators on recordings: what they would have said live, and what that comes to."""

from __future__ import annotations

import math
from collections import Counter
from statistics import fmean
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.special import stdtrit

from seod.estimate import make_estimator
from seod.estimate.advice import INTERVAL, advise
from seod.estimate.base import EstimatorSettings
from seod.identify.answer import Result
from seod.identify.fit import at
from seod.identify.problem import NAMES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.arrays import Array
    from seod.estimate.base import Estimate, Row
    from seod.identify.record import Record

CYCLES: Final = 6
"""Window where no rig file tells it."""
LARGEST_SHARE: Final = 0.9999
"""Of a variance that may be common to all windows: the rest weighs them."""
_ROUNDING: Final = 1e-9


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
    doubtful = [each for each in told if each.quality not in {"ok", "settling"}]
    if not good or len(doubtful) >= len(good):
        last = next(iter((doubtful or told)[-1:]), None)
        word, why = (last.quality, last.advice) if last else ("no_oscillation", "the relay never switches")
        return Result(None, word, f"no answer to be believed: {why}", method=method, answers=counts)
    value, sd = _mean(_apart(good, known.cycles), known)
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
    """Weighted means; standard deviations that hold their scatter, too, and what all windows share."""
    is_wave = apart[0].method == "wave"
    pairs = {
        "omega_n": _of_windows(apart, "omega_n", known),
        "zeta": _of_windows(apart, "zeta", known),
        "delay": (known.delay, 0.0),
        "K_L": (fmean(each.K_L or known.K_L for each in apart), 0.0),
    }
    if is_wave and known.delay_sd > 0.0:
        alone = _weighted([(each.delay_s, each.delay_sd_s) for each in apart])
        newest = apart[0].delay_s or 0.0, apart[0].delay_sd_s or 0.0
        pairs["delay"] = newest if math.isfinite(known.delay_sd) else alone
    if is_wave and known.K_L_sd > 0.0:
        pairs["K_L"] = _weighted([(each.K_L, each.K_L_sd) for each in apart])
    return {name: pair[0] for name, pair in pairs.items()}, {name: pair[1] for name, pair in pairs.items()}


def _of_windows(apart: Sequence[Estimate], name: str, known: Beforehand) -> tuple[float, float]:
    """Mean and standard deviation of omega_n or zeta; nan for a method that states none.

    Where the delay is known somewhat, or learnt by window after window, its error is the same in all: it does
    not average out.
    """
    values = [getattr(each, name) for each in apart]
    sds = [getattr(each, f"{name}_sd") for each in apart]
    if None in sds:
        return fmean(values), math.nan
    shares = [_shared(each, name, known) for each in apart]
    own = [sd * math.sqrt(1.0 - share) for sd, share in zip(sds, shares, strict=True)]
    mean, scatter = _weighted(list(zip(values, own, strict=True)))
    common = min(sd * math.sqrt(share) for sd, share in zip(sds, shares, strict=True))
    return mean, math.hypot(scatter, common)


def _shared(answer: Estimate, name: str, known: Beforehand) -> float:
    """Part of a variance that is what K_L or the delay are known to beforehand."""
    free = [key for key in ("K_L", "delay") if 0.0 < getattr(known, f"{key}_sd") < math.inf]
    if answer.method != "wave":
        return LARGEST_SHARE if free else 0.0
    told = answer.correlation or {}
    return min(sum(told.get(f"{name},{key}", 0.0) ** 2 for key in free), LARGEST_SHARE)


def _weighted(column: Sequence[tuple[float | None, float | None]]) -> tuple[float, float]:
    """Mean and standard deviation of values with theirs, as far as they have one."""
    x, sd = (np.array([float(each or 0.0) for each in part]) for part in zip(*column, strict=True))
    if not (sd > 0.0).all():
        return float(np.mean(x)), _scatter(x)
    weight: Array = sd**-2
    mean = float(weight @ x / weight.sum())
    excess = float(weight @ (x - mean) ** 2) / max(len(x) - 1, 1)
    return mean, math.sqrt(max(excess, 1.0) / float(weight.sum()))


def _scatter(x: Array) -> float:
    """Standard deviation of the mean, so that +-1.96 of it is a 95 % interval; nan of a single value."""
    n = len(x)
    if np.ptp(x) <= _ROUNDING * abs(float(x[0])):
        return 0.0 if n > 1 else math.nan
    return float(np.std(x, ddof=1)) / math.sqrt(n) * float(stdtrit(n - 1, 0.975)) / INTERVAL
