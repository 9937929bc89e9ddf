"""What a recorded voltage does to the plant of Eq. 1, in closed form; quick where it changes at every sample.

By partial fractions each change of the voltage starts a steady course and two fading modes e^(pole t). The
modes of all changes before a time add up to one amplitude each, by a recursion that is unrolled by doubling.
"""

from __future__ import annotations

import cmath
import copy
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

if TYPE_CHECKING:
    from typing import Self

    from numpy.typing import NDArray

    from seod.estimate.arrays import Array
    from seod.estimate.plant.free_motion import Dynamics

Hold = Literal["zero", "first"]
"""A voltage that holds until the next, or one that runs straight on to it."""
_DOUBLE_POLE: Final = 1e-12
"""|1 - zeta^2| below which the two poles are held apart."""
_FADED: Final = 1e-18


class Drive:
    """A voltage as seen from sample times, behind the plant.

    Args:
        t_u: When each voltage began [s], rising; shape (m,).
        u: Voltages [V], shape (m,).
        t: Sample times [s], rising; shape (n,).
        hold: How the voltage goes on until the next.
    """

    def __init__(self, t_u: Array, u: Array, t: Array, hold: Hold = "zero") -> None:
        self.t, self.first = t, float(u[0])
        self.extra = hold == "first"
        w = np.append(np.diff(u) / np.diff(t_u), 0.0) if self.extra else u
        changed = np.flatnonzero(np.diff(w, prepend=np.nan) != 0.0)
        self.t_u, self.w = t_u[changed], w[changed]
        self.held, self.jumps = np.diff(self.t_u), np.diff(self.w)
        self.once = _summed(self.w[:-1] * self.held)
        self.twice = _summed((self.once[:-1] + 0.5 * self.w[:-1] * self.held) * self.held)

    def seen_at(self, t: Array) -> Self:
        """The same voltage for other sample times."""
        other = copy.copy(self)
        other.t = t
        return other

    def velocity(self, plant: Dynamics) -> Array:
        """Of a plant of gain 1 [unit/s/K_L]; right but for a free motion, shape (n,)."""
        return self._response(plant, 1) + (self.first if self.extra else 0.0)

    def position(self, plant: Dynamics) -> Array:
        """Likewise its integral [unit/K_L]; right but for a free motion, a constant and a ramp."""
        return self._response(plant, 2)

    def _response(self, plant: Dynamics, integrals: int) -> Array:
        """Of G_L(s) / s^integrals to the voltage's changes."""
        order = integrals + self.extra
        at = self.t_u + plant.delay
        place = np.maximum(np.searchsorted(at, self.t, side="right") - 1, 0)
        tau = np.maximum(self.t - at[place], 0.0)
        out = self._steady(plant, order, place, tau)
        one, other = _poles(plant)
        factor = plant.omega_n**2 / (one - other)
        out += self._mode(one, factor / one**order, place, tau)
        if isinstance(one, float):
            out += self._mode(other, -factor / other**order, place, tau)
        return out

    def _steady(self, plant: Dynamics, order: int, place: NDArray[np.intp], tau: Array) -> Array:
        """Where the modes have faded: the voltage and its integrals, by the expansion of G_L about s = 0."""
        w = self.w[place]
        if order == 1:
            return w
        once = self.once[place] + w * tau
        late = 2.0 * plant.zeta / plant.omega_n
        if order == 2:
            return np.asarray(once - late * w)
        twice = self.twice[place] + (self.once[place] + 0.5 * w * tau) * tau
        return np.asarray(twice - late * once + (late**2 - plant.omega_n**-2) * w)

    def _mode(self, pole: Any, factor: Any, place: NDArray[np.intp], tau: Array) -> Array:
        """All changes' parts of a mode; of a complex one, with its conjugate's."""
        amplitude = _recursion(np.exp(pole * self.held), factor * self.jumps)
        motion = amplitude[place] * np.exp(pole * tau)
        return np.asarray(2.0 * motion.real if isinstance(pole, complex) else motion)


def _summed(steps: Array) -> Array:
    return np.concatenate(([0.0], np.cumsum(steps)))


def _poles(plant: Dynamics) -> tuple[Any, Any]:
    """Both poles of G_L [1/s], real or a conjugate pair."""
    squared = plant.zeta**2 - 1.0
    if abs(squared) < _DOUBLE_POLE:
        squared = -_DOUBLE_POLE
    if squared < 0.0:
        pole = plant.omega_n * (cmath.sqrt(squared) - plant.zeta)
        return pole, pole.conjugate()
    fast = -plant.omega_n * (plant.zeta + squared**0.5)
    return fast, plant.omega_n**2 / fast


def _recursion(decay: Any, jumps: Any) -> Any:
    """z[k] = decay[k-1] z[k-1] + jumps[k-1] from z[0] = 0, shape (m + 1,): log m passes over whole arrays."""
    z, power, reach = jumps.copy(), decay.copy(), 1
    while reach < len(z) and np.abs(power[reach:]).max() > _FADED:
        z[reach:] += power[reach:] * z[:-reach]
        power[reach:] *= power[:-reach]
        reach *= 2
    return np.concatenate((np.zeros(1, z.dtype), z))
