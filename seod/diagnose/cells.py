"""Plants with dry friction, play, or both, or shaken ones, that a relay's recording may come from, by a grid.

Under a relay Eq. 1 alone fits a limit cycle to some percent with a plant far from the right one, from which
no descent leads there. How a plant sticks, or what it loses in a play, depends, but for its size, on three
numbers only: omega_n, zeta, and a share: friction over the pressure at which the load would stall, play over
the swing. With both it is one share more. A delay moves the answer in time. So each cell costs one simulation
from rest, whatever the gain and the delay. From the best cells least squares go on: a play that takes most of
the swing leaves valleys narrower than the grid.

A relay may have locked to a disturbance of its own frequency, which hides the plant in the limit cycle's
fundamental: of those plants only what is beside the fundamental is compared.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.cell import RUBS, Cell
from seod.diagnose.command_period import relay_period_s
from seod.diagnose.stretch import Stretch

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.diagnose.coordinates import Values
    from seod.diagnose.windows import Cut

QUICKER: Final = (*np.geomspace(0.8, 5.0, 14).tolist(), 7.0, 10.0)
"""omega_n over the limit cycle's frequency."""
QUICKER_SHAKEN: Final = tuple(np.geomspace(0.4, 5.0, 18).tolist())
"""omega_n over the limit cycle's frequency; of a plant that a disturbance shakes."""
DAMPINGS: Final = (0.05, 0.15, 0.3, 0.6, 1.2, 4.0)
FALLEN: Final = 0.45
SHARES: Final[tuple[Values, ...]] = (
    *({"coulomb_friction.level": share} for share in (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)),
    *(
        {"stribeck_friction.level": share, "stribeck_friction.speed": FALLEN}
        for share in (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)
    ),
    *({"backlash.gap": share} for share in (0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.92)),
    *(
        {"coulomb_friction.level": rubs, "backlash.gap": plays}
        for rubs, plays in product((0.3, 0.6, 0.85), (0.15, 0.35, 0.6, 0.9))
    ),
)
"""Of friction and of play; what play is left of a swing that friction makes smaller. The speed at which
friction has fallen is a share of the limit cycle's largest without it."""
NEAR: Final = 3.0
"""Mean log error over the least, up to which a cell goes on with how the limit cycle grew."""
KEPT: Final = 4
KEPT_LATE: Final = 2
"""Cells that are kept, of different damping: without a delay, and with one."""
RUBBED: Final = 2
"""Plants with plain friction that settle with bristles."""


def cells(cut: Cut) -> tuple[Cell, ...]:
    """Of a relay's recording: the best plants of each kind without a delay, and the best with one.

    Those with plain friction also on bristles, and those that come near also by how the limit cycle grew.
    """
    grid, grown, found = Stretch(cut), Stretch(cut, grown=True), list[Cell]()
    if not grid.pieces:
        return ()
    kinds: dict[frozenset[str], list[Cell]] = {}
    for at in product(QUICKER, DAMPINGS, SHARES):
        for cell in grid.cells(*at):
            kinds.setdefault(cell.causes, []).append(cell)
    for own in kinds.values():
        found += [grid.settled(cell) for cell in _kept(own)]
    rubbed = [cell for cell in found if cell.causes == {RUBS} and cell.delay == 0.0]
    rubbed.sort(key=lambda cell: cell.cost)
    found += [grid.settled(cell.on_bristles()) for cell in rubbed[:RUBBED]]
    near = min((cell.cost for cell in found), default=0.0) + NEAR
    found += [grown.settled(cell) for cell in found if cell.cost < near]
    return (*found, *_shaken(cut))


def _shaken(cut: Cut) -> list[Cell]:
    """Likewise plants with a disturbance of the limit cycle's frequency, where it has one."""
    one = cut.series[cut.windows[0][0]]
    period = relay_period_s(one.t_u, one.u)
    if period is None:
        return []
    grid = Stretch(cut, 2.0 * math.pi / period)
    every = [cell for at in product(QUICKER_SHAKEN, DAMPINGS) for cell in grid.cells(*at, {})]
    kept = [grid.settled(cell) for cell in _kept(every) if math.isfinite(cell.cost)]
    return [grid.shaken(cell) for cell in kept]


def _kept(some: Sequence[Cell]) -> list[Cell]:
    prompt = _best(cell for cell in some if cell.delay == 0.0)[:KEPT]
    return prompt + _best(cell for cell in some if cell.delay > 0.0)[:KEPT_LATE]


def _best(some: Iterable[Cell]) -> list[Cell]:
    best: dict[float, Cell] = {}
    for cell in sorted(some, key=lambda one: one.cost):
        best.setdefault(cell.zeta, cell)
    return list(best.values())
