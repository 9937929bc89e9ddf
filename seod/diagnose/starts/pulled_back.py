"""The plant of a load that something pulls back, in closed form.

With a load that pulls back by k (y - c) Eq. 1 of a position is

    y''' + 2 zeta omega_n y'' + (omega_n^2 + k) y' + 2 zeta omega_n k (y - c) = omega_n^2 K_L u

Integrated three times it is linear in its coefficients, without a derivative of a measured signal; what y, y'
and y'' were where a window begins adds a parabola. So least squares find it wherever it is: from a baseline
whose position runs away where this one comes to rest no fit does. Of a speed it is integrated twice; where
the load is then is part of the parabola.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.record.windows import segments
from seod.diagnose.tuning.starts import SEARCH_ROOTS

if TYPE_CHECKING:
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array

LEAST_ROWS = 8
"""Of a window: five coefficients and a parabola."""


class PulledBack(NamedTuple):
    """A linear plant.

    Attributes:
        K_L: [unit/s/V].
        omega_n: [rad/s].
        zeta: [-].
        stiffness: Over the load's inertia [1/s^2].
        centre: Where nothing pulls [unit]; of a speed 0, which does not tell it.
    """

    K_L: float
    omega_n: float
    zeta: float
    stiffness: float
    centre: float


def pulled_back(cut: Cut) -> list[PulledBack]:
    """Plants that are stable, by windows of positions, and by segments of them, each half as long.

    What longer ones leave is not white, what shorter ones hold is hardly more than a parabola: whatever the
    plant's own time is, one length suits it.
    """
    longest = max(float(cut.series[k].t[b - 1] - cut.series[k].t[a]) for k, a, b in cut.windows)
    least = SEARCH_ROOTS.shortest_rows * max(one.tick for one in cut.series)
    halvings = range(int(math.log2(max(longest / least, 1.0))) + 1)
    every = [_solved(segments(cut, longest / 2.0**n)) for n in halvings]
    return [one for one in every if one is not None]


def _solved(cut: Cut) -> PulledBack | None:
    """The plant by these windows; None where they tell none that is stable."""
    told = [(k, a, b) for k, a, b in cut.windows if np.count_nonzero(cut.series[k].good[a:b]) > LEAST_ROWS]
    if not told:
        return None
    every = np.concatenate([_integrals(cut.series[k], slice(a, b)) for k, a, b in told])
    sizes = np.linalg.norm(every, axis=0)
    if not (np.all(np.isfinite(sizes)) and np.all(sizes > 0.0)):
        return None
    solved, *_ = np.linalg.lstsq(every[:, 1:] / sizes[1:], every[:, 0], rcond=None)
    damping, speed, place, command, *constant = (solved / sizes[1:]).tolist()
    if not (damping > 0.0 and place > 0.0 and speed > place / damping and command != 0.0):
        return None
    stiffness = place / damping
    omega_n = math.sqrt(speed - stiffness)
    centre = constant[0] / place if constant else 0.0
    return PulledBack(command / omega_n**2, omega_n, 0.5 * damping / omega_n, stiffness, centre)


def _integrals(one: Series, rows: slice) -> Array:
    """What is measured and what coefficients multiply, less parabolas, at good rows, shape (n, 5 or 6)."""
    good = one.good[rows]
    t = one.t[rows] - one.t[rows][0]
    y = np.interp(t, t[good], one.y[rows][good])
    held = np.concatenate([[0.0], np.cumsum(one.u_of_rows[rows][:-1] * np.diff(t))])
    y_1 = _integral(t, y)
    y_2 = _integral(t, y_1)
    y_3 = _integral(t, y_2)
    u_2 = _integral(t, held)
    of_command = [u_2] if one.sees_speed else [_integral(t, u_2), _integral(t, _integral(t, t))]
    terms = np.column_stack([y, -y_1, -y_2, -y_3, *of_command])[good]
    parabola, _ = np.linalg.qr(np.vander(t[good] / t[-1], 3))
    return np.asarray(terms - parabola @ (parabola.T @ terms))


def _integral(t: Array, x: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))])
