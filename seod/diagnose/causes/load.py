"""Causes at the load: what pulls at it, and what it carries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.cause import Alike, Cause, Coordinate, Plain, signed, sized
from seod.diagnose.causes.flow import full_pressure, null_of_load
from sim.effects import FAR

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.causes.scales import Scales, Values

BIAS_SCALE, BIAS_START = 0.1, 0.02
"""A constant load over the load pressure: size in whose steps it is searched, and a start; chosen."""
SPRING_SCALE: Final = 0.1
SPRINGS: Final = (0.02, 0.2)
"""Stiffness over that of the oil, omega_n^2: size in whose steps it is searched, and starts; chosen."""
STIFFEST_SPRING: Final = 1e7
"""Of a spring [1/s^2]: the simulated plant's own limit."""
LEAST_INERTIA, MOST_INERTIA = 1e-3, 10.0
"""Second inertia over the first: less is not seen beside noise, more has become the first; chosen."""
LEAST_RESONANCE, LARGEST_RESONANCE = 0.1, 20.0
"""Frequency of a second inertia over omega_n, at least and at most: farther off the inertias move as one."""
SLOWEST_RESONANCE: Final = 1.0
"""Of it, at least [rad/s]: the simulated plant's own limit."""
RESONANCE_TICKS: Final = 2.0
"""Of it times the sampling interval, at most: a third of a wave between samples."""
LEAST_RESONANCE_DAMPING, MOST_RESONANCE_DAMPING = 2e-3, 0.5
"""Damping ratio of a second inertia: of steel alone, to where it no longer resonates; chosen."""
BENT_AT_NULL: Final = frozenset({"valve_deadband", "asymmetric_gain", "square_root_flow"})
"""Causes that bend the flow where the valve is closed."""
INERTIA_STARTS: Final = (
    *((0.2, x, 0.05) for x in (0.6, 1.3, 2.5, 5.0)),
    *((1.0, x, 0.05) for x in (1.3, 1.8)),
)
"""Inertia, frequency over omega_n, and damping ratio: a light one at four places, a heavy one near the
plant's own, where it splits its resonance; chosen."""


HEAVY_BELOW: Final = ((0.7, 1.0, 0.28), (0.5, 3.0, 0.15), (0.5, 3.0, 0.3))
"""Factor on omega_n, inertia, and frequency over the baseline's omega_n, of a heavy one behind a soft shaft:
the baseline took the higher resonance for the plant's own, sqrt(1 + inertia) times as high; chosen."""


def null_for(load: Callable[[Values], float]) -> Alike:
    """A valve's null in place of a constant load: they differ where the flow bends, which is at the null.

    Args:
        load: The constant load [unit/s^2] from the values of a set.
    """
    return Alike(
        "null_shift",
        lambda v, _: {"null_shift.voltage": load(v) * null_of_load(v)},
        distinguished_by=BENT_AT_NULL,
    )


def _spring(s: Scales) -> tuple[Coordinate, ...]:
    return (
        signed("stiffness", SPRING_SCALE * s.omega_n**2, STIFFEST_SPRING),
        signed("centre", s.travel, FAR),
    )


def _at_0(values: Values) -> float:
    """Load of a spring at position 0 [unit/s^2]."""
    return -values["load_spring.stiffness"] * values["load_spring.centre"]


def _resonance(s: Scales) -> tuple[Coordinate, ...]:
    least = max(LEAST_RESONANCE * s.omega_n, SLOWEST_RESONANCE)
    return (
        sized("inertia", LEAST_INERTIA, MOST_INERTIA),
        sized("omega", least, min(LARGEST_RESONANCE * s.omega_n, RESONANCE_TICKS / s.tick_s)),
        sized("zeta", LEAST_RESONANCE_DAMPING, MOST_RESONANCE_DAMPING),
    )


def _heavy_below(s: Scales) -> tuple[Values, ...]:
    return tuple(
        {
            "*omega_n": factor,
            "load_resonance.inertia": inertia,
            "load_resonance.omega": max(x * s.omega_n, SLOWEST_RESONANCE),
        }
        for factor, inertia, x in HEAVY_BELOW
    )


LOAD_BIAS: Final = Cause(
    name="load_bias",
    says="A constant load pulls: gravity, an unbalanced cylinder, or a valve whose centre is not at 0 V.",
    coordinates=lambda s: (signed("acceleration", BIAS_SCALE * s.pressure, FAR),),
    starts=lambda s: ((BIAS_START * s.pressure,),),
    alike=(
        Alike(
            "asymmetric_gain",
            lambda v, s: {"asymmetric_gain.ratio": -v["load_bias.acceleration"] / full_pressure(v, s)},
            two_commands_only=True,
        ),
        null_for(lambda v: v["load_bias.acceleration"]),
    ),
    offset="acceleration",
    drift="drift",
    tells_lags_apart=False,
)
LOAD_SPRING: Final = Cause(
    name="load_spring",
    says="The load pulls back to where it belongs: a spring, a pendulum, a hinge moment.",
    coordinates=_spring,
    starts=lambda s: tuple((x * s.omega_n**2, s.centre) for x in SPRINGS),
    plain=(Plain("load_bias", becomes=lambda v, _: {"load_bias.acceleration": _at_0(v)}),),
    alike=(null_for(_at_0),),
    states=("position",),
    pulls=("stiffness", "centre"),
    tells_lags_apart=False,
)
LOAD_RESONANCE: Final = Cause(
    name="load_resonance",
    says="A second inertia oscillates behind a shaft or a structure that gives.",
    coordinates=_resonance,
    starts=lambda s: tuple((inertia, x * s.omega_n, zeta) for inertia, x, zeta in INERTIA_STARTS),
    remote=_heavy_below,
    states=("velocity2", "position2"),
    tells_lags_apart=False,
)
LOAD: Final = (LOAD_BIAS, LOAD_SPRING, LOAD_RESONANCE)
