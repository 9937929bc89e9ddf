"""Windows for trying causes, and what all trials need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import LATE
from seod.diagnose.record.windows import Cut, sample, sparse
from seod.diagnose.starts.baseline import unchanged
from seod.diagnose.starts.relay.grid import grid_plants
from seod.diagnose.tuning.search import SCREEN

if TYPE_CHECKING:
    from collections.abc import Iterable

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.search.budget import Budget
    from seod.diagnose.starts.relay.plant import GridPlant


@dataclass(frozen=True, slots=True)
class Screen:
    """Windows for trying causes.

    Attributes:
        every: All windows to fit.
        cut: Some of them.
        few: Fewer still: which of `cut`.
        parallel: Maps a function over trials, in parallel.
        budget: What the search may use.
        grid_plants: Plants to begin from, of a relay's recording.
    """

    every: Cut
    cut: Cut
    few: tuple[int, ...]
    parallel: ParallelMap
    budget: Budget
    grid_plants: tuple[GridPlant, ...] = ()

    def plants(self, model: Model, names: Iterable[str]) -> list[GridPlant]:
        """Those of the grid that a set of these effects may begin from, with the sign of the model's gain."""
        sign = model.coordinates[0].scale
        return [one for one in self.grid_plants if one.K_L * sign > 0.0 and one.begins(names)]

    def grid_sets(self, model: Model) -> list[Fitted]:
        """Of each kind the plant of the grid that comes nearest, as a set of effects; the nearest first."""
        kinds: dict[tuple[str, ...], GridPlant] = {}
        for one in sorted(self.grid_plants, key=lambda each: each.cost):
            kinds.setdefault((*sorted(one.causes), *([LATE] if one.delay > 0.0 else [])), one)
        nearest = list(kinds.items())[: SCREEN.grid_sets]
        return [self._grid_set(model, names, plant) for names, plant in nearest]

    def _grid_set(self, model: Model, names: Iterable[str], plant: GridPlant) -> Fitted:
        own = model.turned(plant.K_L)
        for name in names:
            own = own.with_effect(name)
        values = {each.place: 0.0 for each in own.coordinates}
        at = {place: value for place, value in plant.values().items() if place in values}
        return unchanged(own, own.searched(values | at), self.cut)


def screen(every: Cut, parallel: ParallelMap, budget: Budget) -> Screen:
    """Windows for trying causes, chosen from all windows to fit."""
    cut = sparse(sample(every, SCREEN.screened_s))
    count = max(2, round(len(cut.windows) * SCREEN.probed_s / SCREEN.screened_s))
    few = np.unique(np.linspace(0, len(cut.windows) - 1, count).round().astype(int))
    since = budget.clock()
    begun = grid_plants(cut) if every.relayed else ()
    budget.excuse(since)
    return Screen(every, cut, tuple(few.tolist()), parallel, budget, begun)
