"""Plants behind a sensor that has lost the sign: found in readings that are given the sign of a simulation.

Of each natural frequency and damping ratio the gain is the one whose simulation from rest, without its sign,
is nearest to the readings. Readings with the sign of the best are then fitted as those of any sensor.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import OFFSET
from seod.diagnose.fitting.initial_states import measured_places, simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.simulate import POSITION, simulate
from seod.diagnose.record.windows import Cut, undivided

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.result import Array

BELOW: Final = 5.0
"""Noise deviations below the least reading of a sensor without sign that any may be; beside a part of y's."""
BELOW_PART: Final = 0.05
"""Part of the range of y likewise."""
NEAR_ZERO: Final = 0.1
"""Part of the range of y within which the least reading is, of a sensor that was at 0."""
FREQUENCIES: Final = 12
DAMPINGS: Final = (0.2, 0.7, 2.0, 6.0)
"""Of the grid, up to a tenth of the sampling rate."""
PLACES: Final = 24
"""Gains of a position that are tried, over a decade about the one whose range is that of the readings."""
UPRIGHT: Final = 1.2
"""Squared error of a negative gain over that of a positive one, from which on it counts as less."""
KEPT: Final = 2
"""Plants from which readings are given a sign."""
SIGNED_AGAIN: Final = 3
"""Times that readings are given the sign of the plant that was fitted to them."""


def without_sign(cut: Cut) -> bool:
    """Whether no reading is below 0, and the least ones are near it."""
    for k in {k for k, _, _ in cut.windows}:
        one = cut.series[k]
        y = one.y[one.good]
        least, span = float(np.quantile(y, 1e-3)), float(np.ptp(y))
        if least < -BELOW * one.noise - one.step - BELOW_PART * span or least > NEAR_ZERO * span:
            return False
    return True


def unsigned_starts(parent: Model, place: str, cut: Cut) -> tuple[Values, ...]:
    """Plants whose readings without sign are nearest to those of the windows, `place` being 1."""
    if not without_sign(cut):
        return ()
    wide = undivided(cut)
    model = baseline_model(parent.scales, 1.0, parent.sees_speed, parent.fixed)
    points = sorted(_grid(model, wide), key=lambda one: one.error)[:KEPT]
    return tuple({place: 1.0} | values for point in points for values in _signed(model, point, cut, wide))


class _Point(NamedTuple):
    error: float
    values: Values


def _grid(model: Model, wide: Cut) -> Iterator[_Point]:
    """Natural frequencies and damping ratios, each with its best gain."""
    tick = max(one.tick for one in wide.series)
    slowest = math.pi / min(float(wide.series[k].t[b - 1] - wide.series[k].t[a]) for k, a, b in wide.windows)
    frequencies = np.geomspace(4.0 * slowest, max(0.6 / tick, 8.0 * slowest), FREQUENCIES)
    y, good = wide.gathered("y"), wide.good
    for omega_n, zeta in product(frequencies.tolist(), DAMPINGS):
        x = model.searched({"K_L": 1.0, "omega_n": omega_n, "zeta": zeta})
        start = measured_places(wide)
        shape = simulate(model.record(x), wide, start)
        begin = np.zeros(len(y)) if model.sees_speed else np.repeat(start[:, POSITION], wide.sizes)
        gain, error = _gain(y[good], (shape - begin)[good], begin[good], sees_speed=model.sees_speed)
        if gain != 0.0:
            yield _Point(error, model.values(x) | {"K_L": gain})


def _gain(y: Array, shape: Array, begin: Array, *, sees_speed: bool) -> tuple[float, float]:
    """The gain whose |begin + gain shape| is nearest to y, and the mean squared error; 0: there is none."""
    size = float(shape @ shape)
    if not (size > 0.0 and math.isfinite(size)):
        return 0.0, math.inf
    if sees_speed:
        gain = float(np.abs(shape) @ y) / size
        tried = np.array([gain])
    else:
        usual = float(np.ptp(y)) / max(float(np.ptp(shape)), 1e-300)
        sizes = usual * np.geomspace(0.4, 4.0, PLACES)
        tried = np.concatenate([sizes, -sizes])
    errors = np.array([float(np.mean((np.abs(begin + each * shape) - y) ** 2)) for each in tried])
    best = int(np.argmin(np.where(tried < 0.0, UPRIGHT * errors, errors)))  # turned round it reads alike
    return float(tried[best]), float(errors[best])


def _signed(model: Model, point: _Point, cut: Cut, wide: Cut) -> list[Values]:
    """The plant fitted to readings that have its sign, some times over."""
    values = point.values
    for _ in range(SIGNED_AGAIN):
        own = model.turned(values["K_L"])
        x = own.searched(values)
        given = _given_sign(own, x, cut, wide)
        biased = own.with_effect(OFFSET)
        x = biased.searched(values | {c.place: 0.0 for c in biased.coordinates[len(BASE) :]})
        found = fit(biased, given, x, simulated_states(biased, x, given), most=8)
        values = {of: found.model.values(found.x)[of] for of in BASE}
    return [values]


def _given_sign(model: Model, x: Array, cut: Cut, wide: Cut) -> Cut:
    """Windows of readings with the sign of one simulation of each block."""
    every = list(cut.series)
    seen = simulate(model.record(x), wide, measured_places(wide))
    for (k, first, last), piece in zip(wide.windows, wide.slices, strict=True):
        y = every[k].y.copy()
        y[first:last] *= np.where(seen[piece] < 0.0, -1.0, 1.0)
        every[k] = replace(every[k], y=y)
    return Cut(every, cut.windows)
