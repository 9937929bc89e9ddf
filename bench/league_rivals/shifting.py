"""The shifting method, on a relay with unequal levels.

Hofreiter, Shifting method for relay feedback identification, IFAC-PapersOnLine 49, 2016, 1933-1938; Improved
relay feedback identification using shifting method, ICINCO 2019; Relay identification using shifting method
for PID controller tuning, Energies 14, 2021, 5945.

A periodic signal and itself shifted by half a period add up to one of half the period, which holds the even
harmonics alone: its Fourier integral over half a period is that of the signal at 2 w over a whole one. So one
relay test gives G(jw) and G(2jw), whatever the load. Their magnitudes hold no delay. With the gain known,

    (K_L / (w |G|))^2 - 1 = w^2 b + w^4 / omega_n^4,    b = (2 zeta / omega_n)^2 - 2 / omega_n^2

is linear in its two unknowns. A stable plant's gain is that of the means; an integrator has none, and is told
K_L.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from league_rivals.base import Found, harmonic

if TYPE_CHECKING:
    from league_rivals.base import Record, Told


def shifting(record: Record, told: Told) -> Found | None:
    """From the magnitudes at w and 2 w."""
    w = 2.0 * math.pi / record.period * np.array([1.0, 2.0])
    response = np.array([harmonic(record, 1), harmonic(record, 2)])
    squares = (told.K_L / (w * np.abs(response))) ** 2
    b, fourth = np.linalg.solve(np.stack([w**2, w**4], axis=1), squares - 1.0)
    if fourth <= 0.0:
        return None
    omega_n = fourth**-0.25
    damped = b + 2.0 / omega_n**2
    return Found(omega_n, 0.5 * omega_n * math.sqrt(damped)) if damped > 0.0 else None
