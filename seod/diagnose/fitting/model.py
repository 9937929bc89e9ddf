"""A model to be fitted: which effects are free, and the kernel's record for searched numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.base import BASE, base
from seod.diagnose.causes.cause import signed
from seod.diagnose.causes.table import (
    CAUSES,
    OFFSET,
    OFFSET_DRIFT_PLACE,
    OFFSET_PLACE,
    SAME_PLANT,
    bound_to,
    group,
    has,
    is_unseen,
)
from seod.diagnose.tuning.fitting import FIT, SUBSTEPS
from sim.effects import EFFECTS, FAR
from sim.parameters import parameters
from sim.windows import START

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from seod.diagnose.causes.cause import Coordinate, SamePlant
    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Array, Effects


@dataclass(frozen=True, slots=True)
class Model:
    """Eq. 1 with effects, some of them free.

    Attributes:
        scales: Sizes in the recordings.
        names: Effects whose parameters are free.
        coordinates: What is searched, K_L, omega_n and zeta first.
        fixed: Effects of the rig's model that stay as they are.
        sees_speed: The sensor sees the speed.
        moved: Free effects that act at their other place (`causes.cause.Elsewhere`).
    """

    scales: Scales
    names: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    fixed: Mapping[str, Mapping[str, float]]
    sees_speed: bool
    moved: frozenset[str] = frozenset()

    @property
    def states(self) -> list[int]:
        """Columns of a window's initial state that are free."""
        of_plant = ("pressure", "velocity") if self.sees_speed else ("pressure", "velocity", "position")
        free = {*of_plant, *(state for name in self._on for state in CAUSES[name].states)}
        return [column for column, state in enumerate(START) if state in free]

    @property
    def known_gain(self) -> float | None:
        """K_L where the user tells it [unit/s/V]; None: it is searched."""
        gain = self.coordinates[0]
        return gain.scale * gain.low if gain.low == gain.high else None

    @property
    def _on(self) -> set[str]:
        return {*self.names, *(CAUSES.keys() & self.fixed.keys())}

    @property
    def state_sizes(self) -> Array:
        """A small change of each column of an initial state, shape (7,)."""
        s = self.scales
        reading = s.speed if self.sees_speed else s.peak_to_peak
        sizes = [s.pressure, s.speed, s.peak_to_peak, s.speed, s.peak_to_peak, reading, s.peak_to_peak]
        return FIT.state_step * np.maximum(sizes, 1e-30)

    def values(self, x: Array) -> Values:
        """Parameters at searched numbers."""
        values = {c.place: c.value(float(at)) for c, at in zip(self.coordinates, x, strict=True)}
        for same in self._same_plants():
            values |= same.begins(values)
        return values

    def searched(self, values: Mapping[str, float]) -> Array:
        """Searched numbers of parameters, within bounds.

        K_L, omega_n and zeta are searched as Eq. 1 has them, also beside a cause that changes these numbers
        and not the plant (`causes.cause.SamePlant`): a step of that cause alone leaves the plant as it is.
        So does leaving the cause out.
        """
        values = dict(values)
        for name, same in SAME_PLANT.items():
            if same in self._same_plants() or (name not in self.names and has(name, values)):
                values |= same.becomes(values)
        return np.array([c.searched(values[c.place]) for c in self.coordinates])

    def _same_plants(self) -> list[SamePlant]:
        """Of the free causes; none where K_L is known: that is the plant's own."""
        if self.known_gain is not None:
            return []
        return [SAME_PLANT[name] for name in self.names if name in SAME_PLANT]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Of the searched numbers."""
        low, high = zip(*(c.bounds for c in self.coordinates), strict=True)
        return np.array(low), np.array(high)

    def effects(self, x: Array) -> Effects:
        """All that is switched on, free or not, as `sim.parameters` takes it."""
        free = grouped(self.values(x))
        for name in free:
            within = CAUSES[name].within
            if within is not None:
                within(free, self.scales)
            place = CAUSES[name].elsewhere
            if place is not None and name in self.moved:
                free[name][place.parameter] = 1.0
        return {**{name: dict(group) for name, group in self.fixed.items()}, **free}

    def kernel_parameters(self, x: Array) -> NDArray[np.void]:
        """The kernel's parameters."""
        values = self.values(x)
        K_L, omega_n, zeta = (values[name] for name in BASE)
        speed = float(self.sees_speed)
        accuracy = tolerance(omega_n, zeta, self.scales.tick_s)
        effects = self.effects(x)
        return parameters(
            K_L, omega_n, zeta, effects, accuracy=accuracy, shortest=SUBSTEPS.shortest, measures_speed=speed
        )

    def with_effect(self, name: str) -> Model:
        """The same with one effect more, or with one of the rig's freed."""
        names = (*self.names, name)
        coordinates = (*self.coordinates, *group(name, self.scales).coordinates)
        fixed = {of: values for of, values in self.fixed.items() if of != name}
        return replace(self, names=names, coordinates=coordinates, fixed=fixed)

    def drifting(self) -> Model:
        """The same beside a constant load that grows with time."""
        if OFFSET_DRIFT_PLACE in (each.place for each in self.coordinates):
            return self
        loaded = self if OFFSET in self.names else self.with_effect(OFFSET)
        size = next(each.scale for each in loaded.coordinates if each.place == OFFSET_PLACE)
        drift = signed(OFFSET_DRIFT_PLACE, size / self.scales.span_s, FAR)
        return replace(loaded, coordinates=(*loaded.coordinates, drift))

    def turned(self, K_L: float) -> Model:
        """The same for a plant whose gain has the sign of this one."""
        gain, *others = self.coordinates
        if self.known_gain is not None:
            return self
        return replace(self, coordinates=(replace(gain, scale=math.copysign(1.0, K_L)), *others))

    def at_other_place(self, name: str) -> Model:
        """The same with one of the free effects at its other place in the signal's way."""
        return replace(self, moved=self.moved ^ {name})

    def without(self, name: str) -> Model:
        """The same without one of the free effects; with it go those that act only beside it."""
        gone = {name, *bound_to(name)}
        names = tuple(each for each in self.names if each not in gone)
        kept = tuple(c for c in self.coordinates if c.place.split(".")[0] not in gone)
        return replace(self, names=names, coordinates=kept, moved=self.moved - gone)

    def shown(self) -> Model:
        """The same without effects that none of the others shows: Eq. 1 has them in its numbers."""
        unseen = [name for name in self.names if is_unseen(name, self.names)]
        return self.without(unseen[0]).shown() if unseen else self


def tolerance(omega_n: float, zeta: float, tick_s: float) -> float:
    """Of a search's simulation, see `sim.parameters`: poles quicker than a tick need not be followed."""
    quick = omega_n * max(1.0, 2.0 * zeta) * tick_s
    return min(SUBSTEPS.search_accuracy * max(1.0, quick / SUBSTEPS.quick_pole), SUBSTEPS.stable)


def baseline_model(
    scales: Scales,
    sign: float,
    sees_speed: bool,
    fixed: Mapping[str, Mapping[str, float]],
    gain: float | None = None,
) -> Model:
    """Eq. 1, with the effects that the rig's file has; `gain` is K_L where it is known."""
    return Model(scales, (), base(sign, scales, gain), fixed, sees_speed)


def grouped(values: Mapping[str, float]) -> Effects:
    """Parameters of effects by effect; waves as amplitude and phase."""
    out: Effects = {}
    for place, value in values.items():
        name, _, of = place.partition(".")
        if of:
            out.setdefault(name, {})[of] = value
    for name in out:
        if CAUSES[name].wave is None:
            continue
        sine, cosine = out[name].pop("sine"), out[name].pop("cosine")
        out[name] |= {"amplitude": math.hypot(sine, cosine), "phase": math.atan2(cosine, sine)}
    return {name: out[name] for name in EFFECTS if name in out}
