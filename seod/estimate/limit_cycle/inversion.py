"""From a measured limit cycle to the plant: the paper's arithmetic, and the exact one."""

from __future__ import annotations

import math
from typing import NamedTuple

from seod.estimate.limit_cycle.closed_form import ZETA_MAX, ZETA_MIN, LimitCycle

_ITERATIONS = 40
_STEP_MAX = 0.7
"""Longest Newton step in the logarithm of either unknown."""
_LN_ZETA = math.log(ZETA_MIN / 2.0), math.log(ZETA_MAX * 2.0)
"""The search may look a factor of 2 beyond the range of zeta, so that its edge is judged fairly."""
_SOLVED = 1e-4
"""Largest mismatch of a solution, as a part of the amplitude."""
_LN_RATIO = math.log(100.0)
"""And a factor of 100 about the limit cycle's frequency for omega_n."""

_Pair = tuple[float, float]


class Plant(NamedTuple):
    """What the limit cycle tells of G_L: omega_n in rad/s, zeta."""

    omega_n: float
    zeta: float


class Measured(NamedTuple):
    """A limit cycle as measured: means over a window.

    `h_up` and `h_down` are how long u was up and down [s]; `lag_up` and `lag_down` go from the crossing of
    the position to the switch really applied, up and down [s]; `V_s` is half the peak-to-peak position.
    """

    h_up: float
    h_down: float
    lag_up: float
    lag_down: float
    V_s: float


class Sensitivity(NamedTuple):
    """Derivatives of ln(omega_n) and ln(zeta) by each entry of `Measured`."""

    omega_n: Measured
    zeta: Measured


def eq8(zeta: float) -> tuple[float, float]:
    """Correction factors xi and Gamma by the paper's polynomials (Eq. 8)."""
    xi = 1.0 + zeta * (-0.0315 + zeta * (0.00415 - zeta * 0.000185))
    gamma = 1.27 + zeta * (0.0647 + zeta * (-0.00762 + zeta * 0.000307))
    return xi, gamma


def invert_eq8(omega_s: float, V_s: float, K_L: float, e_a: float) -> Plant | None:
    """Eqs. 5 to 8, iterated from xi = 0.95 and Gamma = 1.4 as in section 2.3(4).

    Args:
        omega_s: Frequency of the limit cycle [rad/s].
        V_s: Its amplitude, half the peak-to-peak position [axis unit].
        K_L: Gain [axis unit/s/V].
        e_a: Relay amplitude [V].

    Returns:
        The plant; None where the iteration leaves zeta's range 0.02 to 10 or does not end.
    """
    xi, gamma, zeta = 0.95, 1.4, 0.0
    if not V_s * omega_s > 1e-290:
        return None
    for _ in range(100):
        before, zeta = zeta, gamma * xi * K_L * e_a / (2.0 * V_s * omega_s)
        if not zeta < 2.0 * ZETA_MAX:
            return None
        xi, gamma = eq8(zeta)
        if abs(zeta - before) <= 1e-10 * zeta:
            return _in_range(Plant(omega_s / xi, zeta))
    return None


def invert(
    measured: Measured, hysteresis: float, K_L: float, e_a: float, start: Plant | None = None
) -> Plant | None:
    """The plant whose exact limit cycle is the measured one; hysteresis [axis unit] is the half-width.

    Two conditions: the position at the two crossings differs by twice the hysteresis, and its peak-to-peak
    value is 2 V_s. Newton's method in ln(omega_n), ln(zeta) from `start` (left out: from the describing
    function), each step shortened until the mismatch falls.

    Returns:
        The plant; None where there is none with zeta in 0.02 to 10.
    """
    if not _is_possible(measured, K_L * e_a):
        return None
    conditions = _Conditions(measured, hysteresis, K_L * e_a)
    start = start or describing_function(measured, hysteresis, K_L, e_a)
    at = math.log(start.omega_n), math.log(start.zeta)
    r = conditions.mismatch(at)
    for _ in range(_ITERATIONS):
        step = _solve(conditions.jacobian(at, r), r)
        found = conditions.descend(at, r, step)
        if found is None:
            return None
        at, r = found
        if max(abs(step[0]), abs(step[1])) < 1e-6:  # quadratic convergence: the error left is far smaller
            solved = math.hypot(*r) < _SOLVED  # a step can also be small beside a kink of the mismatch
            return _in_range(Plant(math.exp(at[0]), math.exp(at[1]))) if solved else None
    return None


def sensitivity(plant: Plant, measured: Measured, hysteresis: float, K_L: float, e_a: float) -> Sensitivity:
    """How the inverted plant answers to each measured number, by the implicit function theorem."""
    at = math.log(plant.omega_n), math.log(plant.zeta)
    conditions = _Conditions(measured, hysteresis, K_L * e_a)
    r = conditions.mismatch(at)
    jacobian = conditions.jacobian(at, r)
    steps = [1e-6 * (measured.h_up + measured.h_down)] * 4 + [1e-6 * measured.V_s]
    answers = []
    for i, step in enumerate(steps):
        values = [*measured]
        values[i] += step
        q = _Conditions(Measured(*values), hysteresis, K_L * e_a).mismatch(at)
        answers.append(_solve(jacobian, ((q[0] - r[0]) / step, (q[1] - r[1]) / step)))
    return Sensitivity(Measured(*(a[0] for a in answers)), Measured(*(a[1] for a in answers)))


class _Conditions(NamedTuple):
    """What the plant has to fulfil; `gain` is K_L e_a. Unknowns are `at` = ln(omega_n), ln(zeta)."""

    measured: Measured
    hysteresis: float
    gain: float

    def mismatch(self, at: _Pair) -> _Pair:
        """Both conditions, as fractions of the amplitude; zero at the plant."""
        m, omega_n = self.measured, math.exp(at[0])
        h_up = omega_n * m.h_up
        cycle = LimitCycle.of(math.exp(at[1]), h_up, omega_n * m.h_down)
        rise = cycle.position(h_up - omega_n * m.lag_down) - cycle.position(-omega_n * m.lag_up)
        unit = self.gain / (omega_n * m.V_s)
        size = 0.5 * unit * cycle.peak_to_peak()
        return rise * unit - 2.0 * self.hysteresis / m.V_s, math.log(max(size, 1e-12))

    def jacobian(self, at: _Pair, r: _Pair) -> tuple[_Pair, _Pair]:
        """Derivatives of the mismatch `r` by each unknown, by differences."""
        step = 1e-6
        by_x = self.mismatch((at[0] + step, at[1]))
        by_y = self.mismatch((at[0], at[1] + step))
        return (
            ((by_x[0] - r[0]) / step, (by_x[1] - r[1]) / step),
            ((by_y[0] - r[0]) / step, (by_y[1] - r[1]) / step),
        )

    def descend(self, at: _Pair, r: _Pair, step: _Pair) -> tuple[_Pair, _Pair] | None:
        """Go along `step` as far as lessens the mismatch, within the bounds; None where nothing does."""
        shrink = min(1.0, _STEP_MAX / max(abs(step[0]), abs(step[1]), 1e-300))
        middle = math.log(2.0 * math.pi / (self.measured.h_up + self.measured.h_down))
        for _ in range(20):
            x = min(max(at[0] + shrink * step[0], middle - _LN_RATIO), middle + _LN_RATIO)
            to = x, min(max(at[1] + shrink * step[1], _LN_ZETA[0]), _LN_ZETA[1])
            q = self.mismatch(to)
            if math.hypot(*q) <= max(math.hypot(*r), 1e-9):
                return to, q
            shrink *= 0.5
        return None


def _is_possible(m: Measured, gain: float) -> bool:
    """Whether these can be numbers of a limit cycle at all, so that the arithmetic stays finite."""
    period = m.h_up + m.h_down
    if min(m.h_up, m.h_down) < 1e-3 * period or not period > 0.0:
        return False
    lags = max(abs(m.lag_up), abs(m.lag_down))
    return lags < period and 1e-6 * m.V_s < gain * period < 1e6 * m.V_s


def _in_range(plant: Plant) -> Plant | None:
    return plant if ZETA_MIN * (1.0 - 1e-6) <= plant.zeta <= ZETA_MAX * (1.0 + 1e-6) else None


def describing_function(measured: Measured, hysteresis: float, K_L: float, e_a: float) -> Plant:
    """The plant, roughly, by the relay's fundamental; lag and hysteresis count as phase."""
    omega_s = 2.0 * math.pi / (measured.h_up + measured.h_down)
    delay = 0.5 * omega_s * (measured.lag_up + measured.lag_down)
    delay += math.asin(min(0.9, hysteresis / measured.V_s))
    ratio = 4.0 * e_a * K_L / (math.pi * omega_s * measured.V_s)  # |G_L(0) / G_L(j omega_s)|
    cos, sin = math.sin(delay), max(math.cos(delay), 0.05)
    x2 = max(1.0 - ratio * cos, 0.02)
    zeta = 0.5 * ratio * sin / math.sqrt(x2)
    zeta = min(max(zeta, ZETA_MIN), ZETA_MAX)
    return Plant(omega_s / math.sqrt(x2), zeta)


def _solve(jacobian: tuple[_Pair, _Pair], r: _Pair) -> _Pair:
    """-J^-1 r; a small pull towards zero where J is singular."""
    (a, c), (b, d) = jacobian
    det = a * d - b * c
    if abs(det) < 1e-12:
        return math.copysign(0.1, -r[0]), math.copysign(0.1, -r[1])
    return (b * r[1] - d * r[0]) / det, (c * r[0] - a * r[1]) / det
