"""What a relay's limit cycle says of the plant, to be held against the frequency response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.identify import IdentifyError, Record, identify
from seod.respond.fit import Plant
from seod.respond.record import RespondError

if TYPE_CHECKING:
    from seod.respond.record import Array, Output


@dataclass(frozen=True)
class LimitCycle:
    """Its answer, with standard deviations.

    Attributes:
        plant: With K_L as it is known.
        omega_n_sd: [rad/s]
        zeta_sd: [-]
        e_a: Amplitude of the relay [V].
    """

    plant: Plant
    omega_n_sd: float
    zeta_sd: float
    e_a: float


def recorded(
    name: str,
    t: Array,
    u: Array,
    y: Array,
    t_u: Array | None,
    output: Output,
    K_L: float,
    delay: float | None,
) -> LimitCycle:
    """From the columns of a relay's recording.

    Args:
        name: For messages.
        t: Sample times [s], shape (n,); `u` [V], `y` [unit] and `t_u` [s] likewise.
        u: See `t`.
        y: See `t`.
        t_u: See `t`; None: at `t`.
        output: What `y` is.
        K_L: As it is known [unit/s/V]: one limit cycle does not tell it.
        delay: If it is known [s]; None: estimated.

    Raises:
        RespondError: It tells nothing.
    """
    try:
        result = identify([Record(name, t, u, y, t_u, output)], K_L, delay)
    except IdentifyError as error:
        raise RespondError(str(error)) from error
    if result.fit is None:
        raise RespondError(f"{name}: {result.quality}: {result.message}")
    value, sd = result.fit.value, result.fit.sd
    low, high = np.nanpercentile(u, (10.0, 90.0))
    plant = Plant(K_L, value["omega_n"], value["zeta"], value["delay"])
    return LimitCycle(plant, sd["omega_n"], sd["zeta"], 0.5 * float(high - low))
