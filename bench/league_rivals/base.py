"""What every rival takes and gives, and what several of them measure on a record."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

Array = np.ndarray

APART = 0.1
"""Switches that are nearer than this part of the longest half cycle are chatter of one."""
AROUND = 0.125
"""A peak is fitted over this part of the period to either side."""


class Told(NamedTuple):
    """What a rival may be told; each says what it needs."""

    K_L: float
    """[unit/s/V]"""
    e_a: float
    """[V]"""
    hysteresis: float
    """Half-width of the relay's [unit]."""
    tick: float
    """Of the sampling [s]."""
    delay: float
    """From the sample that asks for a voltage to the voltage's arrival [s]."""

    @property
    def lateness(self) -> float:
        """From a crossing to the switch, on average [s]: a sampled relay sees it half a tick late."""
        return self.delay + 0.5 * self.tick


class Record(NamedTuple):
    """The last whole cycles of a relay's limit cycle; arrays have an element a sample."""

    t: Array
    """When the samples were taken [s], some before the first cycle and after the last."""
    y: Array
    """Position [unit]."""
    t_u: Array
    """When each voltage arrived [s]."""
    u: Array
    """Voltage from then on [V]."""
    ups: Array
    """When the relay turned up [s], shape (cycles + 1,): the cycles' ends."""
    downs: Array
    """When it turned down in between [s], shape (cycles,)."""

    @property
    def period(self) -> float:
        """Mean [s]."""
        return float(self.ups[-1] - self.ups[0]) / (len(self.ups) - 1)


class Found(NamedTuple):
    """A rival's answer; no rival states how sure it is."""

    omega_n: float
    """[rad/s]"""
    zeta: float
    K_L: float | None = None
    """Where it is found and not told [unit/s/V]."""


def last_cycles(t: Array, y: Array, t_u: Array, u: Array, cycles: int) -> Record | None:
    """The newest whole cycles, chatter counted once; None where there are not so many."""
    high = u > 0.5 * (np.min(u) + np.max(u))
    changes = np.flatnonzero(np.diff(high.astype(int))) + 1
    if len(changes) < 2:
        return None
    times, rises = _without_chatter(t_u[changes], high[changes])
    ups, downs = times[rises], times[~rises]
    if len(ups) < cycles + 1:
        return None
    ups = ups[-cycles - 1 :]
    between = [downs[(downs > a) & (downs < b)] for a, b in pairwise(ups)]
    if any(len(x) == 0 for x in between):
        return None
    return Record(t, y, t_u, u, ups, np.array([x[0] for x in between]))


def _without_chatter(times: Array, rises: Array) -> tuple[Array, Array]:
    """Switches that last, each at the time at which alone it would give the same mean voltage."""
    gaps = np.diff(times)
    groups = np.split(np.arange(len(times)), np.flatnonzero(gaps > APART * np.max(gaps)) + 1)
    kept = [group for group in groups if len(group) % 2]
    alone = [times[k[-1]] - np.sum(times[k[1::2]] - times[k[:-1:2]]) for k in kept]
    return np.array(alone), rises[[k[0] for k in kept]]


def extremes(record: Record) -> tuple[Array, Array]:
    """Highest and lowest sample of each cycle [unit], shape (cycles,): what a peak detector takes."""
    high, low = zip(*((np.max(y), np.min(y)) for _, y in _by_cycle(record)), strict=True)
    return np.array(high), np.array(low)


def fitted_extremes(record: Record) -> tuple[Array, Array]:
    """The same by a quartic through the samples about each peak, over which noise averages out."""
    high = [_peak(record, t[np.argmax(y)], 1.0) for t, y in _by_cycle(record)]
    low = [_peak(record, t[np.argmin(y)], -1.0) for t, y in _by_cycle(record)]
    return np.array(high), np.array(low)


def _by_cycle(record: Record) -> list[tuple[Array, Array]]:
    inside = [(record.t >= a) & (record.t < b) for a, b in pairwise(record.ups)]
    return [(record.t[x], record.y[x]) for x in inside]


def _peak(record: Record, about: float, sign: float) -> float:
    half = max(AROUND * record.period, 3.0 * float(record.t[1] - record.t[0]))
    for _ in range(2):  # the second time about the first fit's peak
        near = np.abs(record.t - about) <= half
        x = (record.t[near] - about) / half
        quartic = np.polynomial.Polynomial.fit(x, sign * record.y[near], 4, domain=(-1.0, 1.0))
        fine = np.linspace(-1.0, 1.0, 401)
        values = quartic(fine)
        best = int(np.argmax(values))
        about += half * fine[best]
    return sign * float(values[best])


def harmonic(record: Record, n: int) -> complex:
    """G(j n w) at the n-th multiple of the limit cycle's frequency w: Fourier integrals of y over those of u.

    Over all cycles together: of y by the trapezium rule, of u, which has steps, exactly.
    """
    w = 2.0 * math.pi * n / record.period
    return _of_samples(record, w) / _of_steps(record, w)


def _of_samples(record: Record, w: float) -> complex:
    """Integral of (y - mean) exp(-j w t) over the cycles."""
    begin, end = record.ups[0], record.ups[-1]
    inside = (record.t > begin) & (record.t < end)
    t = np.concatenate([[begin], record.t[inside], [end]])
    ends = np.interp([begin, end], record.t, record.y)
    y = np.concatenate([ends[:1], record.y[inside], ends[1:]])
    y = y - np.trapezoid(y, t) / (end - begin)
    return complex(np.trapezoid(y * np.exp(-1j * w * (t - begin)), t))


def _of_steps(record: Record, w: float) -> complex:
    """Integral of u exp(-j w t) over the cycles."""
    begin, end = record.ups[0], record.ups[-1]
    edges = np.clip(np.append(record.t_u, np.inf), begin, end)
    turned = np.exp(-1j * w * (edges - begin))
    return complex(np.sum(record.u * (turned[:-1] - turned[1:])) / (1j * w))


def from_response(response: complex, w: float, K_L: float) -> Found | None:
    """The plant of which G(jw) / (delay taken off) is `response` [unit/V]; None where there is none."""
    denominator = K_L / (1j * w * response)  # 1 - (w / omega_n)^2 + 2j zeta w / omega_n
    square = 1.0 - denominator.real
    if square <= 0.0 or denominator.imag <= 0.0:
        return None
    omega_n = w / math.sqrt(square)
    return Found(omega_n, 0.5 * denominator.imag * omega_n / w)
