"""Whether a cause is only how commands were recorded: late, or seldom."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.causes.table import answered_as
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.record.command_timing import Timing, timings
from seod.diagnose.tuning.record import COMMAND_TIMING
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    found: Fitted, without: Mapping[str, Fitted], held_out: Cut, parallel: ParallelMap
) -> OtherTiming | None:
    """The timing by which a set does without one of its causes and errs no more; None where none does.

    Args:
        found: A set of causes.
        without: Of each the set without it.
        held_out: Windows that no fit has seen.
        parallel: Maps a function over fits.
    """
    own, tick = Judged.of(found, held_out), found.cut.series[0].tick
    trials = [
        (name, one, timing)
        for name, one in without.items()
        if EFFECTS[name].cause
        for timing in timings(found.cut.series)
    ]
    told = list(parallel(lambda each: _timed(each[1], held_out, each[2]), trials))
    better = [
        (one.held.log_error + one.found.cost, OtherTiming(timing, answered_as(name), timing.lead * tick))
        for (name, _, timing), one in zip(trials, told, strict=True)
        if one.held.log_error <= own.held.log_error and one.found.cost <= own.found.cost
    ]
    return min(better, key=lambda one: one[0])[1] if better else None


def _timed(found: Fitted, held_out: Cut, timing: Timing) -> Judged:
    """A set fitted anew to windows with other commands."""
    cut, unseen = (
        replace(one, series=[timing.of(each) for each in one.series]) for one in (found.cut, held_out)
    )
    start = begun_states(found.model, found.x, cut, found.start)
    return Judged.of(fit(found.model, cut, found.x, start, COMMAND_TIMING.fit_steps), unseen)
