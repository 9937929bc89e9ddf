"""Eq. 1 in closed form: for rigs without effects. Needs no compiler, and starts at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.estimate.plant.free_motion import Dynamics, free_motion
from seod.estimate.plant.response import StepwiseVoltage

if TYPE_CHECKING:
    from seod.model_monitor.window import Array, Segment


class LinearModel:
    """K_L and the plant; of a position an offset and a ramp are free besides the initial state.

    Args:
        K_L: [axis unit/s/V].
        omega_n: [rad/s].
        zeta: Damping ratio.
        delay: From a command's leaving to the sample [s].
        lag: Time constant of a position's sensor [s].
        speed: The samples are speeds.
    """

    name = "linear"

    def __init__(
        self,
        K_L: float,
        omega_n: float,
        zeta: float,
        delay: float = 0.0,
        lag: float = 0.0,
        speed: bool = False,
    ) -> None:
        # a speed's lag is taken for a delay: right up to second order for what is slow beside it
        late, follows = (delay + lag, 0.0) if speed else (delay, lag)
        self._K_L, self._speed = K_L, speed
        self._plant = Dynamics(omega_n, zeta, late, follows)

    def residual(self, segment: Segment) -> Array:
        """See `Model`."""
        response = StepwiseVoltage(segment.t_u, segment.u, segment.t, self._speed).output(self._plant)
        left = segment.y - self._K_L * response
        basis = self._free(segment.t - segment.t[0])
        return np.asarray(left - basis @ np.linalg.lstsq(basis, left, rcond=None)[0])

    def close(self) -> None:
        """Nothing to let go of."""

    def _free(self, since: Array) -> Array:
        """What a free initial state, an offset and a ramp of the position add; shape (n, m)."""
        cosine, sine = free_motion(self._plant, since)
        columns = [cosine, sine * self._plant.omega_n, np.ones_like(since)]
        if not self._speed:
            columns.append(since / since[-1])
        if self._plant.lag > 0.0:
            columns.append(np.exp(-since / self._plant.lag))
        return np.stack(columns, axis=1)
