"""How far an answer is to be believed: the quality word, its reason, and what is told only roughly."""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING, Final

from seod.estimate.advice import INTERVAL
from seod.identify.alternatives import UNSURE
from seod.identify.problem import NAMES, ZETA_RANGE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.identify.fit import Fit
    from seod.identify.record import Record

_POOR: Final = 0.3
"""nrmse above which it is another plant, not noise."""
_NOTHING: Final = 0.95
"""nrmse above which nothing is explained."""
_FAR: Final = 4.0
"""Standard deviations below zero at which a delay is none."""
_EARLY: Final = (
    "the delay is negative: as of a valve with a dead band, of times that are late, or of a command that "
    "runs straight on between samples (--hold first)"
)
_LATE: Final = (
    "the delay is below zero by no more than it is uncertain: as of none, of y that comes late, or of u "
    "that moves earlier than its times say"
)
_TIED: Final = 0.98
"""Correlation from which on two values are told only together."""
_UNITS: Final = {"omega_n": "rad/s", "zeta": "", "delay": "s", "K_L": "unit/s/V"}


def quality(
    records: Sequence[Record], told: Fit, is_open: bool, differ: str | None
) -> tuple[str, str | None]:
    """The word, worst first, and the reason."""
    clipped = [record.name for record in records if record.is_clipped]
    left = f"the simulation leaves {100 * told.nrmse:.3g} % of the recordings"
    zeta, rough = told.value["zeta"], unsure(told)
    words = (
        ("fault", not _is_finite(told), "the search came to no number"),
        ("saturated", bool(clipped), f"{', '.join(clipped)}: y stands at an end of its sensor's range"),
        ("noisy", told.nrmse > _NOTHING and told.white, f"{left}: y has little to do with u"),
        ("nonlinear", told.nrmse > _POOR and not told.white, f"{left}, and it is no noise: another plant"),
        ("nonlinear", differ is not None, differ),
        ("nonlinear", told.value["delay"] < -_FAR * told.sd["delay"] < 0.0, _EARLY),
        ("out_of_range", not _is_in_range(zeta), f"zeta ran to {zeta:.3g}"),
        ("noisy", is_open, "other plants explain the recordings as well"),
        ("noisy", bool(rough), "; ".join(rough)),
    )
    return next(((word, why) for word, applies, why in words if applies), ("ok", None))


def early(told: Fit) -> list[str]:
    """What a delay below zero means, in a sentence; none where it is not below zero."""
    delay, sd = told.value["delay"], told.sd["delay"]
    if not delay < 0.0:
        return []
    return [_EARLY if delay < -_FAR * sd else _LATE]


def _is_finite(told: Fit) -> bool:
    return all(math.isfinite(x) for x in (*told.value.values(), *told.sd.values(), told.nrmse))


def _is_in_range(zeta: float) -> bool:
    return 1.1 * ZETA_RANGE[0] < zeta < 0.9 * ZETA_RANGE[1]


def correlations(best: Fit) -> dict[str, float]:
    """Of each pair of values that were estimated."""
    sd, table = best.sd, best.covariance
    pairs = combinations([(k, name) for k, name in enumerate(NAMES) if sd[name] > 0.0], 2)
    return {f"{a},{b}": round(float(table[i, j] / (sd[a] * sd[b])), 4) for (i, a), (j, b) in pairs}


def unsure(best: Fit) -> list[str]:
    """Values whose deviation is a large part of them; for the delay, of the time 1 / omega_n."""
    sizes = best.value | {"delay": 1.0 / best.value["omega_n"]}
    rough = [name for name in NAMES if best.sd[name] > UNSURE * abs(sizes[name])]
    return [
        f"{name} is hardly told: {best.value[name]:.4g} +- {INTERVAL * best.sd[name]:.2g} {_UNITS[name]}"
        for name in rough
    ]


def tied(best: Fit) -> list[str]:
    """Pairs of values whose errors go together."""
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
