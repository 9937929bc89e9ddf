"""The response under a voltage that does not repeat: averaged spectra of overlapping windows (Welch).

Both sides are means between neighbouring ticks: of the voltage exactly, of the speed as the position's
difference. So their ratio is G_L, without the hold of the voltage, and a position's drift does not leak.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from seod.respond.period import even_voltage
from seod.respond.points import Points
from seod.respond.record import RespondError

if TYPE_CHECKING:
    from seod.respond.record import Array, Complex, Segment

_WINDOWS: Final = 8
"""Lengths of a window in a recording; with half overlapping there are 15."""
_POINTS: Final = 60
_HIGHEST: Final = 0.25
"""Of the samples' rate."""
_GAP: Final = 5.0
"""Ticks without a sample that are bridged."""
FEWEST_SAMPLES: Final = 512
_EXCITED: Final = 1e-3
"""Power, in parts of the largest; below, it is what leaks from elsewhere."""
_LEAKS: Final = 0.02
"""A point is not believed better than this: windows cut a sweep, and what leaks does not average out."""


def broadband(segment: Segment) -> Points:
    """Points at up to 60 frequencies, spread by octaves; those that the voltage hardly excites are left out.

    Raises:
        RespondError: Too short, or samples are missing.
    """
    if len(segment.t) < FEWEST_SAMPLES:
        raise RespondError(
            f"{segment.name}: {len(segment.t)} samples are too few: without a period it takes "
            f"{FEWEST_SAMPLES}, {FEWEST_SAMPLES * segment.tick:.3g} s at this rate; a command that repeats "
            "(`--period S`) takes less"
        )
    gap = float(np.diff(segment.t).max())
    if gap > _GAP * segment.tick:
        raise RespondError(
            f"{segment.name}: no samples for {gap:.3g} s; give a part without gaps (--between)"
        )
    edges = np.linspace(segment.t[0], segment.t[-1], len(segment.t))
    tick = float(edges[1] - edges[0])
    u, y = even_voltage(segment, edges), np.interp(edges, segment.t, segment.y)
    speed = np.diff(y) / tick if segment.output == "position" else 0.5 * (y[1:] + y[:-1])
    n = len(u) // _WINDOWS
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(n, tick), np.float64)
    spectra = [_windowed(x, n) for x in (u, speed)]
    used = np.flatnonzero((omega > 1.5 * omega[1]) & (omega < 2.0 * np.pi * _HIGHEST / tick))
    found = _banded(omega[used], *(each[:, used] for each in spectra))
    return _as_measured(found, segment, tick)


def _windowed(x: Array, n: int) -> Complex:
    """Spectra of Hann windows, half overlapping, each without its mean."""
    window = np.hanning(n + 1)[:-1]
    starts = range(0, len(x) - n + 1, n // 2)
    return np.array([np.fft.rfft((x[s : s + n] - x[s : s + n].mean()) * window) for s in starts])


def _banded(omega: Array, u: Complex, y: Complex) -> Points:
    """Cross spectra over windows and over neighbouring lines."""
    edges: Array = np.geomspace(omega[0], omega[-1] * 1.0001, _POINTS + 1)
    place = np.digitize(omega, edges)
    rows = [_band(omega[place == k], u[:, place == k], y[:, place == k]) for k in np.unique(place)]
    omegas, G, variance, coherence, power = (np.array(column) for column in zip(*rows, strict=True))
    kept = power > _EXCITED * power.max()
    volts = 2.0 * np.sqrt(power)
    sd = np.sqrt(0.5 * (variance + (_LEAKS * np.abs(G)) ** 2))
    return Points(omegas[kept].real, G[kept], sd[kept], coherence[kept].real, volts[kept])


def _band(omega: Array, u: Complex, y: Complex) -> tuple[float, complex, float, float, float]:
    cross, uu, yy = np.sum(y * u.conj()), float(np.sum(np.abs(u) ** 2)), float(np.sum(np.abs(y) ** 2))
    weight = np.sum(np.abs(u) ** 2, axis=0)
    centre = float(omega @ weight / max(weight.sum(), 1e-300))
    coherence = min(1.0, float(abs(cross) ** 2) / max(uu * yy, 1e-300))
    G = complex(cross / max(uu, 1e-300))
    independent = max(1.5, 0.45 * u.size)  # half overlapping windows, and lines as wide as a Hann window's
    variance = abs(G) ** 2 * (1.0 - coherence) / max(coherence, 1e-12) / independent
    return centre, G, variance, coherence, uu / u.size


def _as_measured(found: Points, segment: Segment, tick: float) -> Points:
    """From the ratio of means to the response of what was measured."""
    half = 0.5 * found.omega * tick
    if segment.output == "position":
        factor = 1.0 / (1j * found.omega)
    else:
        factor = np.sinc(half / np.pi) / np.cos(half) + 0j
    return Points(found.omega, found.G * factor, found.sd * np.abs(factor), found.coherence, found.volts)
