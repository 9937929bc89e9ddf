"""Other plants that explain recordings as well as the best: what the recordings cannot tell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from seod.estimate.advice import INTERVAL
from seod.identify.fit import Fit, fit
from seod.identify.problem import Given
from seod.identify.spread import innovation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.identify.record import Record

UNSURE: Final = 0.1
"""Relative standard deviation above which a value is not told."""
WITHOUT_DELAY: Final = "without delay"
FIRST_ORDER: Final = "as a first-order lag"
_LAG_ZETA: Final = 20.0
"""A zeta at which nothing but a first-order lag of 2 zeta / omega_n is left."""
_AS_WELL: Final = 1.25
"""Ratio of errors up to which what a wrong model leaves decides nothing."""
_CHI_SQUARE: Final = 9.0
"""Of one degree of freedom: three standard deviations."""


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another plant that explains the recordings as well."""

    what: str
    fit: Fit


def alternatives(
    records: Sequence[Record], K_L: float | None, delay: float | None, best: Fit
) -> list[Alternative]:
    """Simpler plants, as far as they explain the recordings as well as the best."""
    if best.white and not _is_unsure(best):
        return []
    found = []
    if delay is None:
        slower = best.plant._replace(zeta=min(best.value["zeta"], 1.5), delay=0.0)
        found.append(Alternative(WITHOUT_DELAY, fit(records, Given(K_L, 0.0), slower)))
    if best.value["zeta"] > 2.0:
        lag = 2.0 * best.value["zeta"] / best.value["omega_n"]
        start = best.plant._replace(omega_n=2.0 * _LAG_ZETA / lag, zeta=_LAG_ZETA)
        first_order = fit(records, Given(K_L, delay, _LAG_ZETA), start)
        found.append(Alternative(FIRST_ORDER, first_order))
    return [each for each in found if _as_well(each.fit, best) and _differs(each.fit, best)]


def _differs(other: Fit, best: Fit) -> bool:
    """Whether it matters which of the two it is."""
    a, b = other.value, best.value
    return any(abs(a[name] - b[name]) > UNSURE * b[name] for name in ("omega_n", "zeta"))


def _as_well(other: Fit, best: Fit) -> bool:
    """By likelihood; where the best is unsure and leaves no noise, only errors that differ much decide."""
    if _is_unsure(best) and not best.white and other.nrmse < _AS_WELL * best.nrmse:
        return True
    pairs = zip(other.residual, best.residual, strict=True)
    return sum(len(b) * math.log(innovation(a) / innovation(b)) for a, b in pairs) < _CHI_SQUARE


def _is_unsure(best: Fit) -> bool:
    return any(best.sd[name] > UNSURE * best.value[name] for name in ("omega_n", "zeta"))


def in_words(other: Alternative, best: Fit) -> str:
    """What it is beside the best, and what that means."""
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
