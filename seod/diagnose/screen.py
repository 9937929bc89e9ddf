"""One effect more: every cause tried from every start, the promising ones fitted further."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.begin import simulated_states
from seod.diagnose.command_period import in_step
from seod.diagnose.coordinates import WAVES, group
from seod.diagnose.fit import Fitted, fit, settle
from seod.diagnose.simulate import inside
from seod.diagnose.waves import lines, starts
from seod.diagnose.windows import Cut, sample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.budget import Budget
    from seod.diagnose.coordinates import Values
    from seod.diagnose.fit import Each
    from seod.diagnose.model import Model

PROBED_S: Final = 3.0
"""Of windows on which every start is tried."""
SCREENED_S: Final = 6.0
"""Of windows on which the better causes are fitted."""
GLANCE: Final = 4
"""Steps from every start."""
FAR: Final = 12
"""Steps from one whose K_L and zeta are far from the baseline's."""
STEPS: Final = 14
"""Steps of the better ones."""
BENT: Final = 1.02
"""Wavenumbers of a ripple over the least, up to which the least has stopped it."""
PROMISING: Final = 10
"""Causes that are fitted further."""


@dataclass(frozen=True, slots=True)
class Screen:
    """Windows for trying causes.

    Attributes:
        every: All windows to fit.
        cut: Some of them.
        few: Fewer still: which of `cut`.
        each: Maps a function over trials, in parallel.
        budget: What the search may use.
    """

    every: Cut
    cut: Cut
    few: tuple[int, ...]
    each: Each
    budget: Budget

    def start(self, parent: Model, x: Array) -> Array:
        """Initial states on `cut` for a model fitted elsewhere, shape (w, 7)."""
        return settle(parent, self.cut, x, simulated_states(parent, x, self.cut), self.cut.good)

    def extended(self, parent: Fitted, causes: Sequence[str]) -> list[Fitted]:
        """`parent` with each of these effects more, the best first; not promising ones after a glance."""
        fewer = self.cut.only(self.few)
        begun = parent.start[list(self.few)]
        trials = [(name, start) for name in causes for start in self.starts(parent, name)]

        def glance(trial: tuple[str, Values]) -> Fitted | None:
            if self.budget.spent:
                return None
            model = parent.model.with_effect(trial[0])
            x = model.searched(begun_from(parent.model.values(parent.x), trial[1]))
            return fit(
                model, fewer, x, begun, FAR if "*K_L" in trial[1] else GLANCE, ended=self.budget.trial()
            )

        seen: dict[str, Fitted] = {}
        for (name, _), found in zip(trials, self.each(glance, trials), strict=True):
            if found is not None and (name not in seen or found.cost < seen[name].cost):
                seen[name] = found
        ranked = sorted(seen.values(), key=lambda one: one.cost)

        def further(found: Fitted) -> Fitted:
            ended = self.budget.trial()
            return fit(found.model, self.cut, found.x, self._spread(parent, found), STEPS, ended=ended)

        better = [one for one in self.each(further, ranked[:PROMISING]) if not self.imitates(one)]
        return sorted(better, key=lambda one: one.cost)

    def imitates(self, found: Fitted) -> bool:
        """A wave that stands for something else.

        A disturbance in step with the command is the plant's own answer, the longest ripple a bend.
        """
        values = found.model.values(found.x)
        omega, wavenumber = (values.get(f"{name}.{of}") for name, of in WAVES.items())
        if omega is not None and in_step(self.every, omega):
            return True
        longest = next(
            (c.low for c in found.model.coordinates if c.place == "position_ripple.wavenumber"), 0.0
        )
        return wavenumber is not None and wavenumber < BENT * longest

    def _spread(self, parent: Fitted, found: Fitted) -> Array:
        start = parent.start.copy()
        start[list(self.few)] = found.start
        return start

    def starts(self, parent: Fitted, name: str) -> tuple[Values, ...]:
        """Where to begin with an effect; with a wave at the lines of what the parent leaves."""
        searched = group(name, parent.model.scales)
        if name not in WAVES:
            return searched.starts
        return starts(name, self._lines(parent, name), 0.1 * searched.coordinates[0].scale)

    def _lines(self, parent: Fitted, name: str) -> list[float]:
        """What the residual of all windows shows of a wave."""
        model, x, cut = parent.model, parent.x, self.every
        start = settle(model, cut, x, simulated_states(model, x, cut), cut.good, most=2)
        simulated, states = inside(model.record(x), cut, start)
        residual = np.where(cut.good, cut.gathered("y") - simulated, 0.0)
        speed = states[:, 1] if model.sees_speed else None
        return lines(name, cut, residual, states[:, 2], speed)


def begun_from(values: Values, start: Values) -> Values:
    """A parent's parameters with those of a start, and its factors."""
    factors = {place: start.get(f"*{place}", 1.0) for place in values}
    return {place: value * factors[place] for place, value in values.items()} | start


def screen(every: Cut, each: Each, budget: Budget) -> Screen:
    """Windows for trying causes, chosen from all windows to fit."""
    cut = sample(every, SCREENED_S)
    count = max(2, round(len(cut.windows) * PROBED_S / SCREENED_S))
    few = np.unique(np.linspace(0, len(cut.windows) - 1, count).round().astype(int))
    return Screen(every, cut, tuple(few.tolist()), each, budget)
