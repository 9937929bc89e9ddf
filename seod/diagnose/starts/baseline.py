"""Where a search begins: Eq. 1 from a grid of frequencies and dampings, initial states by its simulation."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.causes.base import BASE, DAMPED_BY_RELAY
from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import SOLVED
from seod.diagnose.fitting.initial_states import measured_places, simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.linear_gain import linear_gain
from seod.diagnose.fitting.model import baseline_model, grouped
from seod.diagnose.record.windows import Cut, beginnings, sample, segments, undivided
from seod.diagnose.starts.sizes import largest_force
from seod.diagnose.tuning.starts import BASELINE, SIZES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.result import Array

    Behind = Callable[[float, float], Values]
    """Numbers of a cause, by place, that belong to a plant's K_L [unit/s/V] and omega_n [rad/s]."""


class BaselineFits(NamedTuple):
    """Eq. 1, with the effects that the rig's file has, on windows.

    Where Eq. 1 alone is far off the other two are nearer to the plant.

    Attributes:
        best: Fitted to them from several starts.
        near: Fitted to short segments of them with a free load bias, which slow effects hardly touch, and
            with the disturbance that was measured, where one was.
        other: Fitted to whole recordings, whose one initial state makes up for nothing; of those of a relay
            a plant whose own frequency is near the limit cycle's, as every plant's is that a relay drives.
        closed: The plant beside an offset and a delay, where these hide it; else None.
        damped: A plant that is damped, where the best is hardly: that one makes harmonics of its own, which
            stand for what bends the flow or the reading. Else None.
    """

    best: Fitted
    near: Fitted
    other: Fitted
    closed: Fitted | None = None
    damped: Fitted | None = None


class Fixed(NamedTuple):
    """What of the baseline is not searched.

    Attributes:
        effects: Of the rig's file, or given otherwise.
        gain: K_L [unit/s/V]; None where it is searched.
        given: Those of the effects that the user tells.
        behind: What else each plant of the grid is behind.
    """

    effects: Mapping[str, Mapping[str, float]]
    gain: float | None = None
    given: frozenset[str] = frozenset()
    behind: Behind | None = None


def baseline(
    cut: Cut,
    sees_speed: bool,
    effects: Mapping[str, Mapping[str, float]],
    parallel: ParallelMap = map,
    gain: float | None = None,
) -> BaselineFits:
    """Search for Eq. 1 from a grid of natural frequencies and damping ratios; K_L may be known (`gain`)."""
    fixed = Fixed(effects, gain)
    few = sample(cut, BASELINE.windows_s)
    short = segments(
        few,
        max(
            BASELINE.short_segment_s,
            BASELINE.short_segment_rows * max(recording.tick for recording in cut.series),
        ),
    )
    points = plants_of_grid(short, sees_speed, fixed, parallel)[: BASELINE.kept_points]
    local = min(parallel(lambda point: _biased(point, short), points), key=lambda one: one.cost)
    every = plants_of_grid(few, sees_speed, fixed, parallel)
    starts = [local, *every[: BASELINE.kept_points - 1]]
    found: list[Fitted] = list(parallel(lambda point: _plain(point, cut), starts))
    near = unchanged(*_begun(local, cut), cut)
    best = min(found, key=lambda one: one.cost)
    if cut.relayed:
        return BaselineFits(best, near, _near_limit_cycle(cut, sees_speed, fixed))
    wide = undivided(cut)
    start = plants_of_grid(beginnings(wide, BASELINE.whole_rows), sees_speed, fixed, parallel)[0]
    of_whole = _plain(start, wide)
    return BaselineFits(
        best, near, unchanged(of_whole.model, of_whole.x, cut), damped=_damped(best, every, cut)
    )


def _damped(best: Fitted, every: Sequence[GridPoint], cut: Cut) -> Fitted | None:
    """Fitted from the best point of the grid that is damped, if the best plant is hardly."""
    if best.model.values(best.x)["zeta"] > BASELINE.undamped:
        return None
    return _plain(next(one for one in every if one.zeta >= BASELINE.damped), cut)


def _near_limit_cycle(cut: Cut, sees_speed: bool, fixed: Fixed) -> Fitted:
    """The plant near the limit cycle's own frequency."""
    period_s = cut.series[cut.windows[0][0]].period_s
    omega = BASELINE.above_limit_cycle * 2.0 * math.pi / period_s
    return unchanged(
        *_begun(_grid_point(cut, sees_speed, fixed, (omega, BASELINE.limit_cycle_damping)), cut), cut
    )


def unchanged(model: Model, x: Array, cut: Cut) -> Fitted:
    """A plant fitted elsewhere, on these windows."""
    return fit(model, cut, x, simulated_states(model, x, cut), free=np.zeros(len(x), np.bool_))


class GridPoint(NamedTuple):
    """A start: K_L, loads by their places, omega_n and zeta, sorted by the cost."""

    cost: float
    K_L: float
    loads: Values
    omega_n: float
    zeta: float
    sees_speed: bool
    fixed: Fixed


def plants_of_grid(cut: Cut, sees_speed: bool, fixed: Fixed, parallel: ParallelMap) -> list[GridPoint]:
    """A grid over omega_n and zeta, K_L and loads solved for in each point; the best first."""
    one = cut.series[cut.windows[0][0]]
    omega = 2.0 * math.pi / one.period_s
    slowest = max(BASELINE.lowest_frequency * omega, _slowest(cut))
    fastest = max(BASELINE.fastest_ticks / one.tick, BASELINE.least_range * slowest)
    frequencies = np.geomspace(slowest, fastest, BASELINE.frequencies)
    points = product(frequencies.tolist(), BASELINE.dampings)
    return sorted(
        parallel(lambda at: _grid_point(cut, sees_speed, fixed, at), points), key=lambda one: one.cost
    )


def _grid_point(cut: Cut, sees_speed: bool, fixed: Fixed, at: tuple[float, float]) -> GridPoint:
    """K_L and loads solved for at this omega_n and zeta."""
    omega_n, zeta = at
    rough = _rough(cut, omega_n)
    K_L = rough.speed  # of 1 V
    behind = grouped(fixed.behind(K_L, omega_n)) if fixed.behind is not None else {}
    model = baseline_model(rough, 1.0, sees_speed, {**fixed.effects, **behind}, fixed.gain)
    x = model.searched({"K_L": K_L, "omega_n": omega_n, "zeta": zeta})
    found = linear_gain(model, cut, x, measured_places(cut), fixed.gain)
    return GridPoint(found.cost, found.K_L, found.loads, omega_n, zeta, sees_speed, fixed)


def _begun(point: GridPoint, cut: Cut) -> tuple[Model, Array]:
    sign = math.copysign(1.0, point.K_L)
    model = baseline_model(
        _rough(cut, point.omega_n), sign, point.sees_speed, point.fixed.effects, point.fixed.gain
    )
    return model, model.searched({"K_L": point.K_L, "omega_n": point.omega_n, "zeta": point.zeta})


def _rough(cut: Cut, omega_n: float) -> Scales:
    """Sizes as far as the samples alone show them."""
    y = cut.y[cut.good]
    size = max(float(np.std(y)), SIZES.least)
    tick = max(recording.tick for recording in cut.series)
    rough = Scales(
        volts=1.0,
        speed=size * omega_n,
        pressure=size * omega_n**2,
        centre=0.0,
        travel=size,
        peak_to_peak=size,
        omega_n=omega_n,
        span_s=1.0,
        tick_s=tick,
    )
    relayed = cut.relayed
    damped = DAMPED_BY_RELAY if relayed else rough.damped
    slowest, acts = _slowest_searched(cut), largest_force(cut.series)
    return replace(rough, slowest=slowest, damped=damped, relayed=relayed, force=acts)


def _slowest_searched(cut: Cut) -> float:
    """Natural frequency that is searched, at least [rad/s]: of slow plants and slow samples it is less."""
    moves = min(2.0 * math.pi / recording.period_s for recording in cut.series)
    slowest = (
        BASELINE.slowest_plant
        if moves > BASELINE.slow_movement * BASELINE.slowest_plant
        else BASELINE.lowest_frequency * moves
    )
    return max(
        min(slowest, BASELINE.slowest_ticks / max(recording.tick for recording in cut.series)), _slowest(cut)
    )


def _slowest(cut: Cut) -> float:
    """Half a period in each window [rad/s]: free initial states make up for less."""
    return math.pi / min(float(cut.series[k].t[b - 1] - cut.series[k].t[a]) for k, a, b in cut.windows)


def _plain(point: GridPoint, cut: Cut) -> Fitted:
    model, x = _begun(point, cut)
    return fit(model, cut, x, simulated_states(model, x, cut), most=BASELINE.fit_steps)


def _biased(point: GridPoint, cut: Cut) -> GridPoint:
    """The point after a fit with free loads."""
    model, x = _begun(point, cut)
    values = model.values(x)
    for name in (each for each in SOLVED if SOLVED[each] in point.loads):
        model = model.with_effect(name)
    begin = {each.place: 0.0 for each in model.coordinates} | values | point.loads
    x = model.searched(begin)
    found = fit(model, cut, x, simulated_states(model, x, cut), most=BASELINE.fit_steps)
    values = model.values(found.x)
    K_L, omega_n, zeta = (values[name] for name in BASE)
    return point._replace(cost=found.cost, K_L=K_L, omega_n=omega_n, zeta=zeta)
