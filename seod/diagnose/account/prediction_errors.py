"""Fits by prediction errors, where what is left of a simulation is noise that remembers.

A loop acts on what disturbs the load, so that its commands tell of it. The model whose simulation errs least
is not the plant then: it makes use of that. Errors that the noise's own past does not foretell are free of
it, and fits to them come to the plant, in a loop and without one (Ljung, System Identification, 2nd ed.,
13.4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.account.loop import acts_on_errors, beside_commands, is_closed
from seod.diagnose.account.residual import window_residuals
from seod.diagnose.causes.table import CAUSES
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.least_squares import fit, weighted
from seod.diagnose.fitting.noise_colour import colour
from seod.diagnose.fitting.slow_offset import slow_part
from seod.diagnose.fitting.uncertainty import base_sd, covariance
from seod.diagnose.search.beam import least_gain
from seod.diagnose.tuning.account import PREDICTION
from seod.diagnose.tuning.search import REFINE

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.account.residual import WindowResidual
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.windows import Cut


@dataclass(frozen=True, slots=True)
class Predicted:
    """A set of effects fitted by prediction errors.

    Attributes:
        fitted: It, without the effects that gain too little by their own measure.
        without: Of each effect the set without it, with the noise that this one leaves.
        simulated: The same set fitted by its simulation.
    """

    fitted: Fitted
    without: dict[str, Fitted]
    simulated: Fitted

    @property
    def in_loop(self) -> bool:
        """Whether commands answer to what disturbs the load."""
        return in_closed_loop(self.fitted)

    @property
    def told(self) -> Fitted:
        """By which numbers are told: the simulation's, unless commands answer to what disturbs the load."""
        return self.fitted if self.in_loop else self.simulated


@dataclass(frozen=True)
class Predictions:
    """How such fits are made.

    Attributes:
        base: Eq. 1, or the rig's model, fitted by its simulation.
        asked: Windows of which the noise is what a simulation leaves.
        parallel: As `map`.
        budget: Gives what tells when a fit has had its part.
        noise_alone: Whether a set fitted so leaves nothing systematic.
    """

    base: Fitted
    asked: tuple[Cut, ...]
    parallel: ParallelMap
    budget: Callable[[], Callable[[], bool]]
    noise_alone: Callable[[Fitted], bool] = lambda _: True

    def predicted(self, found: Fitted) -> Predicted | None:
        """From a set fitted by its simulation; None where that leaves white noise.

        Or where the set leaves something systematic, as then a part of it would, too.
        """
        newest = self.with_own_noise(found)
        while newest.cut.memory and self.noise_alone(newest):
            rest = {name: self.without(name, newest) for name in newest.model.names}
            idle = [name for name, one in rest.items() if _saved(one, newest) < least_gain(newest.cut)]
            if not idle:
                cut = found.cut.remembering((), newest.cut.slow)
                return Predicted(newest, rest, self.fitted(newest.model, newest, cut))
            newest = rest[min(idle, key=lambda name: _saved(rest[name], newest))]
        return None

    def without(self, name: str, found: Fitted) -> Fitted:
        """A set without an effect, likewise: without any from the baseline, too.

        Without a wave the noise is the whole set's: noise of a long memory would foretell the wave.
        """
        model = found.model.without(name).shown()
        begins = [found] if model.names else [found, self.base]
        each = [self.fitted(model, one, found.cut) for one in begins]
        if CAUSES[name].wave is None:
            each = [self.with_own_noise(one) for one in each]
        return min(each, key=lambda one: one.cost)

    def saves(self, other: Fitted, found: Fitted) -> bool:
        """Whether another set is likelier for certain, beside the noise of the one that was found.

        Their errors are white: half the mean log squared error of each row is its log likelihood.
        """
        begun = other.model.searched(other.model.values(other.x) | found.model.values(found.x))
        errors = self.fitted(other.model, replace(other, x=begun), found.cut)
        rows = int(np.count_nonzero(found.cut.good))
        return 0.5 * rows * (found.cost - errors.cost) > PREDICTION.likelier

    def with_own_noise(self, found: Fitted) -> Fitted:
        """A set, fitted by what noise does not foretell: what its own simulation leaves.

        In a loop this simulation may be far from the plant's, and noise that is far from the plant's own
        leads no nearer. What is left beside past readings and commands needs no plant: the likelier counts.
        """
        own = found
        for _ in range(PREDICTION.rounds):
            own = self.fitted(own.model, own, self._in_own_noise(own))
        if not self._acts_on_errors(found):
            return own
        return min(
            own, self.fitted(found.model, found, self._beside_commands(found)), key=lambda one: one.cost
        )

    def fitted(self, model: Model, near: Fitted, cut: Cut) -> Fitted:
        """A model from the numbers and initial states of one near it."""
        x = model.searched(near.model.values(near.x))
        same = [near.start] if near.cut.windows == cut.windows else []
        start = begun_states(model, x, cut, *same)
        ended, enough = self.budget(), REFINE.fine_improvement
        return fit(model, cut, x, start, REFINE.fine_steps, self.parallel, ended=ended, enough=enough)

    def _in_own_noise(self, found: Fitted) -> Cut:
        parts = self._left(found)
        if not parts:
            return found.cut.remembering(())
        noise = colour(parts)
        return found.cut.remembering(noise.memory, slow_part(noise, found.cut))

    @cached_property
    def _memory(self) -> tuple[float, ...]:
        return beside_commands(self.asked)

    def _beside_commands(self, found: Fitted) -> Cut:
        noise = replace(colour(self._left(found)), memory=self._memory)
        return found.cut.remembering(noise.memory, slow_part(noise, found.cut))

    def _acts_on_errors(self, found: Fitted) -> bool:
        parts = self._left(found)
        return bool(parts) and acts_on_errors(found.cut.series, parts)

    def _left(self, found: Fitted) -> list[WindowResidual]:
        every = (simulate_held_out(found.model, found.x, cut) for cut in self.asked)
        return [part for held in every for part in window_residuals(held, held_out=False)]


def in_closed_loop(fitted: Fitted) -> bool:
    """Whether commands answer to what was not foretold of the readings before."""
    cut = fitted.cut
    if cut.relayed:
        return True
    error = np.where(cut.good, weighted(fitted.model, cut, fitted.x, fitted.start), 0.0)
    u = cut.gathered("u")
    return is_closed([u[rows] for rows in cut.slices], [error[rows] for rows in cut.slices])


def is_moved(fitted: Fitted) -> bool:
    """Whether commands move the load for certain: by how well K_L is known."""
    gain = fitted.model.values(fitted.x)["K_L"]
    return abs(gain) > PREDICTION.sure_gain * base_sd(fitted, covariance(fitted))["K_L"]


def _saved(without: Fitted, found: Fitted) -> float:
    """Of the mean log squared error, by one of a set's effects."""
    return without.cost - found.cost
