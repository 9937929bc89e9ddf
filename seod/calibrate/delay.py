"""Loop delay: the response of a second-order actuator (Eq. 1) to a step of voltage, fitted with its delay."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.calibrate.recording import Recording

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Response:
    """What one step showed: K_L [axis unit/s/V], omega_n [rad/s], zeta, delay [s], rms of the residual."""

    K_L: float
    omega_n: float
    zeta: float
    delay: float
    noise: float

    def settling(self, remainder: float) -> float:
        """Time after which so small a share of a step's transient is left [s]."""
        root = math.sqrt(max(0.0, self.zeta**2 - 1.0))
        return max(0.0, self.delay) + math.log(1.0 / remainder) / (self.omega_n * (self.zeta - root))


def unit_step(t: Array, omega_n: float, zeta: float, measures_speed: bool) -> Array:
    """Position (or speed) after a unit step of speed asked for at 0, from rest; 0 before it."""
    root = cmath.sqrt(complex(zeta * zeta - 1.0)) or 1e-6
    a, b = omega_n * (root - zeta), omega_n * (-root - zeta)
    after = np.maximum(t, 0.0)
    ea, eb = np.exp(a * after), np.exp(b * after)
    if measures_speed:
        return np.asarray(1.0 - ((a * eb - b * ea) / (a - b)).real)
    return np.asarray(after - ((a * (eb - 1.0) / b - b * (ea - 1.0) / a) / (a - b)).real)


def fit_response(drive: Recording, K_L: float, measures_speed: bool) -> Response:
    """Fit a drive's response; an even drift from before goes on beside it.

    Args:
        drive: From the rest before it on.
        K_L: About the gain, to begin with.
        measures_speed: The sensor measures the speed, not the position.

    Raises:
        ValueError: No such response can be seen.
    """
    t = drive.t - drive.step_t
    length = float(t[-1])

    def best_with(shape: Array) -> tuple[float, Array]:
        """Gain and residual, the linear parameters at their best."""
        step = unit_step(t - shape[2], math.exp(shape[0]), math.exp(shape[1]), measures_speed)
        drift = [] if measures_speed else [t]
        matrix = np.stack([drive.step * step, np.ones_like(t), *drift]).T
        found = np.linalg.lstsq(matrix, drive.y, rcond=None)[0]
        return float(found[0]), drive.y - matrix @ found

    low = np.array([math.log(1.0 / length), math.log(0.01), -0.2 * length])
    high = np.array([math.log(300.0 / length), math.log(10.0), 0.8 * length])
    starts = [[math.log(k / length), math.log(z), 0.0] for k in (5.0, 15.0, 50.0) for z in (0.25, 1.0)]

    def residual_with(shape: Array) -> Array:
        return best_with(shape)[1]

    scale = [1.0, 1.0, 0.1 * length]
    fits = [least_squares(residual_with, start, bounds=(low, high), x_scale=scale) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    gain, residual = best_with(best.x)
    if not gain * K_L > 0.0:
        raise ValueError("the actuator did not follow the step")
    omega_n, zeta = np.exp(best.x[:2])
    noise = math.sqrt(float(residual @ residual) / max(1, len(t) - 6))
    return Response(gain, float(omega_n), float(zeta), float(best.x[2]), noise)
