"""Friction of the load: dry, falling with the speed, and on bristles that give way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.cause import (
    Alike,
    Cause,
    Coordinate,
    Cycle,
    Grid,
    Plain,
    SamePlant,
    linear,
    sized,
)
from seod.diagnose.causes.flow import null_of_load
from sim.effects import STEEPEST as STEEPEST_SIMULATED
from sim.effects import STIFFEST, stiffest_bristles

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Effects

STUCK_BASELINE: Final = ({"*K_L": 2.0, "*zeta": 0.5}, {"*K_L": 2.0, "*zeta": 2.0})
"""Factors where a baseline took friction for little gain: damped little, and much."""
LEAST_FRICTION: Final = 1e-4
MOST_FRICTION: Final = 1e3
"""Friction over the pressure that accelerates the load: most of it where a relay nearly stalls the load. Its
logarithm is searched: along the valleys between friction and plant all change in proportion."""
LEVELS: Final = (0.02, 0.1, 0.3)
"""Starts of it; chosen."""
FALLING: Final = ((0.05, 0.1), (0.1, 0.4), (0.3, 0.15))
"""Starts of friction that falls: its level likewise, and its speed over the typical one; chosen."""
SLOWEST_FALL, QUICKEST_FALL = 0.05, 300.0
"""Speed at which friction has fallen, over the typical one, at least and at most: of more it never falls."""
VISCOUS_STARTS: Final = ((1.0,), (0.2,), (0.5,))
"""Part of the damping that is viscous friction: all of it, as in an electric drive, some, or half; chosen."""
LEAST_STIFF: Final = 0.01
"""Squared natural frequency of the oil over that of Eq. 1, at least: of zeta from 1 on half of the damping on
either side leaves no oil at all."""
SHOW_VISCOUS_FRICTION: Final = frozenset(
    {"coulomb_friction", "stribeck_friction", "load_resonance", "square_root_flow", "measured_disturbance"}
)
"""Causes beside which damping by the load is not damping by leakage: a spring or a constant load changes the
numbers of Eq. 1 alone."""
STEEPEST: Final = 1e-4
"""The same over the pressure [s], at least: steeper friction asks for many substeps."""
SLOW_FALL: Final = 20.0
"""Speed at which friction has fallen, over the typical one, where it begins as one that hardly does."""
LITTLE_DRIVE: Final = 0.1
"""Slope of that friction over the damping of the plant, at most: it drives the load."""
STIFFEST_PART: Final = 0.999
"""Of the steepest fall that can be simulated, at most."""
STIFFEST_LUGRE: Final = 2e3
"""Of LuGre's bristles: friction level over what they give way by, in oscillations; stiffer ones stick."""
STIFFEST_SIMULATED: Final = 1e9
"""Stiffness of bristles, at most [1/s^2]: the simulated plant's own limit."""
SOFTEST_LUGRE: Final = 0.05
"""Stiffness of bristles over pressure by oscillation, at least: softer ones are a spring; chosen."""
LEAST_LUGRE_DAMPING, LARGEST_LUGRE_DAMPING = 1e-3, 1e3
"""Damping of bristles over omega_n, at least and at most; chosen."""
MOST_LUGRE_DAMPING: Final = 4.0
"""Damping of bristles over the square root of their stiffness, at most: 2 is critical."""
LUGRE_DAMPING_START: Final = 0.5
"""The same where a search begins; chosen."""
LUGRE_GIVES: Final = 0.04
LUGRE_GIVE_START: Final = 0.1
"""What bristles give way by, over the amplitude; a share of it by which they begin to settle."""
LUGRE_LEVEL, LUGRE_WAYS = 0.2, (0.03, 0.003)
"""Starts without plain friction to go by: its level over the pressure, and what bristles give way by, over
the amplitude; chosen."""
GRID_LEVELS: Final = (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)
"""Friction in the relay's grid, over the pressure at which the load would stall: denser near it."""
GRID_LEVELS_PAIRED: Final = (0.3, 0.6, 0.85)
"""The same beside another cause of the grid."""
GRID_SHARE: Final = 0.9
"""Of the damping that is viscous friction in the grid: from near all of it a fit finds the part; chosen."""
FALLEN_SPEED: Final = 0.45
"""Of friction in the grid, the speed at which it has fallen: over the limit cycle's largest without it."""
STEEPEST_FALL: Final = 1.001 / STEEPEST_SIMULATED
"""Least speed at which friction has fallen, over its level [s]: just above the simulation's own limit."""


def lugre_values(level: float, half: float, share: float = 1.0) -> Values:
    """Stiffness [1/s^2] and damping [1/s] of bristles, by place, that bear a friction.

    Args:
        level: Of the friction [unit/s^2].
        half: How far the load moves either way [unit].
        share: What the bristles give way by, over `LUGRE_GIVES` times `half`.
    """
    stiff = min(level / (share * LUGRE_GIVES * half), STIFFEST * level)
    return {
        "lugre_friction.stiffness": stiff,
        "lugre_friction.damping": LUGRE_DAMPING_START * math.sqrt(stiff),
    }


def _both_damped(values: Values) -> float:
    """What damping on both sides adds to Eq. 1's squared natural frequency, over (2 zeta omega_n)^2."""
    share = values["viscous_friction.share"]
    return share * (1.0 - share)


def _with_viscous(values: Values) -> Values:
    """From K_L, omega_n and zeta of Eq. 1: those with which a part of the damping acts on the load."""
    part = max(1.0 - 4.0 * values["zeta"] ** 2 * _both_damped(values), LEAST_STIFF)
    return _rescaled(values, part)


def _without_viscous(values: Values) -> Values:
    """The other way round."""
    return _rescaled(values, 1.0 + 4.0 * values["zeta"] ** 2 * _both_damped(values))


def _rescaled(values: Values, part: float) -> Values:
    """With so many times the squared natural frequency, as much damping, and the same speed for a volt."""
    root = math.sqrt(part)
    return {
        "K_L": values["K_L"] / part,
        "omega_n": values["omega_n"] * root,
        "zeta": values["zeta"] / root,
    }


def _levels(s: Scales) -> Coordinate:
    return sized("level", LEAST_FRICTION * s.pressure, MOST_FRICTION * s.pressure)


def _falling(s: Scales) -> tuple[Coordinate, ...]:
    slowest = max(SLOWEST_FALL * s.speed, STEEPEST * s.pressure)
    return _levels(s), sized("speed", slowest, QUICKEST_FALL * s.speed)


def _hardly_falling(values: Values, s: Scales) -> Values:
    """From plain friction: it begins as one that hardly falls."""
    level, damping = values["coulomb_friction.level"], 2.0 * values["zeta"] * values["omega_n"]
    speed = max(SLOW_FALL * s.speed, math.sqrt(2.0 * level * s.speed / (LITTLE_DRIVE * damping)))
    return {"stribeck_friction.level": level, "stribeck_friction.speed": speed}


def _grid_falling(shares: Values, _: Values, cycle: Cycle) -> Values:
    level = shares["stribeck_friction.level"] * cycle.stalls
    speed = max(shares["stribeck_friction.speed"] * cycle.omega * cycle.half, STEEPEST_FALL * level)
    return {"stribeck_friction.level": level, "stribeck_friction.speed": speed}


def _within_fall(effects: Effects, _: Scales) -> None:
    falls = effects["stribeck_friction"]
    falls["level"] = min(falls["level"], STIFFEST_PART * STEEPEST_SIMULATED * falls["speed"])


def _lugre(s: Scales) -> tuple[Coordinate, ...]:
    softest, stiffest = (
        SOFTEST_LUGRE * s.pressure / s.peak_to_peak,
        STIFFEST_LUGRE * s.pressure / s.peak_to_peak,
    )
    return (
        sized("stiffness", softest, min(stiffest, STIFFEST_SIMULATED)),
        sized("damping", LEAST_LUGRE_DAMPING * s.omega_n, LARGEST_LUGRE_DAMPING * s.omega_n),
    )


def _lugre_starts(s: Scales) -> tuple[tuple[float, ...], ...]:
    stiff = [LUGRE_LEVEL * s.pressure / (x * s.peak_to_peak) for x in LUGRE_WAYS]
    return tuple((x, LUGRE_DAMPING_START * math.sqrt(x)) for x in stiff)


def _within_level(effects: Effects, s: Scales) -> None:
    lugre, level = effects["lugre_friction"], effects["coulomb_friction"]["level"]
    falls = {f"stribeck_friction.{of}": value for of, value in effects.get("stribeck_friction", {}).items()}
    stiffest = min(STIFFEST_LUGRE / s.peak_to_peak, STIFFEST_PART * stiffest_bristles(falls))
    lugre["stiffness"] = min(lugre["stiffness"], stiffest * level)
    most = MOST_LUGRE_DAMPING * math.sqrt(lugre["stiffness"])
    lugre["damping"] = min(lugre["damping"], most)


COULOMB_FRICTION: Final = Cause(
    name="coulomb_friction",
    says="Seals or bearings rub: a constant force against the movement, which holds the load at rest.",
    coordinates=lambda s: (_levels(s),),
    starts=lambda s: tuple((x * s.pressure,) for x in LEVELS),
    remote=lambda _: STUCK_BASELINE,
    grid=Grid(
        sizes=lambda shares, _, cycle: {
            "coulomb_friction.level": shares["coulomb_friction.level"] * cycle.stalls
        },
        alone=(
            *({"coulomb_friction.level": x} for x in GRID_LEVELS),
            *({"coulomb_friction.level": x, "viscous_friction.share": GRID_SHARE} for x in GRID_LEVELS),
        ),
        paired=tuple({"coulomb_friction.level": x} for x in GRID_LEVELS_PAIRED),
    ),
    alike=(
        Alike(
            "valve_deadband",
            lambda v, _: {
                "valve_deadband.half_width": abs(v["coulomb_friction.level"] * null_of_load(v)),
            },
        ),
    ),
    holds="level",
)
STRIBECK_FRICTION: Final = Cause(
    name="stribeck_friction",
    says="Friction is larger at low speed than at high speed.",
    coordinates=_falling,
    starts=lambda s: tuple((x * s.pressure, v * s.speed) for x, v in FALLING),
    remote=lambda _: STUCK_BASELINE,
    within=_within_fall,
    plain=(
        Plain(
            "coulomb_friction",
            becomes=lambda v, _: {"coulomb_friction.level": v["stribeck_friction.level"]},
            grows=_hardly_falling,
        ),
    ),
    grid=Grid(
        sizes=_grid_falling,
        alone=tuple(
            {"stribeck_friction.level": x, "stribeck_friction.speed": FALLEN_SPEED} for x in GRID_LEVELS
        ),
    ),
)
VISCOUS_FRICTION: Final = Cause(
    name="viscous_friction",
    says="Friction in proportion to the load's speed (seals, a motor) is {figure} % of the damping, "
    "leakage the rest.",
    coordinates=lambda _: (linear("share", 1.0, 0.0, 1.0),),
    starts=lambda _: VISCOUS_STARTS,
    shown_by=SHOW_VISCOUS_FRICTION,
    twin={"viscous_friction.share": 1.0},
    same_plant=SamePlant(_with_viscous, _without_viscous),
    grid=Grid(sizes=lambda shares, *_: {"viscous_friction.share": shares["viscous_friction.share"]}),
    figure=lambda e: 100.0 * e["viscous_friction"]["share"],
    tells_lags_apart=False,
)
LUGRE_FRICTION: Final = Cause(
    name="lugre_friction",
    says="The friction gives way by {figure} (unit of position) before it slides.",
    coordinates=_lugre,
    starts=_lugre_starts,
    within=_within_level,
    plain=(
        Plain(
            "coulomb_friction",
            becomes=None,
            grows=lambda v, s: lugre_values(v["coulomb_friction.level"], s.peak_to_peak),
        ),
    ),
    grid=Grid(
        sizes=lambda shares, sizes, cycle: lugre_values(
            sizes["coulomb_friction.level"], cycle.half, shares["lugre_friction.give"]
        ),
        begins=lambda sizes, half: lugre_values(sizes["coulomb_friction.level"], half),
        settles={"lugre_friction.give": LUGRE_GIVE_START},
    ),
    states=("loose",),
    figure=lambda e: e["coulomb_friction"]["level"] / e["lugre_friction"]["stiffness"],
)
FRICTION: Final = (COULOMB_FRICTION, STRIBECK_FRICTION, VISCOUS_FRICTION, LUGRE_FRICTION)
