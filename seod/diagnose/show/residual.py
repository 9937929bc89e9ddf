"""The residual of a simulation as what a missing cause would have to be: a force on the load, or volts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Mask, Output, Score, Window

_BAND: Final = 4.0
"""Frequencies up to so many omega_n are looked at: above, differentiating shows the noise alone."""
_ENDS: Final = 0.05
"""Part of a window at each end in which the filter knows too little."""


class Residual(NamedTuple):
    """Of one model in one window; arrays of shape (n,).

    Attributes:
        error: Measured less simulated [unit of y]; nan where no sample is.
        force: What would have to brake the load [unit/s^2]; nan at the ends.
        volts: What would have to be added to the command [V]; nan at the ends.
    """

    error: Array
    force: Array
    volts: Array


def residual(window: Window, simulated: Array, model: Score, output: Output) -> Residual:
    """The residual of `simulated`, seen through Eq. 1 of `model`.

    From Eq. 1 with a force f against the load and volts w: (s^2 + 2 zeta omega_n s + omega_n^2) v =
    omega_n^2 K_L (u + w) - (s + 2 zeta omega_n) f (docs/model.md).
    """
    error = window.y - simulated
    tick = float(np.median(np.diff(window.t)))
    omega_n, zeta = model.omega_n, model.zeta
    line = _line(_filled(error))
    rest = _filled(error) - line
    s = 2j * math.pi * np.fft.rfftfreq(2 * len(rest), tick)
    top = min(_BAND * omega_n, 0.5 * math.pi / tick)
    rest = np.fft.rfft(np.r_[rest, np.zeros(len(rest))]) * np.exp(-(np.abs(s / top) ** 4))
    speed = rest * s if output == "position" else rest
    steady = np.gradient(line, tick) if output == "position" else line
    inverse = s * s + 2.0 * zeta * omega_n * s + omega_n**2
    braking = -np.fft.irfft(speed * inverse / (s + 2.0 * zeta * omega_n))[: len(error)]
    volts = np.fft.irfft(speed * inverse)[: len(error)] / (omega_n**2 * model.K_L)
    inner = _inner(len(error))
    return Residual(
        error,
        np.where(inner, braking - steady * omega_n / (2.0 * zeta), np.nan),
        np.where(inner, volts + steady / model.K_L, np.nan),
    )


def _filled(error: Array) -> Array:
    """Missing samples on a straight line between their neighbours."""
    present = np.isfinite(error)
    if present.all():
        return error
    rows = np.arange(len(error))
    return np.interp(rows, rows[present], error[present]) if present.any() else np.zeros(len(error))


def _line(error: Array) -> Array:
    """Through both ends, so that what is left begins and ends at 0."""
    few = max(1, len(error) // 50)
    rows = np.array([0.5 * (few - 1), len(error) - 1 - 0.5 * (few - 1)])
    ends = [float(np.mean(error[:few])), float(np.mean(error[-few:]))]
    slope = (ends[1] - ends[0]) / max(1.0, float(rows[1] - rows[0]))
    return np.asarray(ends[0] + slope * (np.arange(len(error)) - rows[0]))


def _inner(n: int) -> Mask:
    rows = np.arange(n)
    return np.asarray((rows >= _ENDS * n) & (rows < (1.0 - _ENDS) * n))
