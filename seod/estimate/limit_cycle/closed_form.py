"""The exact limit cycle of Fig. 2: an integrator and G_L (Eq. 1) under a relay, in closed form.

Normalised: time in 1/omega_n, velocity in K_L e_a, position in K_L e_a / omega_n. Then the velocity v obeys
v'' + 2 zeta v' + v = drive, drive = +-1 plus the load bias. The closed forms hold for any zeta > 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.arrays import Array

ZETA_MIN = 0.02
ZETA_MAX = 10.0
_NEARLY_CRITICAL = 1e-5
"""|1 - zeta^2| below which the closed forms would divide by nearly zero: their series are used."""


class Motion(NamedTuple):
    """Velocity and acceleration, normalised."""

    v: float
    a: float


def transition(zeta: float, t: float) -> tuple[float, float]:
    """exp(-zeta t) cos(w t) and exp(-zeta t) sin(w t) / w, w^2 = 1 - zeta^2; w may be 0 or imaginary."""
    w2 = 1.0 - zeta * zeta
    if abs(w2) < _NEARLY_CRITICAL:
        decay, x2 = math.exp(-zeta * t), w2 * t * t
        return decay * (1.0 - x2 / 2.0 + x2 * x2 / 24.0), decay * t * (1.0 - x2 / 6.0 + x2 * x2 / 120.0)
    if w2 < 0.0:
        k = math.sqrt(-w2)
        slow, fast = math.exp(-t / (zeta + k)), math.exp(-t * (zeta + k))  # 1 / (zeta + k) is zeta - k
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / k
    w, decay = math.sqrt(w2), math.exp(-zeta * t)
    return decay * math.cos(w * t), decay * math.sin(w * t) / w


def transitions(zeta: float, t: Array) -> tuple[Array, Array]:
    """`transition` for many times, shape (n,)."""
    w2 = 1.0 - zeta * zeta
    if abs(w2) < _NEARLY_CRITICAL:
        decay, x2 = np.exp(-zeta * t), w2 * t * t
        return decay * (1.0 - x2 / 2.0 + x2 * x2 / 24.0), decay * t * (1.0 - x2 / 6.0 + x2 * x2 / 120.0)
    if w2 < 0.0:
        k = math.sqrt(-w2)
        slow, fast = np.exp(-t / (zeta + k)), np.exp(-t * (zeta + k))
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / k
    w, decay = math.sqrt(w2), np.exp(-zeta * t)
    return decay * np.cos(w * t), decay * np.sin(w * t) / w


def advance(zeta: float, start: Motion, drive: float, t: float) -> Motion:
    """The motion `t` later under a constant drive."""
    c, s = transition(zeta, t)
    z = start.v - drive
    return Motion(drive + z * (c + zeta * s) + start.a * s, start.a * (c - zeta * s) - z * s)


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """The periodic motion under a relay that is up (+1) for `h_up`, then down (-1) for `h_down`.

    Position counts from its value at the upward switch, time from there too. A periodic position has no mean
    velocity, so the load bias is `-(h_up - h_down) / (h_up + h_down)`: it needs no unknown.
    """

    zeta: float
    h_up: float
    h_down: float
    bias: float
    at_up: Motion
    at_down: Motion
    rise: float
    """Position at the downward switch."""

    @classmethod
    def of(cls, zeta: float, h_up: float, h_down: float) -> LimitCycle:
        """Solve for the motion that repeats after `h_up + h_down`: (I - M(T)) w = 2 (M(h_down) - I) e_v."""
        period = h_up + h_down
        bias = (h_down - h_up) / period
        c, s = transition(zeta, period)
        a11, a22 = 1.0 - c - zeta * s, 1.0 - c + zeta * s
        det = a11 * a22 + s * s
        c, s_half = transition(zeta, h_down)
        b1, b2 = 2.0 * (c + zeta * s_half - 1.0), -2.0 * s_half
        drive = 1.0 + bias
        at_up = Motion(drive + (a22 * b1 + s * b2) / det, (a11 * b2 - s * b1) / det)
        at_down = advance(zeta, at_up, drive, h_up)
        return cls(zeta, h_up, h_down, bias, at_up, at_down, _travel(zeta, at_up, at_down, drive, h_up))

    def position(self, t: float) -> float:
        """Position at time `t` after an upward switch; any `t`, before or after."""
        t %= self.h_up + self.h_down
        if t <= self.h_up:
            return self._moved(self.at_up, 1.0, t)
        return self.rise + self._moved(self.at_down, -1.0, t - self.h_up)

    def positions(self, t: Array) -> Array:
        """`position` for many times, shape (n,)."""
        t = t % (self.h_up + self.h_down)
        up = t <= self.h_up
        t = np.where(up, t, t - self.h_up)
        v = np.where(up, self.at_up.v, self.at_down.v)
        a = np.where(up, self.at_up.a, self.at_down.a)
        drive = np.where(up, 1.0, -1.0) + self.bias
        c, s = transitions(self.zeta, t)
        z = v - drive
        gain_v = z * (c + self.zeta * s - 1.0) + a * s
        gain_a = a * (c - self.zeta * s - 1.0) - z * s
        return np.where(up, 0.0, self.rise) + drive * t - gain_a - 2.0 * self.zeta * gain_v

    def peak_to_peak(self) -> float:
        """Highest minus lowest position."""
        lowest = self._moved(self.at_up, 1.0, self._standstill(self.at_up, 1.0, self.h_up))
        highest = self._moved(self.at_down, -1.0, self._standstill(self.at_down, -1.0, self.h_down))
        return self.rise + highest - lowest

    def _moved(self, start: Motion, relay: float, t: float) -> float:
        drive = relay + self.bias
        return _travel(self.zeta, start, advance(self.zeta, start, drive, t), drive, t)

    def _standstill(self, start: Motion, relay: float, h: float) -> float:
        """When the velocity passes zero within `h` of a switch; 0 where it already has."""
        if start.v * relay >= 0.0:
            return 0.0
        low, high, t = 0.0, h, 0.5 * h
        for _ in range(50):
            motion = advance(self.zeta, start, relay + self.bias, t)
            if motion.v * relay < 0.0:
                low = t
            else:
                high = t
            step = -motion.v / motion.a if motion.a else math.inf
            if abs(step) < 1e-9 * h:
                break
            t = t + step if low < t + step < high else 0.5 * (low + high)
        return t


def _travel(zeta: float, start: Motion, end: Motion, drive: float, t: float) -> float:
    """Integral of the velocity, from the integrated equation of motion."""
    return drive * t - (end.a - start.a) - 2.0 * zeta * (end.v - start.v)


def correction_factors(zeta: float) -> tuple[float, float]:
    """Exact xi = omega_s / omega_n (Eq. 5) and Gamma = V_s / e_c (Eq. 7) of the ideal relay, no lag.

    The half period h is where the position is back at the crossing after half a period: `rise` is zero.
    """
    low, high = 0.5 * math.pi, 2.0 * math.pi
    while high - low > 1e-13 * high:
        h = 0.5 * (low + high)
        if LimitCycle.of(zeta, h, h).rise < 0.0:
            low = h
        else:
            high = h
    cycle = LimitCycle.of(zeta, high, high)
    return math.pi / high, zeta * cycle.peak_to_peak()
