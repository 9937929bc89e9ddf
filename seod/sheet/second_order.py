"""What Eq. 1 says of frequency response and step response: from voltage to speed, without any delay.

    G_L(s) / K_L = omega_n^2 / (s^2 + 2 zeta omega_n s + omega_n^2)

Functions take zeta and give frequencies over omega_n and times by omega_n; `propagated` makes figures with
intervals of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri

from seod.calibrate.value import Value
from seod.sheet.limits import RISE, SETTLED
from seod.sheet.trend import half

if TYPE_CHECKING:
    from collections.abc import Callable

MINUS_3_DB: Final = 10.0 ** (-3.0 / 20.0)
_STEPS: Final = 101
"""Equally probable values of zeta, and of omega_n, of which intervals are made: three digits of an end."""
_DOUBLE: Final = 1e-6
"""Distance of zeta from 1 within which both poles count as one: the difference would be lost to rounding."""
_LEAST: Final = 1e-3
"""Of zeta: a normal distribution may reach below 0, a plant that is excited does not."""


def bandwidth(zeta: float) -> float:
    """Where the gain has fallen by 3 dB, over omega_n."""
    b = 1.0 - 2.0 * zeta**2
    return math.sqrt(b + math.sqrt(b**2 + MINUS_3_DB**-2 - 1.0))


def phase_90(zeta: float) -> float:  # noqa: ARG001 - all of these take zeta
    """Where the phase is -90 deg, over omega_n: there, whatever zeta."""
    return 1.0


def missing(zeta: float, x: float) -> float:
    """What a unit step response lacks of 1 at the time x / omega_n."""
    if abs(zeta - 1.0) < _DOUBLE:
        return math.exp(-x) * (1.0 + x)
    if zeta < 1.0:
        damped = math.sqrt(1.0 - zeta**2)
        return math.exp(-zeta * x) * (math.cos(damped * x) + zeta / damped * math.sin(damped * x))
    root = math.sqrt(zeta**2 - 1.0)
    fast = zeta + root
    slow = 1.0 / fast  # not zeta - root, which loses digits
    return (fast * math.exp(-slow * x) - slow * math.exp(-fast * x)) / (fast - slow)


def rise_time(zeta: float) -> float:
    """Between 10 and 90 % of the final speed, times omega_n."""
    end = _peak(zeta)
    first, last = (brentq(lambda x, part=part: missing(zeta, x) - 1.0 + part, 0.0, end) for part in RISE)
    return float(last - first)


def _peak(zeta: float) -> float:
    """Until here the response only rises; at least to 95 % of its end."""
    return math.pi / math.sqrt(1.0 - zeta**2) if zeta < 1.0 - _DOUBLE else 8.0 * zeta


def overshoot(zeta: float) -> float:
    """By how much the response goes beyond its end, in parts of it."""
    return math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)) if zeta < 1.0 - _DOUBLE else 0.0


def settling_time(zeta: float) -> float:
    """After which the response stays within 5 % of its end, times omega_n."""
    if zeta >= 1.0 - _DOUBLE:
        return float(brentq(lambda x: missing(zeta, x) - SETTLED, 0.0, 8.0 * zeta))
    to_peak = _peak(zeta)
    turns = max(1, math.ceil(-math.log(SETTLED) / (zeta * to_peak)))  # until one is within the band
    before, at = (turns - 1) * to_peak, turns * to_peak
    edge = math.copysign(SETTLED, missing(zeta, before))
    return float(brentq(lambda x: missing(zeta, x) - edge, before, at))


def propagated(of: Callable[[float], float], zeta: Value, omega_n: Value, power: int) -> Value:
    """A figure `of(zeta) * omega_n ** power` with the 95 % interval that follows from both intervals.

    Equally probable values of zeta and omega_n, taken as normal and independent, each with each: so that
    figures that bend or jump with zeta, as a settling time does, have intervals that are true.

    Args:
        of: A function of zeta.
        zeta: With its interval.
        omega_n: With its interval.
        power: Of omega_n: 1 for a frequency, -1 for a time, 0 for neither.
    """
    normal = ndtri((np.arange(_STEPS) + 0.5) / _STEPS)
    zetas = np.maximum(zeta.value + half(zeta) / 1.96 * normal, _LEAST)
    omegas = np.maximum(omega_n.value + half(omega_n) / 1.96 * normal, _LEAST * omega_n.value)
    every = np.outer([of(each) for each in zetas.tolist()], omegas**power)
    low, high = np.quantile(every, (0.025, 0.975)).tolist()
    return Value(of(zeta.value) * omega_n.value**power, float(every.std()), (low, high))
