"""A grid of plants that a relay's recording may come from: with friction, backlash, or both, or disturbed.

Under a relay Eq. 1 alone fits a limit cycle to some percent with a plant far from the right one, from which
no descent leads there. How a plant sticks, or what it loses in a gap, depends, but for its size, on three
numbers only: omega_n, zeta, and a share: friction over the pressure at which the load would stall, backlash
over the oscillation. With both it is one share more. A delay moves the answer in time. So each point costs
one simulation from rest, whatever the gain and the delay. From the best of them least squares go on: a gap
that takes most of the oscillation leaves valleys narrower than the grid.

A relay may have locked to a disturbance of its own frequency, which hides the plant in the limit cycle's
fundamental: of those plants only what is beside the fundamental is compared.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import CAUSES, RAMPED, SETTLED, grid_shares, ramped_by
from seod.diagnose.record.command_period import relay_period_s
from seod.diagnose.starts.relay.compare import Segment
from seod.diagnose.starts.relay.plant import GridPlant
from seod.diagnose.tuning.starts import GRID

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.diagnose.record.windows import Cut


def grid_plants(cut: Cut) -> tuple[GridPlant, ...]:
    """Of a relay's recording: the best plants of each kind without a delay, and the best with one.

    Those with a plain form also with a richer one beside it, and those that come near also by how the limit
    cycle grew.
    """
    grid, grown, found = Segment(cut), Segment(cut, grown=True), list[GridPlant]()
    if not grid.parts:
        return ()
    kinds: dict[frozenset[str], list[GridPlant]] = {}
    for at in product(GRID.frequencies, GRID.dampings, tuple(grid_shares())):
        for plant in grid.plants(*at):
            kinds.setdefault(plant.causes, []).append(plant)
    for own in kinds.values():
        found += [grid.settled(plant) for plant in _kept(own)]
    for rich in SETTLED:
        plain = [plant for plant in found if plant.causes == {CAUSES[rich].needs} and plant.delay == 0.0]
        plain.sort(key=lambda plant: plant.cost)
        found += [grid.settled(plant.enriched(rich)) for plant in plain[: GRID.settled_richer]]
    near = min((plant.cost for plant in found), default=0.0) + GRID.growth_compared_within
    found += [grown.settled(plant) for plant in found if plant.cost < near]
    return (*found, *_disturbed(cut), *_ramped(cut))


def _ramped(cut: Cut) -> list[GridPlant]:
    """Likewise plants with ramps of different time in the place of the relay's switches."""
    grid = Segment(cut, ramped=True)
    every = (
        plant for at in product(GRID.frequencies_ramped, GRID.dampings) for plant in grid.plants(*at, {})
    )
    first: dict[float, GridPlant] = {}
    for plant in sorted((one for one in every if one.delay > 0.0), key=lambda one: one.cost):
        first.setdefault(plant.delay, plant)
    kept: list[GridPlant] = []
    for plant in sorted((grid.settled(plant) for plant in first.values()), key=lambda one: one.cost):
        if all(abs(math.log(plant.delay / one.delay)) > GRID.other_ramp for one in kept):
            kept.append(plant)
    height = max(float(np.ptp(recording.u)) for recording in cut.series)
    return [
        plant._replace(delay=0.0, sizes=ramped_by(name, plant.delay, height))
        for plant in kept[: GRID.kept_ramps]
        for name in RAMPED
    ]


def _disturbed(cut: Cut) -> list[GridPlant]:
    """Likewise plants with a disturbance of the limit cycle's frequency, where it has one."""
    one = cut.series[cut.windows[0][0]]
    period = relay_period_s(one.t_u, one.u)
    if period is None:
        return []
    grid = Segment(cut, 2.0 * math.pi / period)
    every = [
        plant for at in product(GRID.frequencies_disturbed, GRID.dampings) for plant in grid.plants(*at, {})
    ]
    kept = [grid.settled(plant) for plant in _kept(every) if math.isfinite(plant.cost)]
    return [grid.shaken(plant) for plant in kept]


def _kept(some: Sequence[GridPlant]) -> list[GridPlant]:
    prompt = _best(plant for plant in some if plant.delay == 0.0)[: GRID.kept_prompt]
    return prompt + _best(plant for plant in some if plant.delay > 0.0)[: GRID.kept_late]


def _best(some: Iterable[GridPlant]) -> list[GridPlant]:
    best: dict[float, GridPlant] = {}
    for plant in sorted(some, key=lambda one: one.cost):
        best.setdefault(plant.zeta, plant)
    return list(best.values())
