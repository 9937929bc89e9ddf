"""The symmetrical relay with its describing function.

Astrom and Hagglund, Automatic tuning of simple regulators with specifications on phase and amplitude margins,
Automatica 20, 1984, 645-651: the limit cycle is where G(jw) = -1 / N(a), and of a relay with hysteresis

    -1 / N(a) = -(pi / 4 d) (sqrt(a^2 - eps^2) + j eps).

LinuxCNC's `at_pid` takes the largest error of each half cycle and the mean period over a number of cycles;
Klipper's `pid_calibrate` the highest and lowest reading of the cycle of median length; both leave eps out
(Klipper's pull request 7310 is about it). Both stop at gain and period of -180 degrees. The plant follows
from that one point where K_L is known; the lateness of the loop, which neither knows of, is told here and
taken off.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np

from league_rivals.base import extremes, from_response

if TYPE_CHECKING:
    from league_rivals.base import Found, Record, Told


def describing(record: Record, told: Told) -> Found | None:
    """Amplitude from the highest and lowest samples, averaged over all cycles as LinuxCNC does."""
    high, low = extremes(record)
    return by_amplitude(record, told, 0.5 * float(np.mean(high - low)))


def by_amplitude(record: Record, told: Told, a: float) -> Found | None:
    """The plant by an amplitude [unit] and the mean period."""
    if a <= told.hysteresis:
        return None
    w = 2.0 * math.pi / record.period
    square_root = math.sqrt(a**2 - told.hysteresis**2)
    seen = -math.pi / (4.0 * told.e_a) * complex(square_root, told.hysteresis)
    return from_response(seen * cmath.exp(1j * w * told.lateness), w, told.K_L)
