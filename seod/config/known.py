"""How well the values of a rig file are known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from seod.config.axis import AxisConfig
    from seod.config.calibration import CalibratedValue


def known_to(axis: AxisConfig, name: Literal["K_L", "delay"]) -> float | None:
    """Standard deviation of K_L [axis unit/s/V] or of the delay [s]: as written, or else as calibrated.

    inf where the rig file calls it unknown; None where it says nothing of it.
    """
    sd = axis.estimator.K_L_sd if name == "K_L" else axis.estimator.delay_sd
    if sd == "unknown":
        return math.inf
    if sd is not None or axis.calibration is None:
        return sd
    measured: CalibratedValue = getattr(axis.calibration, name)
    return measured.sd
