"""One simulation of a whole recording: how far off it is, and numbers that are fitted to it.

Windows of seconds tell which causes there are, since each begins where the measurement is. Numbers fitted to
them alone let an integrating plant drift over a minute. Fits to longer and longer windows, each from the one
before, come to numbers for the whole; whether these foretell more is asked of rows that no fit saw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.beside import beside_lead, beside_slow_offset
from seod.diagnose.fitting.command_lead import untimed
from seod.diagnose.fitting.held_out import simulate_held_out, whole
from seod.diagnose.fitting.initial_states import begun_states, measured_places
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.simulate import simulate
from seod.diagnose.record.windows import Cut, all_but, fitted_windows, one_window_each, segments
from seod.diagnose.result import FreeRun
from seod.diagnose.tuning.fitting import FREE_RUN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array


def free_runs(model: Model, x: Array, series: Sequence[Series], fitted: int) -> tuple[FreeRun, ...]:
    """Errors of one simulation of each series; those after the first `fitted` were in no fit."""
    every = Cut(series, one_window_each(series))
    placed = simulate(model.kernel_parameters(x), every, measured_places(every))
    out = []
    for k, (one, rows) in enumerate(zip(series, every.slices, strict=True)):
        simulated, _ = whole(model, x, every, k)
        fitted_rms, deviation = _rms(one, simulated), max(float(np.std(one.y[one.good])), 1e-300)
        out.append(FreeRun(_rms(one, placed[rows]), fitted_rms, k >= fitted, fitted_rms / deviation))
    return tuple(out)


def _rms(recording: Series, simulated: Array) -> float:
    error = (recording.y - simulated)[recording.good]
    return float(np.sqrt(np.mean(np.square(np.nan_to_num(error, nan=np.inf)))))


def fitted_in_one_run(
    fitted: Fitted, held_out: Cut, most: float, parallel: ParallelMap, ended: Callable[[], bool]
) -> Fitted:
    """The same set with numbers for the whole recordings, if they foretell more in one run; else as it is.

    Args:
        fitted: Fitted to windows.
        held_out: Windows whose rows no fit sees; their series are the recordings.
        most: Root mean square that they may leave of these windows: what Eq. 1 leaves [unit, or unit/s].
        parallel: As `map`.
        ended: Tells when no further fit begins.
    """
    rest = all_but(held_out.series, held_out)
    best = newest = fitted
    for length in _lengths(rest.series):
        if ended():
            break
        cut = segments(Cut(rest.series, one_window_each(rest.series)), length)
        newest = fitted_over(newest, cut, parallel, ended)
        if unseen(newest, held_out) >= (1.0 - FREE_RUN.least_gain) * unseen(best, held_out):
            continue
        if simulate_held_out(newest.model, newest.x, held_out).rms <= most:
            best = newest
    return best


def _lengths(every: Sequence[Series]) -> list[float]:
    """Of windows, one after the other, up to whole recordings [s]."""
    longest = max(float(one.t[-1] - one.t[0]) for one in every)
    lengths = [FREE_RUN.longer * max(one.window_s for one in every)]
    while lengths[-1] < longest:
        lengths.append(FREE_RUN.longer * lengths[-1])
    return lengths


def fitted_over(fitted: Fitted, cut: Cut, parallel: ParallelMap, ended: Callable[[], bool]) -> Fitted:
    """The same set fitted to other windows, from where it is."""
    start = begun_states(fitted.model, fitted.x, cut)
    return fit(fitted.model, cut, fitted.x, start, parallel=parallel, ended=ended)


def fitted_to_all_rows(
    fitted: Fitted, windows: Cut, parallel: ParallelMap, ended: Callable[[], bool], as_recorded: bool = False
) -> Fitted:
    """The same set from its own numbers, fitted to the rows that were held out, too.

    Args:
        fitted: By which rows held out were foretold; windows are as long as its own.
        windows: All of the recordings.
        parallel: As `map`.
        ended: Tells when no further step begins.
        as_recorded: Commands were given when they are recorded, also where nobody tells.
    """
    own = fitted.cut
    longest = max(float(own.series[k].t[b - 1] - own.series[k].t[a]) for k, a, b in own.windows)
    if longest > FREE_RUN.in_windows * max(one.window_s for one in windows.series):
        cut = segments(Cut(windows.series, one_window_each(windows.series)), longest)
    else:
        cut = fitted_windows(windows)
    cut = cut.remembering(own.memory, own.slow)
    last = fitted_over(fitted, cut if as_recorded else untimed(cut, fitted.model), parallel, ended)
    return beside_slow_offset(beside_lead(last, parallel, ended), parallel)


def unseen(fitted: Fitted, held_out: Cut) -> float:
    """Root mean square of the error in one run where no fit saw, over each series' deviation."""
    total = count = 0.0
    for k, one in enumerate(held_out.series):
        simulated, counts = whole(fitted.model, fitted.x, held_out, k)
        own = np.zeros(len(one.t), np.bool_)
        for of, first, last in held_out.windows:
            own[first:last] |= of == k
        error = (one.y - simulated)[counts & own] / max(float(np.std(one.y[one.good])), 1e-300)
        total += float(np.sum(np.square(np.nan_to_num(error, nan=1e150))))
        count += len(error)
    return float(np.sqrt(total / max(count, 1.0)))
