"""Integrals of the response in place of its peaks.

Lee, Sung and Edgar, Integrals of relay feedback responses for extracting process information, AIChE Journal
53, 2007, 2329-2338; Lee and Sung, US 7925362: an integral holds less of the higher harmonics and of the noise
than a peak does.

- `areas`: the amplitude is that of the sine with the same mean rectified value, and then the describing
  function's equation holds. The third harmonic counts a third of what it does in a peak.
- `fourier`: the integrals are weighted by sine and cosine over whole periods, of the response and of the
  relay's output (Sung and Lee, Process identification and PID control, Wiley 2009, ch. 8): no other harmonic
  is left, and one point of the frequency response is exact.

The papers' formulas for a first-order model with dead time are no use for a plant with an integrator and two
poles; the plant follows from the point found, where K_L is told. `fourier` is told when voltages arrived.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from league_rivals.base import from_response, harmonic
from league_rivals.describing import by_amplitude

if TYPE_CHECKING:
    from league_rivals.base import Found, Record, Told


def areas(record: Record, told: Told) -> Found | None:
    """Mean rectified value of a sine of amplitude a: 2 a / pi."""
    inside = (record.t >= record.ups[0]) & (record.t < record.ups[-1])
    y = record.y[inside]
    return by_amplitude(record, told, 0.5 * math.pi * float(np.mean(np.abs(y - np.mean(y)))))


def fourier(record: Record, told: Told) -> Found | None:
    """G(jw) at the limit cycle's frequency."""
    return from_response(harmonic(record, 1), 2.0 * math.pi / record.period, told.K_L)
