"""From recordings to a diagnosis: baseline, causes, what they gain, what is left."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

from seod.diagnose.answer import DiagnoseError
from seod.diagnose.begin import Begun, baseline, scales
from seod.diagnose.budget import Budget, further_s
from seod.diagnose.choose import Choice, choose
from seod.diagnose.column_check import gain_remarks
from seod.diagnose.conclude import Found, answered, trimmed
from seod.diagnose.defects import examine
from seod.diagnose.fit import fit
from seod.diagnose.halves import finer, one_sided
from seod.diagnose.judge import Judged
from seod.diagnose.name import Chosen, found_effects
from seod.diagnose.ramped import ramped_instead
from seod.diagnose.rated import rated
from seod.diagnose.roots import roots
from seod.diagnose.score import held_out
from seod.diagnose.screen import screen
from seod.diagnose.select import grow
from seod.diagnose.states import simulated_states
from seod.diagnose.windows import cut, pieces, series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.answer import Diagnosis, Output
    from seod.diagnose.fit import Each
    from seod.diagnose.screen import Screen
    from seod.diagnose.windows import Cut, Series

    Progress = Callable[[str, float], None]

MOSTLY_NOISE: Final = 0.7
"""NRMSE of noise alone from which on nothing can be told."""
WORKERS: Final = 2


@dataclass(frozen=True, slots=True)
class Options:
    """What the user tells.

    Attributes:
        output: What `y` is.
        config: The rig whose model is the baseline; None: Eq. 1.
        axis: Of that rig; None: its first.
        search_s: Processor time after which no further cause is tried [s]; None: by the recordings' length.
    """

    output: Output = "position"
    config: RigConfig | None = None
    axis: str | None = None
    search_s: float | None = None


def diagnose(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    options: Options | None = None,
    progress: Progress = lambda _what, _part: None,
    clock: Callable[[], float] = time.process_time,
) -> Diagnosis:
    """Find what Eq. 1, or a rig's model, gets wrong in recordings.

    Args:
        recordings: At least one.
        holdout: Further ones, that no fit sees.
        options: See there.
        progress: Called with what is being done and the part of all work that is.
        clock: Tells the processor time used so far [s].

    Raises:
        DiagnoseError: A recording tells nothing.
    """
    wishes = options or Options()
    sees_speed = wishes.output == "velocity"
    rows = sum(len(each.t) for each in recordings)
    own = Budget(clock, further=further_s(rows))
    budget = own if wishes.search_s is None else Budget(clock, wishes.search_s)
    rig = rated(wishes.config, wishes.axis)
    checked = [examine(each) for each in (*recordings, *holdout)]
    every = [
        series(
            each, defects.bad, sees_speed=sees_speed, step=defects.step, late=defects.late, **rig.conditions
        )
        for each, defects in zip((*recordings, *holdout), checked, strict=True)
    ]
    with ThreadPoolExecutor(WORKERS) as pool:
        way = _Way(sees_speed, rig.effects, pool.map, budget, progress)
        progress("fitting Eq. 1", 0.0)
        start = _start(every, len(holdout), way)
        found = _search(start, way)
        if any(each.name == "outliers" for defects in checked for each in defects.found):
            found = trimmed(found)
    progress("comparing", 0.9)
    answer = answered(found, start.to_fit, start.aside, checked, wishes.output)
    name = str(recordings[0].paths[0])
    remarks = gain_remarks(name, answer.extended.K_L, rig.K_L)
    answer = replace(answer, remarks=(*answer.remarks, *remarks, *budget.remarks))
    progress("done", 1.0)
    return answer


class _Way(NamedTuple):
    """How it is searched: `known` are effects of the rig's model."""

    sees_speed: bool
    known: Mapping[str, Mapping[str, float]]
    each: Each
    budget: Budget
    progress: Progress


class _Start(NamedTuple):
    """Where causes are searched: windows to fit, windows held out, and Eq. 1 on them."""

    to_fit: Cut
    aside: Cut
    screened: Screen
    begun: Begun
    base: Judged


def _start(every: Sequence[Series], whole: int, way: _Way) -> _Start:
    """With so many windows that both halves show what Eq. 1 does not, if there are such."""
    usual = _started(*cut(every, whole), way)
    fitted = usual.base.found
    if one_sided(Judged.of(fitted, usual.to_fit).held, usual.base.held):
        others = finer(every, whole, fitted)
        if others is not None:
            return _started(*others, way)
    return usual


def _started(to_fit: Cut, aside: Cut, way: _Way) -> _Start:
    small = pieces(to_fit)
    screened = screen(small, way.each, way.budget)
    begun = baseline(screened.cut, way.sees_speed, way.known, way.each)
    first = begun.best
    base = fit(first.model, small, first.x, simulated_states(first.model, first.x, small), each=way.each)
    plain = held_out(base.model, base.x, aside)
    if plain.floor > MOSTLY_NOISE:
        raise DiagnoseError(
            f"y is noise for the most part ({100 * plain.floor:.0f} % of its deviation): "
            "a diagnosis needs a movement"
        )
    return _Start(to_fit, aside, screened.watching(base), begun, Judged(base, plain))


def _search(start: _Start, way: _Way) -> Found:
    to_fit, aside, screened, begun, base = start
    small, progress = pieces(to_fit), way.progress
    sizes = scales(begun.near, begun.near.cut)
    if base.held.nrmse < 1.0:  # else it is no plant whose pressure says anything
        sizes = replace(sizes, pressure=min(sizes.pressure, scales(base.found, small).pressure))
    starts = roots(base.found, begun, sizes, screened)
    progress("trying causes", 0.1)
    grown = grow(screened, starts, lambda part: progress("trying causes", 0.1 + 0.5 * part))
    progress("fitting the best", 0.6)
    choice = choose(base, grown, small, aside, screened)
    ramped = ramped_instead(choice.best.found, way.sees_speed)
    if ramped is not None:
        choice = Choice(choice.base, choice.base, {})
    progress("measuring the gain", 0.8)
    chosen = Chosen(choice.best.found, choice.without, choice.best.held)
    effects = found_effects(chosen, screened, grown.tried)
    seen = Judged.of(chosen.found, to_fit).held
    said = () if ramped is None else (ramped.said,)
    return Found(choice.base.found, choice.base.held, chosen, seen, tuple(effects), grown, remarks=said)
