"""What recordings say, in the form of a person's and a program's answer, and what they cannot say."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.estimate.advice import INTERVAL, Advice, advise, as_json
from seod.estimate.base import finite_or_none
from seod.identify.agree import disagreement
from seod.identify.fit import Fit, fit
from seod.identify.problem import NAMES, ZETA_RANGE, Given

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

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
_NOTHING: Final = 0.95
"""nrmse above which nothing is explained."""
_TIED: Final = 0.98
"""Correlation from which on two values are told only together."""
_UNITS: Final = {"omega_n": "rad/s", "zeta": "", "delay": "s", "K_L": "unit/s/V"}
WITHOUT_DELAY: Final = "without delay"
FIRST_ORDER: Final = "as a first-order lag"


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another plant that explains the recordings as well."""

    what: str
    fit: Fit


@dataclass(frozen=True, slots=True)
class Result:
    """The answer.

    Attributes:
        fit: The plant; of several that explain the recordings as well, the simplest. None: nothing is told.
        quality: `ok`, or why it is not to be believed: a word of `seod.estimate.base.QUALITIES`.
        message: The reason of a quality that is not `ok`.
        cannot_tell: What the recordings cannot tell, in sentences.
        alternatives: Plants that explain them as well.
        assumed: Names of values that were not told and are taken to be zero.
        advice: For the position controller; None where the answer is not `ok`.
        method: What found it.
        answers: Of a live estimator: how many by quality.
    """

    fit: Fit | None
    quality: str
    message: str | None = None
    cannot_tell: tuple[str, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    assumed: tuple[str, ...] = ()
    advice: Advice | None = None
    method: str = "output_error"
    answers: Mapping[str, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Values with standard deviations, quality word, nrmse and what else there is; undefined is None."""
        return self._values() | {
            "quality": self.quality,
            "message": self.message,
            "method": self.method,
            "nrmse": None if self.fit is None else finite_or_none(self.fit.nrmse),
            "correlation": {} if self.fit is None else correlations(self.fit),
            "answers": dict(self.answers),
            "rejected": 0 if self.fit is None else self.fit.rejected,
            "cannot_tell": list(self.cannot_tell),
            "assumed": list(self.assumed),
            "alternatives": [
                {"what": each.what, **each.fit.value, "nrmse": each.fit.nrmse} for each in self.alternatives
            ],
            "advice": None if self.advice is None else as_json(self.advice),
        }

    def _values(self) -> dict[str, Any]:
        if self.fit is None:
            return {name: {"value": None, "sd": None} for name in NAMES}
        value, sd = self.fit.value, self.fit.sd
        return {
            name: {
                "value": finite_or_none(value[name]),
                "sd": None if name in self.assumed else finite_or_none(sd[name]),
            }
            for name in NAMES
        }


def identify(records: Sequence[Record], K_L: float | None = None, delay: float | None = None) -> Result:
    """Identify the plant of one or several recordings.

    Args:
        records: At least one.
        K_L: Gain [unit/s/V] if it is known; None: free.
        delay: Beyond the recordings' own times [s] if it is known; None: free.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            best = fit(records, Given(K_L, delay))
            differ = disagreement(records, Given(K_L, delay), best)
            others = _alternatives(records, K_L, delay, best) if _is_open(best) else []
    except (np.linalg.LinAlgError, ArithmeticError, ValueError) as error:
        return Result(None, "fault", f"the search came to no number: {error}")
    simplest = next((each.fit for each in others if each.what == WITHOUT_DELAY), None)
    told = best if simplest is None else simplest
    cannot_tell = [_told(each, best) for each in others] or [*_unsure(best), *_tied(best)]
    quality, message = _quality(records, told, bool(others), differ)
    value = told.value | {"K_L": abs(told.value["K_L"])}
    return Result(
        fit=told,
        quality=quality,
        message=message,
        cannot_tell=tuple(cannot_tell),
        alternatives=tuple(
            Alternative("with delay", best) if each.what == WITHOUT_DELAY else each for each in others
        ),
        assumed=() if simplest is None else ("delay",),
        advice=advise(value, told.sd) if quality == "ok" else None,
    )


def correlations(best: Fit) -> dict[str, float]:
    """Of each pair of values that were estimated."""
    sd, table = best.sd, best.covariance
    pairs = combinations([(k, name) for k, name in enumerate(NAMES) if sd[name] > 0.0], 2)
    return {f"{a},{b}": round(float(table[i, j] / (sd[a] * sd[b])), 4) for (i, a), (j, b) in pairs}


def _is_open(best: Fit) -> bool:
    """Whether others may explain the recordings as well: a residual that is no noise hides much."""
    return not best.white or any(best.sd[name] > _UNSURE * best.value[name] for name in ("omega_n", "zeta"))


def _alternatives(
    records: Sequence[Record], K_L: float | None, delay: float | None, best: Fit
) -> list[Alternative]:
    """Simpler plants, as far as they explain the recordings as well as the best."""
    found = []
    if delay is None:
        slower = best.plant._replace(zeta=min(best.value["zeta"], 1.5), delay=0.0)
        found.append(Alternative(WITHOUT_DELAY, fit(records, Given(K_L, 0.0), slower)))
    if best.value["zeta"] > 2.0:
        lag = 2.0 * best.value["zeta"] / best.value["omega_n"]
        start = best.plant._replace(omega_n=2.0 * _FIRST_ORDER / lag, zeta=_FIRST_ORDER)
        first_order = fit(records, Given(K_L, delay, _FIRST_ORDER), start)
        found.append(Alternative(FIRST_ORDER, first_order))
    return [each for each in found if _as_well(each.fit, best) and _differs(each.fit, best)]


def _differs(other: Fit, best: Fit) -> bool:
    """Whether it matters which of the two it is."""
    a, b = other.value, best.value
    return any(abs(a[name] - b[name]) > _UNSURE * b[name] for name in ("omega_n", "zeta"))


def _as_well(other: Fit, best: Fit) -> bool:
    """Noise decides by likelihood; a residual that is none decides only where the errors differ much."""
    if best.white:
        count = sum(len(left) for left in best.residual)
        return (other.nrmse**2 / best.nrmse**2 - 1.0) * count < _CHI_SQUARE
    return other.nrmse < _AS_WELL * best.nrmse


def _told(other: Alternative, best: Fit) -> str:
    value, sd = best.value, best.sd
    errors = f"error {100 * best.nrmse:.2f} % instead of {100 * other.fit.nrmse:.2f} %"
    if other.what == WITHOUT_DELAY:
        return (
            f"with the delay free, omega_n {value['omega_n']:.4g} +- {INTERVAL * sd['omega_n']:.2g} rad/s, "
            f"zeta {value['zeta']:.4g} +- {INTERVAL * sd['zeta']:.2g} and {1000 * value['delay']:.3g} ms "
            f"explain the data as well ({errors}): zeta and delay cannot be told apart; give the delay if "
            f"you know it (--delay)"
        )
    simple = other.fit.value
    lag = 2.0 * simple["zeta"] / simple["omega_n"]
    return (
        f"a first-order lag of {1000 * lag:.3g} ms with {1000 * simple['delay']:.3g} ms delay explains "
        f"the data as well (error {100 * other.fit.nrmse:.2f} %): omega_n and zeta cannot be told apart, "
        f"only 2 zeta / omega_n"
    )


def _unsure(best: Fit) -> list[str]:
    """Values whose deviation is a large part of them; for the delay, of the time 1 / omega_n."""
    sizes = best.value | {"delay": 1.0 / best.value["omega_n"]}
    unsure = [name for name in NAMES if best.sd[name] > _UNSURE * abs(sizes[name])]
    return [
        f"{name} is hardly told: {best.value[name]:.4g} +- {INTERVAL * best.sd[name]:.2g} {_UNITS[name]}"
        for name in unsure
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


def _quality(
    records: Sequence[Record], told: Fit, is_open: bool, differ: str | None
) -> tuple[str, str | None]:
    """The word, worst first, and the reason."""
    clipped = [record.name for record in records if record.is_clipped]
    left = f"the simulation leaves {100 * told.nrmse:.3g} % of the recordings"
    zeta, unsure = told.value["zeta"], _unsure(told)
    words = (
        ("fault", not _is_finite(told), "the search came to no number"),
        ("saturated", bool(clipped), f"{', '.join(clipped)}: y stands at an end of its sensor's range"),
        ("noisy", told.nrmse > _NOTHING and told.white, f"{left}: y has little to do with u"),
        ("nonlinear", told.nrmse > _POOR and not told.white, f"{left}, and it is no noise: another plant"),
        ("nonlinear", differ is not None, differ),
        ("out_of_range", not _is_in_range(zeta), f"zeta ran to {zeta:.3g}"),
        ("noisy", is_open, "other plants explain the recordings as well"),
        ("noisy", bool(unsure), "; ".join(unsure)),
    )
    return next(((word, why) for word, applies, why in words if applies), ("ok", None))


def _is_finite(told: Fit) -> bool:
    return all(math.isfinite(x) for x in (*told.value.values(), *told.sd.values(), told.nrmse))


def _is_in_range(zeta: float) -> bool:
    return 1.1 * ZETA_RANGE[0] < zeta < 0.9 * ZETA_RANGE[1]
