"""What recordings say, in the form of a person's and a program's answer, and what they cannot say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

from seod.estimate.advice import Advice, advise, as_json
from seod.identify.fit import NAMES, ZETA_RANGE, Fit, Given, fit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.identify.record import Record

_FIRST_ORDER: Final = 20.0
"""A zeta at which nothing but a first-order lag of 2 zeta / omega_n is left."""
_AS_WELL: Final = 1.25
"""Ratio of errors up to which a wrong model's residual decides nothing."""
_CHI_SQUARE: Final = 9.0
"""Of one degree of freedom: three standard deviations, where what is left is noise."""
_UNSURE: Final = 0.1
"""Relative standard deviation above which a value is not told."""
_POOR: Final = 0.3
"""nrmse above which it is another plant, not noise."""
_TIED: Final = 0.98
"""Correlation from which on two values are told only together."""
_UNITS: Final = {"omega_n": "rad/s", "zeta": "", "delay": "s", "K_L": "unit/s/V"}


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another plant that explains the recordings as well."""

    what: str
    fit: Fit


@dataclass(frozen=True, slots=True)
class Result:
    """The answer.

    Attributes:
        fit: The best plant.
        quality: `ok`, or why not: `ambiguous`, `noisy`, `nonlinear`, `out_of_range`, `no_fit`.
        unknown: What the recordings cannot tell, in sentences.
        alternatives: Plants that explain them as well.
        advice: For the position controller; None where the answer is not `ok`.
    """

    fit: Fit
    quality: str
    unknown: tuple[str, ...]
    alternatives: tuple[Alternative, ...]
    advice: Advice | None

    def as_json(self) -> dict[str, Any]:
        """Values with standard deviations, quality word, nrmse and what else there is."""
        value, sd = self.fit.value, self.fit.sd
        told: dict[str, Any] = {name: {"value": value[name], "sd": sd[name]} for name in NAMES}
        return told | {
            "quality": self.quality,
            "method": "output_error",
            "nrmse": self.fit.nrmse,
            "correlation": correlations(self.fit),
            "rejected": self.fit.rejected,
            "unknown": list(self.unknown),
            "alternatives": [
                {"what": each.what, **each.fit.value, "nrmse": each.fit.nrmse} for each in self.alternatives
            ],
            "advice": None if self.advice is None else as_json(self.advice),
        }


def identify(records: Sequence[Record], K_L: float | None = None, delay: float | None = None) -> Result:
    """Identify the plant of one or several recordings.

    Args:
        records: At least one.
        K_L: Gain [unit/s/V] if it is known; None: free.
        delay: Beyond the recordings' own times [s] if it is known; None: free.
    """
    best = fit(records, Given(K_L, delay))
    alternatives = _alternatives(records, K_L, delay, best)
    unknown = [*_unsure(best), *_tied(best), *(_told(each, best) for each in alternatives)]
    value = best.value | {"K_L": abs(best.value["K_L"])}
    quality = _quality(best, alternatives)
    advice = advise(value, best.sd) if quality == "ok" else None
    return Result(best, quality, tuple(unknown), tuple(alternatives), advice)


def correlations(best: Fit) -> dict[str, float]:
    """Of each pair of values that were estimated."""
    sd, table = best.sd, best.covariance
    pairs = combinations([(k, name) for k, name in enumerate(NAMES) if sd[name] > 0.0], 2)
    return {f"{a},{b}": round(float(table[i, j] / (sd[a] * sd[b])), 4) for (i, a), (j, b) in pairs}


def _alternatives(
    records: Sequence[Record], K_L: float | None, delay: float | None, best: Fit
) -> list[Alternative]:
    """Tried only where the best fit leaves it open: with a delay free, and near a first-order lag."""
    found = []
    if delay is None and abs(best.value["delay"]) > 3.0 * best.sd["delay"]:
        slower = best.plant._replace(zeta=min(best.value["zeta"], 1.5), delay=0.0)
        found.append(Alternative("without delay", fit(records, Given(K_L, 0.0), slower)))
    if best.value["zeta"] > 2.0:
        lag = 2.0 * best.value["zeta"] / best.value["omega_n"]
        start = best.plant._replace(omega_n=2.0 * _FIRST_ORDER / lag, zeta=_FIRST_ORDER)
        first_order = fit(records, Given(K_L, delay, _FIRST_ORDER), start)
        found.append(Alternative("as a first-order lag", first_order))
    return [each for each in found if _as_well(each.fit, best)]


def _as_well(other: Fit, best: Fit) -> bool:
    """Noise decides by likelihood; a residual that is none decides only where the errors differ much."""
    if best.white:
        count = sum(len(left) for left in best.residual)
        return (other.nrmse**2 / best.nrmse**2 - 1.0) * count < _CHI_SQUARE
    return other.nrmse < _AS_WELL * best.nrmse


def _told(other: Alternative, best: Fit) -> str:
    value = other.fit.value
    errors = f"error {100 * other.fit.nrmse:.2f} % instead of {100 * best.nrmse:.2f} %"
    if other.what == "without delay":
        return (
            f"without delay omega_n {value['omega_n']:.4g} rad/s, zeta {value['zeta']:.4g} explain the data "
            f"nearly as well ({errors}): zeta and delay cannot be told apart; "
            f"give the delay if you know it (--delay)"
        )
    lag = 2.0 * value["zeta"] / value["omega_n"]
    return (
        f"a first-order lag of {1000 * lag:.3g} ms with {1000 * value['delay']:.3g} ms delay explains "
        f"the data as well ({errors}): omega_n and zeta cannot be told apart, only 2 zeta / omega_n"
    )


def _unsure(best: Fit) -> list[str]:
    """Values whose deviation is a large part of them; for the delay, of the time 1 / omega_n."""
    sizes = best.value | {"delay": 1.0 / best.value["omega_n"]}
    return [
        f"{name} is hardly told: {best.value[name]:.4g} +- {1.96 * best.sd[name]:.2g} {_UNITS[name]}".rstrip()
        for name in NAMES
        if best.sd[name] > _UNSURE * abs(sizes[name])
    ]


def _tied(best: Fit) -> list[str]:
    sd = best.sd
    out = []
    for pair, correlation in correlations(best).items():
        a, b = pair.split(",")
        if abs(correlation) > _TIED:
            way = "with" if correlation > 0.0 else "against"
            out.append(
                f"{a} and {b} are told only together (correlation {correlation:.3f}): "
                f"{sd[a]:.2g} {_UNITS[a]} more of {a} goes {way} {sd[b]:.2g} {_UNITS[b]} of {b}"
            )
    return out


def _quality(best: Fit, alternatives: Sequence[Alternative]) -> str:
    value, sd = best.value, best.sd
    if not all(math.isfinite(x) for x in (*value.values(), *sd.values())) or best.nrmse >= 1.0:
        return "no_fit"
    if not 1.1 * ZETA_RANGE[0] < value["zeta"] < 0.9 * ZETA_RANGE[1]:
        return "out_of_range"
    if best.nrmse > _POOR and not best.white:
        return "nonlinear"
    if alternatives:
        return "ambiguous"
    return "noisy" if _unsure(best) else "ok"
