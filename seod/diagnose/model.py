"""A model to be fitted: which effects are free, and the kernel's record for searched numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.coordinates import STIFFEST, WAVES, Coordinate, Scales, Values, base, group
from sim.effects import EFFECTS
from sim.effects import STIFFEST as LIMIT
from sim.parameters import parameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from seod.diagnose.answer import Array, Effects

COARSE: Final = 0.3
"""Substep times the fastest rate in a search: readings then differ by some 1e-4 of the movement at most."""
DULL: Final = 4.0
"""Damping of bristles over the square root of their stiffness, at most: 2 is critical."""
SHORTEST: Final = 0.03
"""Substeps that an orifice asks for, over the longest: a search need not come nearer to its limit."""
QUICK: Final = 1.0
STABLE: Final = 1.5
"""A pole that decays within a tick need not be followed: above `QUICK` times the sampling rate substeps grow,
as far as the method is stable."""
PLACED: Final = {"position_ripple", "load_spring"}
"""Effects that show in a speed where the load is."""
BASE: Final = ("K_L", "omega_n", "zeta")


@dataclass(frozen=True, slots=True)
class Model:
    """Eq. 1 with effects, some of them free.

    Attributes:
        scales: Sizes in the recordings.
        names: Effects whose parameters are free.
        coordinates: What is searched, K_L, omega_n and zeta first.
        fixed: Effects of the rig's model that stay as they are.
        sees_speed: The sensor sees the speed.
        accuracy: Of the simulation, see `sim.parameters`.
    """

    scales: Scales
    names: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    fixed: Mapping[str, Mapping[str, float]]
    sees_speed: bool
    accuracy: float = COARSE

    @property
    def states(self) -> list[int]:
        """Columns of a window's initial state that are free."""
        on = {*self.names, *self.fixed}
        place = [] if self.sees_speed and not on & PLACED else [2]
        loose = [6] if on & {"backlash", "lugre_friction"} else []
        second = [3, 4] if "load_resonance" in on else []
        return [0, 1, *place, *second, *([5] if "sensor_lag" in on else []), *loose]

    @property
    def state_sizes(self) -> Array:
        """A small change of each column of an initial state, shape (7,)."""
        s = self.scales
        reading = s.speed if self.sees_speed else s.swing
        sizes = [s.pressure, s.speed, s.swing, s.speed, s.swing, reading, s.swing]
        return 1e-3 * np.maximum(sizes, 1e-12)

    def values(self, x: Array) -> Values:
        """Parameters at searched numbers."""
        return {c.place: c.value(float(at)) for c, at in zip(self.coordinates, x, strict=True)}

    def searched(self, values: Mapping[str, float]) -> Array:
        """Searched numbers of parameters, within bounds."""
        return np.array([c.searched(values[c.place]) for c in self.coordinates])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Of the searched numbers."""
        low, high = zip(*(c.bounds for c in self.coordinates), strict=True)
        return np.array(low), np.array(high)

    def effects(self, x: Array) -> Effects:
        """All that is switched on, free or not, as `sim.parameters` takes it."""
        free = grouped(self.values(x))
        if "lugre_friction" in free:
            bristles = free["lugre_friction"]
            stiffest = min(STIFFEST / self.scales.swing, LIMIT) * free["coulomb_friction"]["level"]
            bristles["stiffness"] = min(bristles["stiffness"], stiffest)
            bristles["damping"] = min(bristles["damping"], DULL * math.sqrt(bristles["stiffness"]))
        if "stribeck_friction" in free:
            falls = free["stribeck_friction"]
            falls["level"] = min(falls["level"], 0.999 * LIMIT * falls["speed"])
        return {**{name: dict(group) for name, group in self.fixed.items()}, **free}

    def record(self, x: Array) -> NDArray[np.void]:
        """The kernel's parameters."""
        values = self.values(x)
        K_L, omega_n, zeta = (values[name] for name in BASE)
        speed = float(self.sees_speed)
        accuracy = tolerance(omega_n, zeta, self.scales.tick_s, self.accuracy)
        effects = self.effects(x)
        return parameters(
            K_L, omega_n, zeta, effects, accuracy=accuracy, shortest=SHORTEST, measures_speed=speed
        )

    def with_effect(self, name: str) -> Model:
        """The same with one effect more, or with one of the rig's freed."""
        names = (*self.names, name)
        coordinates = (*self.coordinates, *group(name, self.scales).coordinates)
        fixed = {of: values for of, values in self.fixed.items() if of != name}
        return replace(self, names=names, coordinates=coordinates, fixed=fixed)

    def without(self, name: str) -> Model:
        """The same without one of the free effects; bristles go with the friction that they bear."""
        gone = {name, "lugre_friction"} if name == "coulomb_friction" else {name}
        names = tuple(each for each in self.names if each not in gone)
        kept = tuple(c for c in self.coordinates if c.place.split(".")[0] not in gone)
        return replace(self, names=names, coordinates=kept)


def tolerance(omega_n: float, zeta: float, tick_s: float, accuracy: float = COARSE) -> float:
    """Of a search's simulation, see `sim.parameters`: poles quicker than a tick need not be followed."""
    quick = omega_n * max(1.0, 2.0 * zeta) * tick_s
    return min(accuracy * max(1.0, quick / QUICK), STABLE)


def baseline_model(
    scales: Scales, sign: float, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]]
) -> Model:
    """Eq. 1, with the effects that the rig's file has."""
    return Model(scales, (), base(sign, scales), fixed, sees_speed)


def grouped(values: Mapping[str, float]) -> Effects:
    """Parameters of effects by effect; waves as amplitude and phase."""
    out: Effects = {}
    for place, value in values.items():
        name, _, of = place.partition(".")
        if of:
            out.setdefault(name, {})[of] = value
    for name in WAVES.keys() & out.keys():
        sine, cosine = out[name].pop("sine"), out[name].pop("cosine")
        out[name] |= {"amplitude": math.hypot(sine, cosine), "phase": math.atan2(cosine, sine)}
    return {name: out[name] for name in EFFECTS if name in out}
