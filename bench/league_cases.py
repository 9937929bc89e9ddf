"""What `bench/league.py` varies, and the three records that each seed of a case makes."""

from __future__ import annotations

import math
from dataclasses import replace

from accuracy_cases import PLANTS, ZETAS, Case

NOISES = (0.0, 0.002, 0.01, 0.02)
TURN = 0.05
"""omega_n Ts of the grid."""
LEVELS = -1.0 / 3.0
"""Bias of the relay with unequal levels, as a part of e_a: they are as 1 to 2, as Berner advises."""
SETTLED = 1.5
"""Cycles times zeta before the window, in which free motions fall to exp(-3 pi): there is a limit cycle."""


def _case(zeta: float, turn: float, noise: float, **changes: float) -> Case:
    return replace(Case(zeta, turn, noise, before=max(4, math.ceil(SETTLED / zeta))), **changes)


GRID = [_case(zeta, TURN, noise) for noise in NOISES for zeta in ZETAS]
"""One tick of delay, an ideal relay."""

FACTORS: list[dict[str, float]] = [
    {},
    {"delay": 0},
    {"delay": 3},
    {"hysteresis": 0.1},
    {"hysteresis": 0.3},
    {"load": 0.1},
    {"load": 0.3},
    {"unequal": -0.1},
    {"unequal": -0.3},
]
"""Load and unequal gains add to the unequal levels of the relay; the other way they would take from them."""

VARIED = [_case(*plant, noise, **changes) for noise in (0.0, 0.01) for changes in FACTORS for plant in PLANTS]
"""About each of the design's plants."""

QUICK = [_case(*plant, noise) for noise in (0.0, 0.01) for plant in PLANTS]


def unequal_levels(case: Case) -> Case:
    """The case's record under a relay with unequal levels."""
    return replace(case, bias=LEVELS)


def two_phases(case: Case) -> Case:
    """The case's record under a relay of two phases."""
    return replace(case, two_phase=True)


def factor(case: Case) -> str:
    """What is varied about the plant, as `delay=3`; empty: nothing."""
    skipped = ("zeta", "turn", "noise", "before")
    return " ".join(word for word in case.name.split() if word.split("=")[0] not in skipped)
