"""A constant load that grows with time, as of a drive that warms up: no window shows it, whole recordings do.

An integrating plant adds up over a minute what is lost in the noise of seconds. So it is asked of one run of
each recording, once the causes are chosen, and of thirds of it that a fit has not seen: each has to be
foretold better with the drift. Gusts bend a run, too. So windows have to come out nearer as well: what
gusts did before is in their initial states. And the drift has to be the same whichever third is left out:
gusts bend each third their own way.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import t as student
from scipy.stats import ttest_1samp

from seod.diagnose.causes.table import OFFSET, OFFSET_DRIFT_PLACE, OFFSET_PLACE
from seod.diagnose.fitting.command_lead import untimed
from seod.diagnose.fitting.free_run import fitted_over, unseen
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.record.windows import Cut, all_but, all_windows, one_window_each
from seod.diagnose.tuning.fitting import FREE_RUN, LOAD_DRIFT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.series import Series


class Drift(NamedTuple):
    """A set of causes beside a load that drifts.

    Attributes:
        fitted: To one run of each recording.
        without: NRMSE of one run without the drift, of thirds left out of its fit.
        with_it: Likewise with it.
        p_value: Of no gain, over the thirds.
    """

    fitted: Fitted
    without: float
    with_it: float
    p_value: float


def drifting_load(
    last: Fitted, every: Sequence[Series], parallel: ParallelMap, ended: Callable[[], bool]
) -> Drift | None:
    """The same set beside a load that drifts, if each third of the recordings is foretold better with it.

    Args:
        last: The set, fitted to all rows.
        every: The recordings.
        parallel: As `map`.
        ended: Tells when no further step begins.
    """
    if any(sweeps(one.t, one.u) for one in every):
        return None
    runs = untimed(Cut(every, one_window_each(every)), last.model)
    plain = fitted_over(last, runs, parallel, ended)
    drifting = fitted_over(_begun(plain), runs, parallel, ended)
    if plain.cost - drifting.cost < LOAD_DRIFT.least_gain or ended():
        return None
    if _no_less(*(_in_windows(each, every) for each in (plain, drifting))):
        return None
    errors, sizes = [], []
    for third in _thirds(every):
        both = [_left_out(each, third, parallel, ended) for each in (plain, drifting)]
        errors.append([unseen(each, third) for each in both])
        sizes.append(both[1].model.values(both[1].x)[OFFSET_DRIFT_PLACE])
    if ended() or any(_no_less(*each) for each in errors) or _may_be_none(sizes):
        return None
    of_thirds = np.array(errors)
    without, with_it = np.sqrt(np.mean(of_thirds**2, axis=0))
    saved = np.log(of_thirds[:, 0]) - np.log(of_thirds[:, 1])
    p_value = float(ttest_1samp(saved, 0.0, alternative="greater").pvalue)
    return Drift(drifting, float(without), float(with_it), p_value)


def _begun(fitted: Fitted) -> Fitted:
    """Beside a drift of nothing, from where the set is."""
    model = fitted.model.drifting()
    given = fitted.model.fixed.get(OFFSET, {}).get(OFFSET_PLACE.split(".")[1], 0.0)
    begin = {OFFSET_PLACE: given, OFFSET_DRIFT_PLACE: 0.0} | fitted.model.values(fitted.x)
    return replace(fitted, model=model, x=model.searched(begin))


def _in_windows(fitted: Fitted, every: Sequence[Series]) -> float:
    """NRMSE of the usual windows, each from a state of its own: it has what gusts did before."""
    windows = Cut(every, all_windows(every))
    return simulate_held_out(fitted.model, fitted.x, windows).nrmse


def _no_less(without: float, with_it: float) -> bool:
    return with_it > (1.0 - FREE_RUN.least_gain) * without


def _thirds(every: Sequence[Series]) -> Iterator[Cut]:
    """First, middle and last third of each recording."""
    for part in range(3):
        rows = ((k, np.linspace(0, len(one.t), 4).astype(int)) for k, one in enumerate(every))
        yield Cut(every, tuple((k, int(at[part]), int(at[part + 1])) for k, at in rows))


def _left_out(fitted: Fitted, third: Cut, parallel: ParallelMap, ended: Callable[[], bool]) -> Fitted:
    """The same set fitted to one run over all other rows."""
    rest = all_but(third.series, third)
    return fitted_over(fitted, Cut(rest.series, one_window_each(rest.series)), parallel, ended)


def _may_be_none(sizes: Sequence[float]) -> bool:
    """Whether a number, each time with another part left out, is none by its interval.

    By the jackknife: the parts' scatter tells the deviation, whatever bends each of them.
    """
    count = len(sizes)
    sd = float(np.std(sizes)) * np.sqrt(count - 1.0)
    return bool(abs(np.mean(sizes)) <= student.ppf(LOAD_DRIFT.surely, count - 1) * sd)
