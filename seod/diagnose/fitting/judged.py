"""A set of effects fitted to all windows, and what it is worth where no fit has seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

from seod.diagnose.causes.table import CAUSES
from seod.diagnose.fitting.held_out import HeldOut, simulate_held_out, wholes
from seod.diagnose.fitting.initial_states import alike_states, carried_states

if TYPE_CHECKING:
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


@dataclass(frozen=True)
class Judged:
    """A set of effects fitted to all windows, and its simulation of those held out."""

    found: Fitted
    held: HeldOut

    @classmethod
    def of(cls, fitted: Fitted, held_out: Cut) -> Self:
        """A fitted set, simulated where no fit has seen."""
        return cls(
            fitted, simulate_held_out(fitted.model, fitted.x, held_out, *known_states(fitted, held_out))
        )

    @cached_property
    def whole(self) -> float:
        """NRMSE of one simulation of each whole recording."""
        return wholes(self.found.model, self.found.x, self.held.cut)[1]


def loses_its_place(model: Model, name: str) -> bool:
    """Whether an effect is a wave over a place that nobody measures.

    In one run the load drifts off it, and the wave does harm. A window has a place of its own to begin from.
    """
    wave = CAUSES[name].wave
    return model.sees_speed and wave is not None and wave.over == "place"


def known_states(fitted: Fitted, cut: Cut) -> list[Array]:
    """Initial states of windows by those that were fitted."""
    relayed = cut.relayed
    return [carried_states(fitted, cut), *([alike_states(fitted, cut)] if relayed else [])]


def gain(fewer: Judged, more: Judged) -> float:
    """Of mean log squared error, where it is least: fitted, or held out, where half of it is enough."""
    fitted, held = _gains(fewer, more)
    return min(fitted, 2.0 * held)


def mean_gain(fewer: Judged, more: Judged) -> float:
    """The same, in the mean of windows that were fitted and windows held out."""
    return 0.5 * sum(_gains(fewer, more))


def _gains(fewer: Judged, more: Judged) -> tuple[float, float]:
    return fewer.found.cost - more.found.cost, fewer.held.log_error - more.held.log_error
