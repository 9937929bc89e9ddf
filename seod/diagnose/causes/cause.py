"""What is written of one cause: everything about it that a search, its starts, and a report need."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

from sim.effects import EFFECTS, LEAST

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Array, Effects

LARGEST_WAVE_PART: Final = 0.7
"""Cosine and sine part of a wave over the largest amplitude, at most: both together stay below it."""
State = Literal["pressure", "velocity", "position", "velocity2", "position2", "lagged", "loose"]
"""A column of a window's initial state, `sim.windows.START`."""


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One searched number.

    Attributes:
        place: What it stands for: of `Values`, or `effect.cosine`, `effect.sine` of a wave. In a record of a
            cause its own parameter's name alone.
        scale: Of a linear one, its size; of a logarithm its sign.
        low: Least value of the parameter itself.
        high: Largest.
        logarithm: Searched is ln(value / scale); else value / scale.
    """

    place: str
    scale: float
    low: float
    high: float
    logarithm: bool = True

    def value(self, x: float) -> float:
        """The parameter, in its own unit, at the searched number."""
        if self.logarithm:
            return self.scale * min(max(math.exp(x), self.low), self.high)
        return min(max(self.scale * x, self.low), self.high)

    def searched(self, value: float) -> float:
        """The searched number of a parameter in its own unit, within its bounds."""
        if self.logarithm:
            return math.log(min(max(value / self.scale, self.low), self.high))
        return min(max(value, self.low), self.high) / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest searched number."""
        if self.logarithm:
            return math.log(self.low), math.log(self.high)
        return self.low / self.scale, self.high / self.scale


def sized(name: str, low: float, high: float) -> Coordinate:
    """A parameter of one sign, within `low` and `high` in its own unit, whose logarithm is searched."""
    return Coordinate(name, 1.0, low, high)


def linear(name: str, scale: float, low: float, high: float) -> Coordinate:
    """A parameter that acts in proportion: searched over `scale`, from `low` to `high`, in its own unit."""
    return Coordinate(name, scale, low, high, logarithm=False)


def signed(name: str, scale: float, limit: float) -> Coordinate:
    """A parameter that acts in proportion, of either sign and up to `limit`, searched over `scale`."""
    return linear(name, scale, -limit, limit)


@dataclass(frozen=True, slots=True)
class Group:
    """A cause as it is searched: its coordinates, and values to begin from."""

    coordinates: tuple[Coordinate, ...]
    starts: tuple[Values, ...]


@dataclass(frozen=True, slots=True)
class Wave:
    """A cause that is a wave: searched as cosine and sine parts, which act nearly linearly.

    Attributes:
        number: The parameter that tells how often it repeats [rad/s, or rad/unit].
        over: What it repeats over: the time, or where the load is.
        fewest: Waves over all of that, at least: a longer one is a bend, which other causes have too.
        unrepeated: The cause that a wave may be as well of which recordings do not show two.
    """

    number: str
    over: Literal["time", "place"]
    fewest: float
    unrepeated: str | None = None

    def coordinates(
        self, name: str, scale: float, narrow: float, low: float, high: float
    ) -> tuple[Coordinate, ...]:
        """Its cosine part, its sine part, and its number, in this order.

        Args:
            name: Of the cause.
            scale: Size of an amplitude, in the parameter's own unit.
            narrow: Change of the wave's number by which its far end hardly moves [rad/s, or rad/unit].
            low: Least number [likewise].
            high: Largest.
        """
        largest = next(each.high for each in EFFECTS[name].parameters if each.name == "amplitude")
        limit = LARGEST_WAVE_PART * largest
        parts = signed("cosine", scale, limit), signed("sine", scale, limit)
        return (*parts, linear(self.number, narrow, low, high))


@dataclass(frozen=True, slots=True)
class Plain:
    """A simpler cause that this one contains.

    Attributes:
        name: Of the simpler one.
        becomes: Its parameters, and K_L where that changes too, where this one is nothing more; None where
            this one acts only beside it, and both are in a set.
        grows: Parameters of this one, and K_L where that changes too, to begin with where the simpler one is
            found; None: it is not tried so.
        adds: Whether the simpler one does something more in a set that has this one.
    """

    name: str
    becomes: Callable[[Values, Scales], Values] | None
    grows: Callable[[Values, Scales], Values] | None = None
    adds: bool = True


@dataclass(frozen=True, slots=True)
class Alike:
    """A cause that acts like this one.

    Attributes:
        name: Of the other.
        same: The other's parameters at which it does, from those of a set with this one.
        two_commands_only: It does so only where the recordings have two commands and no more.
        distinguished_by: Causes of which one must be in the set: without any both are the same, and it is
            not asked. Empty: it always is.
        commutes: It is the same, whatever recordings show, while nothing in the set tells lags apart.
    """

    name: str
    same: Callable[[Values, Scales], Values]
    two_commands_only: bool = False
    distinguished_by: frozenset[str] = frozenset()
    commutes: bool = False


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Another place in the signal's way where a cause may act.

    Attributes:
        parameter: It is 1 there, and 0 at the usual place.
        distinguished_by: Causes between both places, of which one must be in the set: without any both are
            the same, and it is not asked.
    """

    parameter: str
    distinguished_by: frozenset[str]


@dataclass(frozen=True, slots=True)
class SamePlant:
    """One plant of Eq. 1 in two sets of numbers: with a cause that nothing shows alone, and without it.

    Attributes:
        begins: K_L, omega_n and zeta with it, from those of Eq. 1 and its own parameters.
        becomes: Those of Eq. 1, from those with it.
    """

    begins: Callable[[Values], Values]
    becomes: Callable[[Values], Values]


@dataclass(frozen=True, slots=True)
class Hidden:
    """A cause that two commands hide, as a change of the gain, and the next experiment that shows it.

    Attributes:
        shown: Parameters with which an experiment is tried out, by the largest command [V].
        size: The same in words.
    """

    shown: Callable[[float], Values]
    size: str


@dataclass(frozen=True, slots=True)
class Cycle:
    """A limit cycle of Eq. 1 under a relay.

    Attributes:
        omega: Its frequency [rad/s].
        half: Half of its oscillation, peak to peak [unit].
        stalls: Pressure at which the load would stall, as acceleration [unit/s^2].
        peak_to_peak: From end to end of the load [unit], with the sizes known so far.
    """

    omega: float
    half: float
    stalls: float
    peak_to_peak: Callable[[Values], float]


@dataclass(frozen=True, slots=True)
class Grid:
    """How a cause is tried in the grid of plants under a relay.

    Attributes:
        sizes: Its parameters, from shares of the limit cycle and the other causes' sizes; None: its plants
            have no shares.
        alone: Shares in the grid.
        paired: Shares beside another cause of the grid; none: it is tried alone.
        begins: Its parameters from those of a plant with its plain form, and that plant's amplitude without
            effects.
        settles: Shares that are not in the grid: from its plain form's best plants the search goes on with
            this cause.
        ramps: Its parameters, from how long the valve takes from one command to the other [s] and how far
            these are apart [V]: plants are tried with such ramps.
    """

    sizes: Callable[[Values, Values, Cycle], Values] | None = None
    alone: tuple[Values, ...] = ()
    paired: tuple[Values, ...] = ()
    begins: Callable[[Values, float], Values] | None = None
    settles: Values | None = None
    ramps: Callable[[float, float], Values] | None = None


def _always(_: Scales) -> bool:
    return True


def _nowhere(_: Scales) -> tuple[tuple[float, ...], ...]:
    return ()


def _no_values(_: Scales) -> tuple[Values, ...]:
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """One cause.

    Attributes:
        name: As in `sim.effects`.
        says: What it means, as a sentence of the report; `{figure}` stands for `figure`.
        coordinates: What is searched.
        starts: Values of the coordinates, in their order, to begin from; of a wave none, it begins at lines.
        remote: Factors on the parent's plant, and numbers beside them where not the largest start's, from
            which it is tried too.
        searched: Whether a simulation can show it in recordings of these sizes.
        within: Brings its parameters, among all effects of a model, to what can be simulated.
        plain: Simpler causes that it contains.
        alike: Causes that act like it.
        shown_by: Causes of which one must be in the set: without any Eq. 1 has it in its numbers, and nothing
            shows it. Empty: it shows alone.
        twin: Its parameters, by place, at which Eq. 1 is the same as without it, its numbers unchanged:
            causes are searched from there, too.
        same_plant: The numbers with it and without where Eq. 1 is the same; None: they are no others.
        elsewhere: Another place where it may act; None: there is one alone.
        delays: It may stand for the delay of a plant of the relay's grid: its parameter is `time`.
        pure_delay: Parameter by which it is a delay and nothing else; "" without one.
        hidden: How two commands hide it; None: they do not.
        grid: How it is tried in the relay's grid; None: it is not.
        tells_lags_apart: Whether beside it a lag of the valve and one of the sensor differ. They do not where
            the plant stays linear, nor where it acts in front of both, or behind them.
        states: Columns of initial states that are free with it, beside those of Eq. 1.
        mirrored: Parameters that turn their sign with that of the command.
        wave: How it repeats; None: it is no wave.
        gap: Parameter that is a gap in which the load may have been at rest anywhere; "" without one.
        unsigned: What a sensor with a sign would have read but for the sign, from readings that have lost it
            and a start of this cause: the plant to begin from is that of such readings with the sign of a
            simulation. None where readings keep their sign.
        offset: Parameter by which it is a constant acceleration, in which Eq. 1 is linear; "" without one.
        follows: Parameter by which it is an acceleration in proportion to a channel, in which Eq. 1 is
            linear, too; "" without one.
        drift: Parameter by which that acceleration grows with time; "" without one.
        pulls: Parameters by which it is an acceleration in proportion to the position, and the position where
            it is none: a plant with both is linear. None without.
        ramps: Parameter by which the valve is no faster: plants are looked for behind such ramps, too; ""
            without one.
        holds: Parameter by which it is a force against the movement that holds the load at rest: plants are
            looked for behind it, too; "" without one.
        figure: A number that the sentence tells, from all effects of the model.
    """

    name: str
    says: str
    coordinates: Callable[[Scales], tuple[Coordinate, ...]]
    starts: Callable[[Scales], tuple[tuple[float, ...], ...]] = _nowhere
    remote: Callable[[Scales], tuple[Values, ...]] = _no_values
    searched: Callable[[Scales], bool] = _always
    within: Callable[[Effects, Scales], None] | None = None
    plain: tuple[Plain, ...] = ()
    alike: tuple[Alike, ...] = ()
    shown_by: frozenset[str] = frozenset()
    twin: Values | None = None
    same_plant: SamePlant | None = None
    elsewhere: Elsewhere | None = None
    delays: bool = False
    pure_delay: str = ""
    hidden: Hidden | None = None
    grid: Grid | None = None
    tells_lags_apart: bool = True
    states: tuple[State, ...] = ()
    mirrored: tuple[str, ...] = ()
    wave: Wave | None = None
    gap: str = ""
    unsigned: Callable[[Array, Values, Scales], Array] | None = None
    offset: str = ""
    follows: str = ""
    drift: str = ""
    pulls: tuple[str, str] | None = None
    ramps: str = ""
    holds: str = ""
    figure: Callable[[Effects], float] | None = None

    @property
    def needs(self) -> str:
        """The cause without which it does nothing; "" where it acts alone."""
        return next((each.name for each in self.plain if each.becomes is None), "")

    def group(self, scales: Scales) -> Group:
        """What is searched of it; a wave begins without its number."""
        coordinates = tuple(self._placed(each) for each in self.coordinates(scales))
        places = [each.place for each in coordinates]
        starts = [dict(zip(places, each, strict=True)) for each in self.starts(scales)]
        return Group(coordinates, (*starts, *(starts[-1] | each for each in self.remote(scales))))

    def _placed(self, coordinate: Coordinate) -> Coordinate:
        """With its whole place, both ends within the effect's own limits."""
        place = f"{self.name}.{coordinate.place}"
        limits = next((p for p in EFFECTS[self.name].parameters if p.name == coordinate.place), None)
        if limits is None:
            return replace(coordinate, place=place)
        least = max(limits.low, LEAST.get(place, limits.low))
        low, high = (min(max(end, least), limits.high) for end in (coordinate.low, coordinate.high))
        return replace(coordinate, place=place, low=low, high=high)

    def has_room(self, scales: Scales) -> bool:
        """Whether its own limits leave a range for each number, in recordings of these sizes."""
        return all(each.low < each.high for each in self.group(scales).coordinates)


def not_searched(_: Scales) -> bool:
    """Of causes that something else stands for, or that samples show."""
    return False


def no_coordinates(_: Scales) -> tuple[Coordinate, ...]:
    """Of causes that are not searched."""
    return ()
