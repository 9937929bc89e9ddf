"""Recordings for tests of the diagnosis' parts, by exact transitions, apart from `sim`."""

from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete, lfilter

from seod.data import Recording

K_L, OMEGA_N, ZETA = 17.0, 117.0, 0.3
RATE = 1000.0


def multisine(n, seed=3, volts=2.0):
    """All multiples of half a hertz up to three times the plant's frequency."""
    t = np.arange(n) / RATE
    random = np.random.default_rng(seed)
    lines = np.arange(0.5, 3.0 * OMEGA_N / (2.0 * np.pi), 0.5)
    phases = random.uniform(0.0, 2.0 * np.pi, len(lines))
    u = np.cos(2.0 * np.pi * np.outer(t, lines) + phases).sum(axis=1)
    return volts * u / np.max(np.abs(u))


def linear(u, *, speed=False, lag=0.0):
    """The plant of Eq. 1 from rest, its command held between samples; `lag` [s] of its spool."""
    number, denominator = [K_L * OMEGA_N**2], np.array([1.0, 2.0 * ZETA * OMEGA_N, OMEGA_N**2])
    if not speed:
        denominator = np.polymul(denominator, [1.0, 0.0])
    if lag:
        denominator = np.polymul(denominator, [lag, 1.0])
    b, a, _ = cont2discrete((number, denominator), 1.0 / RATE)
    return lfilter(b.ravel(), a, u)


def recording(u, y, noise=0.01, seed=5, **more):
    """With white noise of this part of y's standard deviation."""
    t = np.arange(len(y)) / RATE
    y = y + np.random.default_rng(seed).normal(0.0, noise * np.std(y), len(y))
    values = {"t_u": None, "ps": None, "temperature": None, "names": {}, "units": {}, "problems": ()} | more
    return Recording((Path("run.csv"),), t, u, y, rows=np.arange(len(y)), **values)
