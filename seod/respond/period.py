"""Whether a voltage repeats, and after which time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from seod.respond.record import Array, Segment

_ALIKE: Final = 0.85
"""Correlation with itself one period later, at least; a relay's switches come a tick early or late."""
_NEAR_BEST: Final = 0.1
_SHORTEST: Final = 6
"""Ticks of a period."""
_PERIODS: Final = 4
"""At least, or nothing can be said of it."""


def even_voltage(segment: Segment, edges: Array) -> Array:
    """Mean of the stepwise voltage between neighbouring `edges` [s], exact; shape (len(edges) - 1,)."""
    lengths = np.diff(segment.began)
    area = np.concatenate(([0.0], np.cumsum(segment.u[:-1] * lengths)))
    place = np.clip(np.searchsorted(segment.began, edges, side="right") - 1, 0, len(segment.u) - 1)
    whole = area[place] + segment.u[place] * (edges - segment.began[place])
    return np.asarray(np.diff(whole) / np.diff(edges))


def find_period(segment: Segment) -> float | None:
    """Period of the voltage [s], to a part of a tick; None if it does not repeat four times."""
    tick = segment.tick
    edges = np.arange(max(segment.t[0], segment.began[0]), segment.t[-1], tick)
    if len(edges) < _PERIODS * _SHORTEST:
        return None
    alike = _correlation(even_voltage(segment, edges))
    longest = len(alike) // _PERIODS
    peaks = [k for k in range(_SHORTEST, longest) if alike[k - 1] < alike[k] >= alike[k + 1]]
    best = max((alike[k] for k in peaks), default=0.0)
    if best < _ALIKE:
        return None
    first = next(k for k in peaks if alike[k] >= max(_ALIKE, best - _NEAR_BEST))
    return tick * _refined(alike, first)


def _correlation(u: Array) -> Array:
    """With itself, lags up to the length."""
    n, u = len(u), u - u.mean()
    power = np.abs(np.fft.rfft(u, 2 * n)) ** 2
    total = np.fft.irfft(power)[:n]
    return np.asarray(total / np.arange(n, 0, -1) / max(float(total[0]) / n, 1e-300))


def _refined(alike: Array, first: int) -> float:
    """In ticks: the peak after ever more periods, as long as there is one."""
    period, periods = _top(alike, first), 1
    while True:
        periods *= 2
        near = round(period * periods)
        if near + 2 >= len(alike) // 2:
            return period
        place = near - 1 + int(np.argmax(alike[near - 1 : near + 2]))
        if alike[place] < _ALIKE:
            return period
        period = _top(alike, place) / periods


def _top(alike: Array, k: int) -> float:
    """Of the parabola through three neighbours."""
    bend = alike[k - 1] - 2.0 * alike[k] + alike[k + 1]
    return float(k + (0.5 * (alike[k - 1] - alike[k + 1]) / bend if bend < 0.0 else 0.0))
