"""What is searched for each effect: its parameters, scaled or as logarithms, and where a search begins."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

Values = dict[str, float]
"""By place: `K_L`, `omega_n`, `zeta`, or `effect.parameter`; in starts `*K_L` and the like multiply these."""

RICHER_FRICTION: Final = frozenset({"stribeck_friction", "lugre_friction"})
"""Effects that contain plain friction, or bear it."""
HELD: Final = ({"*K_L": 2.0, "*zeta": 0.5}, {"*K_L": 2.0, "*zeta": 2.0})
"""Factors where a baseline took friction for little gain: damped little, and much."""
PLAYING: Final = ({"*K_L": 3.0, "*omega_n": 3.0},)
"""Factors where a baseline took a limit cycle that play made slow for the plant's own frequency."""

WAVES_SEEN: Final = 1.25
"""Over the travel, at least: a longer wave of a sensor is a bend, which other causes have too."""
STIFFEST: Final = 2e3
"""Of bristles: friction level over what they give way by, in swings; stiffer ones stick."""
FASTEST, FASTEST_OF_FEW = 0.8, 1.25
"""Natural frequency times the sampling interval, at most; the latter under a relay, where trials take few
samples. Plants at the bound are slow to simulate."""
DAMPED_BY_RELAY: Final = 5.0
"""Largest zeta under a relay: of more damping only the slower pole shows, and the other takes time."""
LEAST: Final = 1e-4
MOST: Final = 1e3
"""Friction over the pressure that accelerates the load: most of it where a relay nearly stalls the load. Its
logarithm is searched: along the valleys between friction and plant all change in proportion."""
WIDEST: Final = 12.0
"""Play over the swing that it leaves, at most."""
SHORTEST_LAG: Final = 0.1
"""Over the sampling interval, at least."""
STEPS_SEEN: Final = 2.0
"""Of a coarse sensor to a wave, at least: at the ends of its steps a shorter one looks like a longer one."""
GAINS: Final = {"valve_deadband", "valve_hysteresis", "valve_saturation"}
"""Effects that are a smaller gain where there are two commands only."""
WAVES: Final = {"periodic_disturbance": "omega", "position_ripple": "wavenumber"}
"""Effects that are a wave: searched as cosine and sine parts, which act nearly linearly."""


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One searched number.

    Attributes:
        place: What it stands for: of `Values`, or `effect.cosine`, `effect.sine` of a wave.
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
        """The parameter at the searched number."""
        if self.logarithm:
            return self.scale * min(max(math.exp(x), self.low), self.high)
        return min(max(self.scale * x, self.low), self.high)

    def searched(self, value: float) -> float:
        """The searched number of a parameter, within its bounds."""
        if self.logarithm:
            return math.log(min(max(value / self.scale, self.low), self.high))
        return min(max(value, self.low), self.high) / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the searched number."""
        if self.logarithm:
            return math.log(self.low), math.log(self.high)
        return self.low / self.scale, self.high / self.scale


@dataclass(frozen=True, slots=True)
class Scales:
    """Sizes of things in the recordings.

    Attributes:
        volts: Largest command, either way [V].
        speed: Standard deviation of the load's speed by the baseline [unit/s].
        pressure: Load pressure by the baseline, seldom exceeded, as acceleration [unit/s^2].
        centre: Mean position [unit].
        travel: Range of positions [unit].
        swing: Typical movement between two reversals [unit].
        omega_n: Of the baseline [rad/s].
        span_s: Length of the longest recording [s].
        tick_s: Sampling interval [s].
        step: Of a coarse sensor of positions [unit], 0 where none is seen.
        slowest: Natural frequency that is searched, at least [rad/s]: of less, windows show no swing.
        damped: Largest zeta that is searched.
        warmer: The temperature changes.
        relayed: There are two commands only.
        pressed: The supply pressure changes.
    """

    volts: float
    speed: float
    pressure: float
    centre: float
    travel: float
    swing: float
    omega_n: float
    span_s: float
    tick_s: float
    step: float = 0.0
    slowest: float = 2.0
    damped: float = 20.0
    warmer: bool = False
    relayed: bool = False
    pressed: bool = False


@dataclass(frozen=True, slots=True)
class Group:
    """An effect as it is searched: its coordinates, and values to begin from."""

    coordinates: tuple[Coordinate, ...]
    starts: tuple[Values, ...]


def base(sign: float, scales: Scales) -> tuple[Coordinate, ...]:
    """K_L, which has this sign, omega_n and zeta."""
    fastest = FASTEST_OF_FEW if scales.relayed else FASTEST
    return (
        Coordinate("K_L", sign, 1e-9, 1e9),
        Coordinate("omega_n", 1.0, scales.slowest, fastest / scales.tick_s),
        Coordinate("zeta", 1.0, 1e-3, scales.damped),
    )


def group(name: str, scales: Scales) -> Group:
    """What is searched for an effect of this name; a wave begins without its frequency."""
    made: dict[str, Group] = {}
    for table in (_valve, _flow, _load, _sensor, _plant):
        made |= table(scales)
    found = made[name]
    return replace(found, coordinates=tuple(_within_table(each) for each in found.coordinates))


def _within_table(coordinate: Coordinate) -> Coordinate:
    """The same, no further than the effect's own limits."""
    name, _, of = coordinate.place.partition(".")
    limits = next((each for each in EFFECTS[name].parameters if each.name == of), None)
    if limits is None:
        return coordinate
    return replace(coordinate, low=max(coordinate.low, limits.low), high=min(coordinate.high, limits.high))


def searched_causes(scales: Scales) -> list[str]:
    """Effects that a simulation can show in these recordings."""
    causes = [e.name for e in EFFECTS.values() if e.cause and e.enters != "record"]
    causes.remove("sensor_quantization")
    if scales.relayed:
        causes = [each for each in causes if each not in GAINS]
    if not scales.pressed:
        causes.remove("pressure_dependent_stiffness")
    return causes


def further_causes(scales: Scales, names: Collection[str]) -> list[str]:
    """What can be added to a set: effects that it lacks; bristles only beside the friction that they bear."""
    bristles = ["lugre_friction"] if "coulomb_friction" in names else []
    return [each for each in (*searched_causes(scales), *bristles) if each not in names]


def plain_form(names: Collection[str]) -> frozenset[str]:
    """A set with plain friction in the place of richer forms of it."""
    others = frozenset(names) - RICHER_FRICTION
    return others if len(others) == len(names) else others | {"coulomb_friction"}


def _group(name: str, coordinates: Mapping[str, Coordinate], *starts: tuple[float, ...]) -> dict[str, Group]:
    values = tuple(dict(zip((c.place for c in coordinates.values()), s, strict=True)) for s in starts)
    return {name: Group(tuple(coordinates.values()), values)}


def _sized(place: str, low: float, high: float) -> dict[str, Coordinate]:
    return {place: Coordinate(place, 1.0, low, high)}


def _linear(place: str, scale: float, low: float, high: float) -> dict[str, Coordinate]:
    """Of one sign, and acting in proportion."""
    return {place: Coordinate(place, scale, low, high, logarithm=False)}


def _signed(place: str, scale: float, limit: float) -> dict[str, Coordinate]:
    return {place: Coordinate(place, scale, -limit, limit, logarithm=False)}


def _valve(s: Scales) -> dict[str, Group]:
    volts, tau = s.volts, 1.0 / s.omega_n
    return {
        **_group(
            "transport_delay",
            _linear("transport_delay.time", tau, 0.0, 0.1),
            *((min(x * tau, 0.05),) for x in (0.05, 0.3)),
        ),
        **_group(
            "valve_saturation",
            _sized("valve_saturation.limit", 0.02 * volts, 1.5 * volts),
            *((x * volts,) for x in (0.4, 0.6, 0.85)),
        ),
        **_group(
            "valve_hysteresis",
            _linear("valve_hysteresis.half_width", 0.1 * volts, 0.0, volts),
            *((x * volts,) for x in (0.004, 0.02, 0.1, 0.3)),
        ),
        **_group(
            "valve_lag",
            _linear("valve_lag.time", tau, _shortest(s), 0.1),
            *((min(x * tau, 0.05),) for x in (0.1, 0.5)),
        ),
        **_group(
            "valve_deadband",
            _linear("valve_deadband.half_width", 0.1 * volts, 0.0, volts),
            *((x * volts,) for x in (0.004, 0.02, 0.1, 0.3)),
        ),
    }


def _shortest(s: Scales) -> float:
    """Of a lag [s]: a shorter one does not show in the samples, and asks for many substeps."""
    return max(SHORTEST_LAG * s.tick_s, 1e-5)


def _flow(s: Scales) -> dict[str, Group]:
    return {
        **_group("asymmetric_gain", _signed("asymmetric_gain.ratio", 0.1, 0.9), (0.02,)),
        **_group(
            "square_root_flow",
            _sized("square_root_flow.supply", 0.5 * s.pressure, 100.0 * s.pressure),
            *((x * s.pressure,) for x in (1.0, 2.0, 5.0)),
        ),
        **_group(
            "pressure_dependent_stiffness",
            _sized("pressure_dependent_stiffness.air", 1e-4, 100.0),
            (0.05,),
            (0.5,),
        ),
    }


def _load(s: Scales) -> dict[str, Group]:
    size = s.pressure
    spring = {
        **_signed("load_spring.stiffness", 0.1 * s.omega_n**2, 1e7),
        **_signed("load_spring.centre", max(s.travel, 1e-9), 1e6),
    }
    stribeck = {
        **_sized("stribeck_friction.level", LEAST * size, MOST * size),
        **_sized("stribeck_friction.speed", max(0.05 * s.speed, 1e-4 * size), 300.0 * s.speed),
    }
    resonance = {
        **_sized("load_resonance.inertia", 1e-3, 10.0),
        **_sized("load_resonance.omega", max(0.3 * s.omega_n, 1.0), min(20.0 * s.omega_n, 2.0 / s.tick_s)),
        **_sized("load_resonance.zeta", 2e-3, 0.5),
    }
    bristles = {
        **_sized("lugre_friction.stiffness", 0.05 * size / s.swing, min(STIFFEST * size / s.swing, 1e9)),
        **_sized("lugre_friction.damping", 1e-3 * s.omega_n, 1e3 * s.omega_n),
    }
    stiff = [0.2 * size / (x * s.swing) for x in (0.03, 0.003)]
    return {
        **_group("lugre_friction", bristles, *((x, 0.5 * math.sqrt(x)) for x in stiff)),
        **_group("load_bias", _signed("load_bias.acceleration", 0.1 * size, 1e6), (0.02 * size,)),
        **_group("load_spring", spring, (0.02 * s.omega_n**2, s.centre), (0.2 * s.omega_n**2, s.centre)),
        "coulomb_friction": _far(
            HELD,
            _sized("coulomb_friction.level", LEAST * size, MOST * size),
            *((x * size,) for x in (0.02, 0.1, 0.3)),
        ),
        "stribeck_friction": _far(
            HELD, stribeck, *((x * size, v * s.speed) for x, v in ((0.05, 0.1), (0.1, 0.4), (0.3, 0.15)))
        ),
        **_group(
            "load_resonance",
            resonance,
            *((0.2, x * s.omega_n, 0.05) for x in (0.6, 1.3, 2.5, 5.0)),
            *((1.0, x * s.omega_n, 0.05) for x in (1.3, 1.8)),
        ),
        **_group(
            "periodic_disturbance",
            _wave("periodic_disturbance", 0.05 * size, 0.03 / s.span_s, 1e-2, 3.0 / s.tick_s),
        ),
    }


def _far(
    factors: Sequence[Values], coordinates: Mapping[str, Coordinate], *starts: tuple[float, ...]
) -> Group:
    """The largest start from other plants too."""
    plain = next(iter(_group("", coordinates, *starts).values()))
    return Group(plain.coordinates, (*plain.starts, *(plain.starts[-1] | each for each in factors)))


def _sensor(s: Scales) -> dict[str, Group]:
    return {
        "backlash": _far(
            PLAYING,
            _linear("backlash.gap", 0.1 * s.swing, 1e-4 * s.swing, WIDEST * s.swing),
            *((x * s.swing,) for x in (0.006, 0.03, 0.15, 0.5)),
        ),
        **_group(
            "position_ripple",
            _wave("position_ripple", 0.01 * s.swing, 0.03 / s.travel, *_repeating(s)),
        ),
        **_group(
            "sensor_lag",
            _linear("sensor_lag.time", 1.0 / s.omega_n, _shortest(s), 0.1),
            *((min(x / s.omega_n, 0.05),) for x in (0.1, 0.5)),
        ),
    }


def _repeating(s: Scales) -> tuple[float, float]:
    """Wavenumbers of a ripple [rad/unit]: longer waves are a bend, shorter ones a sensor's rounding."""
    highest = 2.0 * math.pi / (STEPS_SEEN * s.step) if s.step > 0.0 else 1e6
    return min(2.0 * math.pi * WAVES_SEEN / s.travel, 0.5 * highest), highest


def _plant(s: Scales) -> dict[str, Group]:
    places = ["K_L", "omega_n", "zeta"]
    size, kinds = 0.1 / s.span_s, ""
    if s.warmer:
        size, kinds = 0.01, "_thermal"
    drift: dict[str, Coordinate] = {}
    for place in places:
        drift |= _signed(f"parameter_drift.{place}{kinds}", size, 1.0)
    return _group("parameter_drift", drift, (0.1 * size,) * 3)


def _wave(name: str, scale: float, narrow: float, low: float, high: float) -> dict[str, Coordinate]:
    """`narrow` is a change of the wave's number by which its far end hardly moves."""
    number = f"{name}.{WAVES[name]}"
    largest = next(each.high for each in EFFECTS[name].parameters if each.name == "amplitude")
    return {
        **_signed(f"{name}.cosine", scale, 0.7 * largest),
        **_signed(f"{name}.sine", scale, 0.7 * largest),
        number: Coordinate(number, narrow, low, high, logarithm=False),
    }


def remote(start: Values) -> bool:
    """Whether a start is far from the parent's own plant."""
    return not {"*K_L", "K_L", "zeta"}.isdisjoint(start)


def begun_from(values: Values, start: Values) -> Values:
    """A parent's parameters with those of a start, and its factors."""
    factors = {place: start.get(f"*{place}", 1.0) for place in values}
    return {place: value * factors[place] for place, value in values.items()} | start
