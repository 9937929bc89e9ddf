"""What a model leaves of windows, each with the movement beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

from seod.diagnose.causes.base import BASE
from seod.diagnose.fitting.repeats import Share, cycle, profile
from seod.diagnose.fitting.simulate import POSITION, PRESSURE, VELOCITY
from seod.diagnose.tuning.account import SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, Mask


@dataclass(frozen=True, slots=True)
class Plant:
    """Eq. 1 of the model whose residual it is.

    Attributes:
        omega_n: Undamped natural frequency [rad/s].
        zeta: Damping ratio.
        sees_speed: `y` is a speed.
    """

    omega_n: float
    zeta: float
    sees_speed: bool

    @classmethod
    def of(cls, model: Model, x: Array) -> Plant:
        """At searched numbers."""
        _, omega_n, zeta = (model.values(x)[name] for name in BASE)
        return cls(omega_n, zeta, model.sees_speed)


@dataclass(frozen=True, slots=True)
class WindowResidual:
    """What is left of one window; arrays of shape (n,).

    Attributes:
        file: Which recording.
        t: [s].
        u: Command [V].
        error: Measured less simulated [unit of y].
        scored: Rows that count.
        pressure: Of the load, simulated, as the acceleration of the free load [unit/s^2].
        velocity: Likewise [unit/s].
        position: Likewise [unit]; of a speed but for a straight line where its readings tell it to be: by a
            wrong model the load drifts off. Nearer to them, it would bring along what is left of them.
        held_out: No fit has seen it.
        force: What is measured of a disturbance [its unit]; empty where nothing is.
    """

    file: int
    t: Array
    u: Array
    error: Array
    scored: Mask
    pressure: Array
    velocity: Array
    position: Array
    held_out: bool
    force: Array = field(default_factory=lambda: np.empty(0))


def horizon(one: WindowResidual, plant: Plant) -> int:
    """Rows of half a period of the plant; of an over-damped one of its slowest time constant."""
    time = max(math.pi, 2.0 * plant.zeta) / plant.omega_n
    return min(max(1, round(time / float(np.median(np.diff(one.t))))), len(one.t))


def window_residuals(held: HeldOut, *, held_out: bool) -> list[WindowResidual]:
    """Of each window that a model has simulated; windows without a row that counts are left out."""
    out, error, scored = [], held.error, held.scored & held.sure
    for (k, first, last), rows in zip(held.cut.windows, held.cut.slices, strict=True):
        one, states = held.cut.series[k], held.states[rows]
        if scored[rows].any():
            t, u = one.t[first:last], one.u[first:last]
            pressure, velocity, position = states[:, PRESSURE], states[:, VELOCITY], states[:, POSITION]
            if tells_its_place(one):
                position = position + _line(t, one.travelled[first:last] - position)
            some = pressure, velocity, position
            force = one.force[first:last] if len(one.force) else one.force
            out.append(WindowResidual(k, t, u, error[rows], scored[rows], *some, held_out, force))
    return out


def tells_its_place(one: Series) -> bool:
    """Whether readings are a speed with its sign, so that their integral is where the load is."""
    y = one.y[one.good]
    return one.sees_speed and float(np.min(y)) < 0.0 < float(np.max(y))


def _line(t: Array, off: Array) -> Array:
    """The straight line nearest to `off`."""
    return np.asarray(np.polynomial.Polynomial.fit(t, off, 1)(t))


def fewer_shown(one: Share, other: Share) -> Share:
    """The one of two that is less above its own limit."""
    return one if one.score - one.limit < other.score - other.limit else other


def mean_square(parts: Sequence[WindowResidual]) -> float:
    """Of all rows that count."""
    kept = [one.error[one.scored] for one in parts]
    return sum(float(each @ each) for each in kept) / sum(len(each) for each in kept)


def compared(
    before: Sequence[Array],
    after: Sequence[Array],
    scored: Sequence[Mask],
    count: int,
    chance: float = SYSTEMATIC.chance,
) -> Share:
    """What squared errors of windows have become less, by `count` parts of each.

    Whether it is chance is asked of the parts' log squared errors: where the error is large it changes most.
    """
    old, new, rows = [], [], 0
    for one, other, kept in zip(before, after, scored, strict=True):
        for each in np.array_split(np.flatnonzero(kept), count):
            if len(each):
                old.append(float(one[each].sum()))
                new.append(float(other[each].sum()))
                rows += len(each)
    saved = np.array(old) - np.array(new)
    if len(saved) < 2:
        return Share(float(saved.sum()) / max(rows, 1), math.inf, 0.0, math.inf)
    logs = np.log(np.maximum(old, 1e-300)) - np.log(np.maximum(new, 1e-300))
    root = math.sqrt(len(saved))
    sd = root * float(np.std(saved, ddof=1)) / rows
    score = root * float(np.mean(logs)) / max(float(np.std(logs, ddof=1)), 1e-300)
    return Share(float(saved.sum()) / rows, sd, score, float(student.ppf(1.0 - chance, len(saved) - 1)))


def not_repeated(every: Sequence[Series], parts: Sequence[WindowResidual]) -> list[WindowResidual]:
    """The same without the mean of the other windows at the same phase, where there are such."""
    cycles = [cycle(one) for one in every]
    profiles = [None if (of := cycles[one.file]) is None else profile(one, of) for one in parts]
    out = []
    for k, one in enumerate(parts):
        of = cycles[one.file]
        others = [p for j, p in enumerate(profiles) if j != k and p is not None and parts[j].file == one.file]
        if of is None or not others:
            out.append(one)
            continue
        count = np.sum(np.isfinite(others), axis=0)
        mean = np.nansum(others, axis=0) / np.maximum(count, 1)
        index = of.place(one.t)
        out.append(replace(one, error=one.error - np.where(index >= 0, mean[index], 0.0)))
    return out
