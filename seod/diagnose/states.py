"""Initial states of windows: as samples show them, from a simulation, or carried on from other windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.fit import SETTLED, Search, settle
from seod.diagnose.simulate import LOOSE, STATES, inside
from seod.diagnose.windows import Cut

ALIKE: Final = 4.0
"""Squared error of a window, over the least of all, up to which another window may take its states."""
PLACES: Final = (0.5, 0.0, 1.0)
"""In a play where the load may have been at rest, over it."""

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.fit import Fitted
    from seod.diagnose.model import Model
    from seod.diagnose.windows import Series


def measured_places(cut: Cut) -> Array:
    """Initial states as samples show them: positions, or integrals of speeds; shape (w, 7)."""
    start = np.zeros((len(cut.windows), STATES))
    for w, (k, first, last) in enumerate(cut.windows):
        one = cut.series[k]
        rows = first + np.flatnonzero(one.good[first:last])[:1]
        start[w, 2] = travelled(one)[first] if one.sees_speed else one.y[rows[0]]
    return start


def travelled(one: Series) -> Array:
    """Positions by the integral of a speed, from 0, shape (n,)."""
    y = np.interp(one.t, one.t[one.good], one.y[one.good])
    return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(one.t))])


def simulated_states(model: Model, x: Array, cut: Cut, loose: float = 0.5) -> Array:
    """Initial states with pressure and speed of one simulation of each whole recording, shape (w, 7).

    It begins so many times a play from the flank that the load pulls at.
    """
    start = measured_places(cut)
    record = model.record(x)
    for k in {of for of, _, _ in cut.windows}:
        whole = Cut(cut.series, ((k, 0, len(cut.series[k].t)),))
        begin, gap = measured_places(whole), float(record["backlash_gap"][0])
        begin[:, LOOSE] = loose * gap
        seen, states = inside(record, whole, begin)
        behind = gap > 0.0 and not model.sees_speed
        for w, (of, first, _) in enumerate(cut.windows):
            if of == k:
                start[w, :2] = states[first, :2]
                start[w, LOOSE] = states[first, -1]
                start[w, 2] += states[first, 2] - seen[first] if behind else 0.0
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def carried_states(found: Fitted, cut: Cut) -> Array:
    """Initial states of other windows by going on from the fitted ones before them, shape (w, 7).

    A sensor's ripple may have several places for one reading: where the load is, its past tells.
    """
    record = found.model.record(found.x)
    start, begins = measured_places(cut), _begins(found, cut.series)
    for (k, row), state in begins.items():
        end = min((b for of, b in begins if of == k and b > row), default=len(cut.series[k].t) - 1)
        rows = range(row, max(end, row + 1))
        asked = [w for w, (of, first, _) in enumerate(cut.windows) if of == k and first in rows]
        if not asked:
            continue
        on = Cut(cut.series, ((k, row, end + 1),))
        states = inside(record, on, state[None])[1]
        for w in asked:
            at = cut.windows[w][1] - row
            start[w] = state if at == 0 else [*states[at, :3], 0.0, 0.0, 0.0, states[at, -1]]
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def alike_states(found: Fitted, cut: Cut) -> Array:
    """Under a relay: initial states from fitted windows where it had switched as long before, shape (w, 7).

    Of a limit cycle they are nearly right, also where the windows before are not.
    """
    model, fitted = found.model, found.cut
    record, start = model.record(found.x), measured_places(cut)
    seen, states = inside(record, fitted, found.start)
    good = np.repeat(found.error <= ALIKE * np.min(found.error), fitted.sizes)
    phases = [_phases(fitted.series[k], fitted.series[k].t[a:b]) for k, a, b in fitted.windows]
    volts, ago = (np.concatenate(each) for each in zip(*phases, strict=True))
    for w, (k, first, _) in enumerate(cut.windows):
        now, since = _phases(cut.series[k], cut.series[k].t[first : first + 1])
        apart = np.where(good & (volts == now), np.abs(ago - since), np.inf)
        row = int(np.argmin(apart))
        start[w, :2], start[w, LOOSE] = states[row, :2], states[row, -1]
        if not model.sees_speed:
            start[w, 2] = cut.series[k].y[first] + states[row, 2] - seen[row]
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def _phases(one: Series, t: Array) -> tuple[Array, Array]:
    """Commands at these times, and for how long they have been given."""
    told = np.flatnonzero(np.diff(one.u, prepend=np.nan) != 0.0)
    last = told[np.maximum(np.searchsorted(one.t_u[told], t, "right") - 1, 0)]
    return one.u[last], t - one.t_u[last]


def _begins(found: Fitted, series: Sequence[Series]) -> dict[tuple[int, int], Array]:
    """Fitted states by recording and row, the rows counted as in these series."""
    return {
        (k, int(np.searchsorted(series[k].t, found.cut.series[k].t[first]))): state
        for (k, first, _), state in zip(found.cut.windows, found.start, strict=True)
    }


def begun_states(model: Model, x: Array, cut: Cut, *some: Array) -> Array:
    """Initial states from which a fit begins, shape (w, 7): a simulation's or `some`, settled.

    Where in a play the load was at rest shows until it has been at both flanks, beside friction for long.
    """
    places = PLACES if model.record(x)["backlash_gap"][0] > 0.0 else PLACES[:1]
    start = best_states(model, x, cut, *(simulated_states(model, x, cut, place) for place in places), *some)
    return settle(model, cut, x, start, cut.good, most=SETTLED)


def best_states(model: Model, x: Array, cut: Cut, *some: Array) -> Array:
    """Of each window those of some initial states that leave least, shape (w, 7)."""
    search = Search(model, cut, map, np.zeros(len(x), np.bool_))
    errors = np.array([search.tried(x, start)[1] for start in some])
    return np.asarray(np.stack(some)[np.argmin(errors, axis=0), np.arange(len(cut.windows))])
