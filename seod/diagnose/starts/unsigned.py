"""Plants behind a sensor that has lost the sign: found in readings that are given the sign of a simulation.

Of each natural frequency and damping ratio the gain is the one whose simulation from rest, without its sign,
is nearest to the readings. Readings with the sign of the best are then fitted as those of any sensor.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import CAUSES, OFFSET, group, searched_causes
from seod.diagnose.fitting.initial_states import measured_places, simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.simulate import POSITION, simulate
from seod.diagnose.record.windows import Cut, undivided
from seod.diagnose.tuning.starts import UNSIGNED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.result import Array


def without_sign(cut: Cut) -> bool:
    """Whether no reading is below 0, and the least ones are near it."""
    for k in {k for k, _, _ in cut.windows}:
        one = cut.series[k]
        y = one.y[one.good]
        least, span = float(np.quantile(y, UNSIGNED.outliers)), float(np.ptp(y))
        if (
            least < -UNSIGNED.below * one.noise - one.step - UNSIGNED.below_part * span
            or least > UNSIGNED.near_zero * span
        ):
            return False
    return True


def unsigned_starts(parent: Model, name: str, cut: Cut) -> tuple[Values, ...]:
    """Plants with the sensor `name`, whose readings without sign are nearest to those of the windows."""
    return tuple(start | plant for start, plant in _begun(parent, name, cut)) if without_sign(cut) else ()


def unsigned_root(parent: Model, cut: Cut, scales: Scales) -> Fitted | None:
    """The baseline behind a sensor that has lost the sign, fitted to whole recordings.

    None where it has not, or where no plant makes any of these readings.

    Whatever else is wrong with the baseline shows only once readings may be those of either sign: beside a
    baseline that knows no sign no other cause gains anything.
    """
    names = [name for name in searched_causes(scales) if CAUSES[name].unsigned]
    if not names or not without_sign(cut):
        return None
    wide, model = undivided(cut), replace(parent, scales=scales)
    found = []
    for name in names:
        for start, plant in _begun(model, name, cut):
            own = model.turned(plant["K_L"]).with_effect(name)
            x = own.searched(start | plant)
            found.append(fit(own, wide, x, measured_places(wide), UNSIGNED.root_steps))
    return min(found, key=lambda one: one.cost, default=None)


def _begun(parent: Model, name: str, cut: Cut) -> Iterator[tuple[Values, Values]]:
    """Starts of the sensor, each with the plants that belong to it."""
    model = baseline_model(parent.scales, 1.0, parent.sees_speed, parent.fixed)
    unsigned = CAUSES[name].unsigned
    assert unsigned is not None  # noqa: S101 - asked of such a sensor alone
    for start in group(name, parent.scales).starts:
        straight = [replace(one, y=unsigned(one.y, start, parent.scales)) for one in cut.series]
        windows = Cut(straight, cut.windows)
        wide = undivided(windows)
        points = sorted(_grid(model, wide), key=lambda one: one.error)[: UNSIGNED.kept]
        yield from ((start, values) for point in points for values in _signed(model, point, windows, wide))


class _Point(NamedTuple):
    error: float
    values: Values


def _grid(model: Model, wide: Cut) -> Iterator[_Point]:
    """Natural frequencies and damping ratios, each with its best gain."""
    tick = max(recording.tick for recording in wide.series)
    slowest = math.pi / min(float(wide.series[k].t[b - 1] - wide.series[k].t[a]) for k, a, b in wide.windows)
    fastest = max(UNSIGNED.fastest_ticks / tick, UNSIGNED.fastest * slowest)
    frequencies = np.geomspace(UNSIGNED.slowest * slowest, fastest, UNSIGNED.frequencies)
    y, good = wide.y, wide.good
    for omega_n, zeta in product(frequencies.tolist(), UNSIGNED.dampings):
        x = model.searched({"K_L": 1.0, "omega_n": omega_n, "zeta": zeta})
        start = measured_places(wide)
        shape = simulate(model.kernel_parameters(x), wide, start)
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
        sizes = usual * np.geomspace(*UNSIGNED.gains, UNSIGNED.places)
        tried = np.concatenate([sizes, -sizes])
    errors = np.array([float(np.mean((np.abs(begin + each * shape) - y) ** 2)) for each in tried])
    best = int(
        np.argmin(np.where(tried < 0.0, UNSIGNED.upright * errors, errors))
    )  # turned round it reads alike
    return float(tried[best]), float(errors[best])


def _signed(model: Model, point: _Point, cut: Cut, wide: Cut) -> list[Values]:
    """The plant fitted to readings that have its sign, some times over."""
    values = point.values
    for _ in range(UNSIGNED.signed_again):
        own = model.turned(values["K_L"])
        x = own.searched(values)
        given = _given_sign(own, x, cut, wide)
        biased = own.with_effect(OFFSET)
        x = biased.searched(values | {c.place: 0.0 for c in biased.coordinates[len(BASE) :]})
        found = fit(biased, given, x, simulated_states(biased, x, given), most=UNSIGNED.signed_steps)
        values = {of: found.model.values(found.x)[of] for of in BASE}
    return [values]


def _given_sign(model: Model, x: Array, cut: Cut, wide: Cut) -> Cut:
    """Windows of readings with the sign of one simulation of each block."""
    every = list(cut.series)
    seen = simulate(model.kernel_parameters(x), wide, measured_places(wide))
    for (k, first, last), own in zip(wide.windows, wide.slices, strict=True):
        y = every[k].y.copy()
        y[first:last] *= np.where(seen[own] < 0.0, -1.0, 1.0)
        every[k] = replace(every[k], y=y)
    return Cut(every, cut.windows)
