"""A constant load that grows with time, as of a drive that warms up: no window shows it, whole recordings do.

An integrating plant adds up over a minute what is lost in the noise of seconds. So it is asked of one run of
each recording, once the causes are chosen, and of thirds of it that a fit has not seen: each has to be
foretold better with the drift. Gusts bend a run, too. So windows have to come out nearer as well: what
gusts did before is in their initial states.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import ttest_1samp

from seod.diagnose.causes.table import OFFSET, OFFSET_DRIFT_PLACE, OFFSET_PLACE
from seod.diagnose.fitting.free_run import fitted_over, unseen, whole_series
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.record.windows import Cut, all_but, whole_windows
from seod.diagnose.tuning.fitting import FREE_RUN, LOAD_DRIFT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from seod.diagnose.fitting.least_squares import Fitted, ParallelMap
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
    runs = Cut(every, whole_series(every))
    plain = fitted_over(last, runs, parallel, ended)
    drifting = fitted_over(_begun(plain), runs, parallel, ended)
    if plain.cost - drifting.cost < LOAD_DRIFT.least_gain or ended():
        return None
    if _no_less(*(_in_windows(each, every) for each in (plain, drifting))):
        return None
    errors = np.array(
        [[_left_out(each, third, parallel, ended) for each in (plain, drifting)] for third in _thirds(every)]
    )
    if ended() or any(_no_less(*each) for each in errors):
        return None
    without, with_it = np.sqrt(np.mean(errors**2, axis=0))
    saved = np.log(errors[:, 0]) - np.log(errors[:, 1])
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
    windows = Cut(every, whole_windows(every))
    return simulate_held_out(fitted.model, fitted.x, windows).nrmse


def _no_less(without: float, with_it: float) -> bool:
    return with_it > (1.0 - FREE_RUN.least_gain) * without


def _thirds(every: Sequence[Series]) -> Iterator[Cut]:
    """First, middle and last third of each recording."""
    for part in range(3):
        rows = ((k, np.linspace(0, len(one.t), 4).astype(int)) for k, one in enumerate(every))
        yield Cut(every, tuple((k, int(at[part]), int(at[part + 1])) for k, at in rows))


def _left_out(fitted: Fitted, third: Cut, parallel: ParallelMap, ended: Callable[[], bool]) -> float:
    """NRMSE of one run over rows that the same set, fitted to all others, has not seen."""
    rest = all_but(third.series, third)
    return unseen(fitted_over(fitted, Cut(rest.series, whole_series(rest.series)), parallel, ended), third)
