"""Initial states of windows: as samples show them, from a simulation, or carried on from other windows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.least_squares import LeastSquares, settle
from seod.diagnose.fitting.simulate import LOOSE, LOOSE_INSIDE, POSITION, STATES, inside
from seod.diagnose.record.windows import Cut
from seod.diagnose.tuning.fitting import INITIAL_STATES
from sim.windows import INSIDE, START

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array


def measured_places(cut: Cut) -> Array:
    """Initial states as samples show them: positions, or integrals of speeds; shape (w, 7)."""
    start = np.zeros((len(cut.windows), STATES))
    for run in cut.runs:
        one = run.recording
        place = one.travelled if one.sees_speed else one.y
        for w, first, last in zip(run.own, run.first, run.last, strict=True):
            row = first if one.sees_speed else first + np.flatnonzero(one.good[first:last])[0]
            start[w, POSITION] = place[row]
    return start


def rings(model: Model, x: Array, cut: Cut) -> bool:
    """Whether a plant oscillates of its own through windows: begun anew in each, that stands for anything."""
    values = model.values(x)
    longest = max(cut.series[k].t[last - 1] - cut.series[k].t[first] for k, first, last in cut.windows)
    return bool(values["zeta"] * values["omega_n"] * longest < INITIAL_STATES.rings)


def simulated_states(
    model: Model, x: Array, cut: Cut, loose: float = INITIAL_STATES.places_in_gap[0]
) -> Array:
    """Initial states with pressure and speed of one simulation of each block of recordings, shape (w, 7).

    It begins so many times a gap from the flank that the load pulls at.
    """
    start = measured_places(cut)
    record = model.kernel_parameters(x)
    gap = float(record["backlash_gap"][0])
    behind = gap > 0.0 and not model.sees_speed
    unsigned = float(record["rectified_sensor_part"][0]) > INITIAL_STATES.sign_lost and not model.sees_speed
    for k, begin, end in _blocks(cut):
        block = Cut(cut.series, ((k, begin, end),))
        rest = measured_places(block)
        rest[:, LOOSE] = loose * gap
        seen, states = inside(record, block, rest)
        for w, (of, first, _) in enumerate(cut.windows):
            if of == k and begin <= first < end:
                at = first - begin
                start[w, :POSITION] = states[at, :POSITION]
                start[w, LOOSE] = states[at, LOOSE_INSIDE]
                if unsigned:
                    start[w, POSITION] = math.copysign(start[w, POSITION], states[at, POSITION])
                start[w, POSITION] += states[at, POSITION] - seen[at] if behind else 0.0
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def _blocks(cut: Cut) -> list[tuple[int, int, int]]:
    """Blocks that have windows: (series, first row, row after the last)."""
    used = sorted({k for k, _, _ in cut.windows})
    every = [(k, begin, end) for k in used for begin, end in cut.series[k].blocks]
    return [
        (k, begin, end)
        for k, begin, end in every
        if any(of == k and begin <= first < end for of, first, _ in cut.windows)
    ]


def carried_states(fitted: Fitted, cut: Cut) -> Array:
    """Initial states of other windows by going on from the fitted ones before them, shape (w, 7).

    A sensor's ripple may have several places for one reading: where the load is, its past tells.
    """
    record = fitted.model.kernel_parameters(fitted.x)
    start, begins = measured_places(cut), _begins(fitted, cut.series)
    for (k, row), state in begins.items():
        last = next((b for a, b in cut.series[k].blocks if a <= row < b), len(cut.series[k].t))
        end = min((b for of, b in begins if of == k and row < b < last), default=last - 1)
        rows = range(row, max(end, row + 1))
        asked = [w for w, (of, first, _) in enumerate(cut.windows) if of == k and first in rows]
        if not asked:
            continue
        on = Cut(cut.series, ((k, row, end + 1),))
        states = inside(record, on, state[None])[1]
        for w in asked:
            at = cut.windows[w][1] - row
            start[w] = state if at == 0 else _going_on(states[at])
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def _going_on(state: Array) -> list[float]:
    """Initial state of a window that begins in the midst of another, from what is inside there, shape (5,).

    The second inertia and what is behind the sensor's lag are relative to the first, and taken for steady.
    """
    return [float(state[INSIDE.index(name)]) if name in INSIDE else 0.0 for name in START]


def alike_states(found: Fitted, cut: Cut) -> Array:
    """Under a relay: initial states from fitted windows where it had switched as long before, shape (w, 7).

    Of a limit cycle they are nearly right, also where the windows before are not.
    """
    model, fitted = found.model, found.cut
    record, start = model.kernel_parameters(found.x), measured_places(cut)
    seen, states = inside(record, fitted, found.start)
    good = np.repeat(found.error <= INITIAL_STATES.alike_windows * np.min(found.error), fitted.sizes)
    phases = [_phases(fitted.series[k], fitted.series[k].t[a:b]) for k, a, b in fitted.windows]
    volts, ago = (np.concatenate(each) for each in zip(*phases, strict=True))
    for w, (k, first, _) in enumerate(cut.windows):
        now, since = _phases(cut.series[k], cut.series[k].t[first : first + 1])
        apart = np.where(good & (volts == now), np.abs(ago - since), np.inf)
        row = int(np.argmin(apart))
        start[w, :POSITION], start[w, LOOSE] = states[row, :POSITION], states[row, LOOSE_INSIDE]
        if not model.sees_speed:
            start[w, POSITION] = cut.series[k].y[first] + states[row, POSITION] - seen[row]
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def _phases(recording: Series, t: Array) -> tuple[Array, Array]:
    """Commands at these times, and for how long they have been given."""
    changes = np.flatnonzero(np.diff(recording.u, prepend=np.nan) != 0.0)
    last = changes[np.maximum(np.searchsorted(recording.t_u[changes], t, "right") - 1, 0)]
    return recording.u[last], t - recording.t_u[last]


def _begins(fitted: Fitted, series: Sequence[Series]) -> dict[tuple[int, int], Array]:
    """Fitted states by recording and row, the rows counted as in these series."""
    return {
        (k, int(np.searchsorted(series[k].t, fitted.cut.series[k].t[first]))): state
        for (k, first, _), state in zip(fitted.cut.windows, fitted.start, strict=True)
    }


def settled_states(model: Model, x: Array, cut: Cut) -> Array:
    """Initial states of windows for a model fitted elsewhere, shape (w, 7)."""
    return settle(model, cut, x, simulated_states(model, x, cut), cut.good)


def begun_states(model: Model, x: Array, cut: Cut, *some: Array) -> Array:
    """Initial states from which a fit begins, shape (w, 7): a simulation's or `some`, settled.

    Where in a gap the load was at rest shows until it has been at both flanks, beside friction for long.
    """
    places = (
        INITIAL_STATES.places_in_gap
        if model.kernel_parameters(x)["backlash_gap"][0] > 0.0
        else INITIAL_STATES.places_in_gap[:1]
    )
    start = best_states(model, x, cut, *(simulated_states(model, x, cut, place) for place in places), *some)
    return settle(model, cut, x, start, cut.good, most=INITIAL_STATES.settling_steps)


def best_states(model: Model, x: Array, cut: Cut, *some: Array) -> Array:
    """Of each window those of some initial states that leave least, shape (w, 7)."""
    search = LeastSquares(model, cut, map, np.zeros(len(x), np.bool_))
    errors = np.array([search.tried(x, start)[1] for start in some])
    return np.asarray(np.stack(some)[np.argmin(errors, axis=0), np.arange(len(cut.windows))])
