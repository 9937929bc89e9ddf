"""Estimators of omega_n and zeta from the relay's limit cycle; see docs/estimators.md."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.estimate.limit_cycle.exact import ExactEstimator
from seod.estimate.limit_cycle.peaks import PeaksEstimator
from seod.estimate.wave.estimator import WaveEstimator

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.estimate.base import Estimator, EstimatorSettings

TABLE: Final[dict[str, Callable[[EstimatorSettings], Estimator]]] = {
    "peaks": PeaksEstimator,
    "exact": ExactEstimator,
    "wave": WaveEstimator,
}
"""Estimators by the name that the rig file gives them."""


def make_estimator(settings: EstimatorSettings) -> Estimator:
    """The estimator that `settings.method` names.

    Raises:
        ValueError: No estimator of that name.
    """
    try:
        return TABLE[settings.method](settings)
    except KeyError:
        raise ValueError(f"unknown method {settings.method!r}: expected one of {', '.join(TABLE)}") from None
