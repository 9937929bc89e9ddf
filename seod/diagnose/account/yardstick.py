"""How well models without physics do: ARX and NARX, simulated freely over the same held-out windows.

All are fitted by least squares to the windows to fit, one step ahead, of a record with fewer samples. Order
and rate of the first are those with which they simulate these windows best. A NARX has bent terms, or weights
that change with the state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.account.arx import fitted_arx, runs_of
from seod.diagnose.account.narx import fitted_narx
from seod.diagnose.account.residual import compared, fewer_shown, tells_its_place
from seod.diagnose.account.scheduled_arx import STATES, fitted_scheduled_arx
from seod.diagnose.fitting.held_out import nrmse
from seod.diagnose.tuning.account import SCHEDULED, SYSTEMATIC, YARDSTICK

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.account.arx import Arx, Run
    from seod.diagnose.account.narx import Narx
    from seod.diagnose.account.scheduled_arx import Scheduled, ScheduledArx
    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.noise_colour import NoiseColour
    from seod.diagnose.fitting.repeats import Share
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array, Mask


@dataclass(frozen=True, slots=True)
class Reached:
    """What is reached without physics.

    Attributes:
        arx: NRMSE of the linear model on the windows held out.
        narx: Of the better nonlinear one.
        simulated: The best one's readings there, windows end to end, shape (n,).
        foretold: Its readings of windows that were fitted, by fits of other parts, likewise; nan where none.
        changes_with: The state that the nonlinear one's weights change with; None where its terms are bent.
    """

    arx: float
    narx: float
    simulated: Array
    foretold: Array
    changes_with: str | None = None


def beaten(
    seen: HeldOut,
    held: HeldOut,
    other: Reached,
    noise: NoiseColour,
    *,
    predicted: bool = False,
    in_loop: bool,
    chance: float = SYSTEMATIC.chance,
) -> Share:
    """By how much a model without physics comes nearer: the difference of the mean squared errors.

    Whether that is more than chance is asked of windows that were fitted, too, where this model's fit has not
    seen what it foretells.

    Args:
        seen: The model's simulation of windows that were fitted.
        held: Of those held out.
        other: What is reached without physics.
        noise: By which errors are made white.
        predicted: The model was fitted by prediction errors. In a loop errors made white are asked alone:
            there its plant is not the one whose simulation errs least.
        in_loop: Errors made white are asked, too, and those by which less shows count. A loop acts on what
            disturbs the load, a command tells of it, and a model that forgets comes nearer than the plant.
        chance: Probability with which chance alone passes.
    """
    held_out = _pairs(held, other.simulated)
    pairs = [*held_out, *_pairs(seen, other.foretold)]
    count = math.ceil(SYSTEMATIC.segments / len(held.cut.slices))

    def compared_through(made: Callable[[Array], Array], some: Sequence[Pair], count: int) -> Share:
        before, after = [made(one.own) ** 2 for one in some], [made(one.other) ** 2 for one in some]
        return compared(before, after, [one.scored for one in some], count, chance)

    past = [one._replace(scored=noise.has_past(one.scored)) for one in pairs]
    apart = _parts_apart(pairs, noise, count)
    own = compared_through(lambda x: x, held_out, apart)
    nearer, shown = compared_through(lambda x: x, pairs, apart), compared_through(noise.whitened, past, count)
    least = nearer if not in_loop else shown if predicted else fewer_shown(nearer, shown)
    return replace(own, score=least.score, limit=least.limit)


def _parts_apart(pairs: Sequence[Pair], noise: NoiseColour, most: int) -> int:
    """Into how many parts a window goes, each as long as the noise remembers or longer: independent."""
    rows = sum(len(one.own) for one in pairs) / max(len(pairs), 1)
    return min(most, max(1, int(rows / noise.correlation)))


class Pair(NamedTuple):
    """Of a window, where both count: a model's errors and the other's, else 0; shape (n,)."""

    own: Array
    other: Array
    scored: Mask


def _pairs(held: HeldOut, simulated: Array) -> list[Pair]:
    scored = held.scored & held.sure & np.isfinite(simulated)
    own, other = (np.where(scored, x, 0.0) for x in (held.error, held.cut.y - simulated))
    return [Pair(own[p], other[p], scored[p]) for p in held.cut.slices if scored[p].any()]


def yardstick(to_fit: Cut, held_out: Cut) -> Reached | None:
    """None where the windows are too short for it."""
    linear = _best_arx(to_fit)
    if linear is None:
        return None
    stride, arx = linear
    runs, asked = runs_of(to_fit, stride), runs_of(held_out, stride)
    tried = [fitted_narx(runs, arx, ridge) for ridge in YARDSTICK.ridges]
    narx = min(tried, key=lambda one: _error(one, to_fit, runs)[0])
    plain, bent = (_reached(one, held_out, asked) for one in (arx, narx))
    every = [plain, bent, *_scheduled(to_fit, held_out)]
    best, curved = (min(some, key=lambda one: one.error) for some in (every, every[1:]))
    nowhere = np.full(len(to_fit.y), math.nan)
    foretold = nowhere if best.foretold is None else best.foretold
    return Reached(plain.error, curved.error, best.simulated, foretold, curved.changes_with)


class _Tried(NamedTuple):
    """A model's error and readings on windows held out; of one with parts what these were foretold."""

    error: float
    simulated: Array
    foretold: Array | None = None
    changes_with: str | None = None


def _reached(model: Arx | Narx | ScheduledArx, held_out: Cut, runs: Sequence[Run | None]) -> _Tried:
    return _Tried(*_error(model, held_out, runs))


def _best_arx(to_fit: Cut) -> tuple[int, Arx] | None:
    """Rows that become a sample, and the ARX that simulates the windows to fit best."""
    best: tuple[float, int, Arx] | None = None
    for stride in _strides(to_fit, YARDSTICK.rates):
        runs = runs_of(to_fit, stride)
        for order in YARDSTICK.orders:
            for integrates in (False, True):
                arx = fitted_arx(runs, order, integrates)
                error = math.inf if arx is None else _error(arx, to_fit, runs)[0]
                if arx is not None and (best is None or error < best[0]):
                    best = error, stride, arx
    return None if best is None else best[1:]


def _scheduled(to_fit: Cut, held_out: Cut) -> list[_Tried]:
    """The best one whose weights change with the state, none where windows have too few samples."""
    sees_speed = to_fit.series[0].sees_speed
    placed = not sees_speed or all(tells_its_place(one) for one in to_fit.series)
    how = {"sees_speed": sees_speed, "tells_its_place": placed}
    tried = [
        (stride, found)
        for stride in _strides(to_fit, SCHEDULED.rates)
        if (found := fitted_scheduled_arx(runs_of(to_fit, stride), **how)) is not None
    ]
    if not tried:
        return []
    stride, found = min(tried, key=lambda each: each[1].squared)
    reached = _reached(found.model, held_out, runs_of(held_out, stride))
    return [reached._replace(foretold=_foretold(found, to_fit), changes_with=STATES[found.model.form.by])]


def _foretold(scheduled: Scheduled, to_fit: Cut) -> Array:
    """Readings of all rows by fits of other parts, beyond the parts' beginnings; shape (n,)."""
    out, slices = np.full(len(to_fit.y), math.nan), to_fit.slices
    for w, part, own in scheduled.parts:
        at, rows = part.rows[~part.first], np.arange(slices[w].stop - slices[w].start)
        inside = rows[(rows >= at[0]) & (rows <= at[-1])]
        out[slices[w]][inside] = np.interp(inside, at, own[~part.first])
    return out


def _strides(cut: Cut, rates: Sequence[float]) -> list[int]:
    """Rows that become one sample, for so many samples in a dominant period."""
    one = cut.series[cut.windows[0][0]]
    return sorted({max(1, round(one.period_s / rate / one.tick)) for rate in rates})


def _error(model: Arx | Narx | ScheduledArx, cut: Cut, runs: Sequence[Run | None]) -> tuple[float, Array]:
    """NRMSE over the scored rows of windows, and the readings; where none can be made, the mean."""
    y, scored = cut.y, cut.good & ~cut.started()
    simulated = np.array([float(np.mean(y[cut.good]))] * len(y))
    kept = [(rows, run) for rows, run in zip(cut.slices, runs, strict=True) if run is not None]
    for (rows, run), own in zip(kept, model.simulated([run for _, run in kept]) if kept else [], strict=True):
        simulated[rows] = np.interp(np.arange(rows.stop - rows.start), run.rows, own)
    return nrmse([(y[p], simulated[p], scored[p]) for p in cut.slices]), simulated
