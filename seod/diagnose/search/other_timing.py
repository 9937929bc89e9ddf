"""Whether a cause is only how commands were recorded: late, or seldom."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.causes.table import answered_as
from seod.diagnose.fitting.beside import beside_lead, promised_by_lead
from seod.diagnose.fitting.command_lead import untimed
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.record.command_timing import Timing, timings
from seod.diagnose.tuning.record import COMMAND_TIMING
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.windows import Cut


class OtherTiming(NamedTuple):
    """Commands given other than recorded.

    Attributes:
        timing: How.
        spares: Cause that is not needed then.
        lead: By how much earlier than recorded that is [s].
    """

    timing: Timing
    spares: str
    lead: float

    @property
    def sentence(self) -> str:
        """A remark."""
        way = "earlier" if self.lead > 0.0 else "later"
        when = f", {abs(self.lead):.3g} s {way} than recorded" if self.lead else ""
        return (
            f"commands are taken to run straight on from look to look{when}: as they are recorded they need "
            f"{self.spares} as well. A logger that looks late, or seldom, makes such records; see --hold"
        )


def other_timing(
    found: Fitted,
    without: Mapping[str, Fitted],
    held_out: Cut,
    parallel: ParallelMap,
    over: Callable[[], bool] = lambda: False,
) -> OtherTiming | None:
    """The timing by which a set does without one of its causes and errs no more; None where none does.

    Args:
        found: A set of causes.
        without: Of each the set without it.
        held_out: Windows that no fit has seen.
        parallel: Maps a function over fits.
        over: Tells when no further fit begins.
    """
    own, tick = Judged.of(found, held_out), found.cut.series[0].tick
    every = timings(found.cut.series)
    causes = [name for name in without if every and EFFECTS[name].cause]
    trials = [(without[name], timing) for name in causes for timing in every]
    tried, better = list(parallel(lambda each: _timed(*each), trials)), []
    for k, name in enumerate(causes):
        some = without[name], *tried[k * len(every) : (k + 1) * len(every)]
        nearest = min(some, key=lambda one: one.cost)
        settled = _settled(nearest, found, without[name], parallel, over)
        if settled is None:
            continue
        timing = Timing.told_by(settled.cut.series[0])
        judged = Judged.of(settled, _given(held_out, timing))
        if judged.held.log_error <= own.held.log_error and settled.cost <= found.cost:
            errs = judged.held.log_error + settled.cost
            better.append((errs, OtherTiming(timing, answered_as(name), timing.lead * tick)))
    return min(better, key=lambda one: one[0])[1] if better else None


def _timed(fitted: Fitted, timing: Timing) -> Fitted:
    """A set fitted anew to windows with other commands."""
    cut = _given(fitted.cut, timing)
    start = begun_states(fitted.model, fitted.x, cut, fitted.start)
    return fit(fitted.model, cut, fitted.x, start, COMMAND_TIMING.fit_steps)


def _settled(
    nearest: Fitted, found: Fitted, fewer: Fitted, parallel: ParallelMap, over: Callable[[], bool]
) -> Fitted | None:
    """Of a set without a cause the one with the time that fits best, near the nearest that was tried.

    None where that is not promised to come halfway from the set without the cause to that with it.
    """
    nearest = replace(nearest, cut=untimed(nearest.cut, nearest.model))
    halfway = found.cost + COMMAND_TIMING.halfway * (fewer.cost - found.cost)
    if nearest.cost > halfway and nearest.cost - promised_by_lead(nearest, parallel) > halfway:
        return None
    return beside_lead(nearest, parallel, over)


def _given(cut: Cut, timing: Timing) -> Cut:
    return replace(cut, series=[timing.of(each) for each in cut.series])
