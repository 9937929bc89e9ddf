"""Fourier coefficients over whole periods: exact ones of a stepwise voltage, least squares of samples.

A coefficient c stands for Re(c exp(j omega (t - start))). Times are the samples' and voltages' own, so that
jitter, gaps and a period that is no whole number of ticks do no harm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.respond.record import RespondError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.respond.record import Array, Complex, Segment

    Flags = NDArray[np.bool_]

FEWEST_WINDOWS: Final = 3
"""Their scatter is the variance."""
MOST_WINDOWS: Final = 12
MOST_HARMONICS: Final = 200
EXCITED: Final = 0.02
"""Lines with at least this part of the largest voltage are excited."""
SINE: Final = 5
"""Harmonics of a single tone that are looked at."""
_FILLED: Final = 0.8
"""Part of a window's samples that must be there."""
_HIGHEST: Final = 0.4
"""Highest harmonic, as a part of the samples' rate: beyond, the stepwise voltage's images fold back."""


@dataclass(frozen=True)
class Spectra:
    """Harmonics of the excitation's period, window by window.

    Attributes:
        period: [s].
        orders: Multiples of 1 / period, shape (l,).
        u: Coefficients of the voltage [V], shape (windows, l).
        y: Of the samples [unit], likewise.
    """

    period: float
    orders: Array
    u: Complex
    y: Complex

    @property
    def omega(self) -> Array:
        """Frequencies [rad/s], shape (l,)."""
        return np.asarray(2.0 * np.pi / self.period * self.orders)


def spectra(segment: Segment) -> Spectra:
    """Coefficients of each window of whole periods; the first harmonic is the time's origin where it leads.

    Args:
        segment: With a period; transients left out.

    Raises:
        RespondError: It holds too few periods, or too few samples in each.
    """
    period = segment.period
    if period is None:
        raise RespondError(f"{segment.name}: the excitation's period is not known")
    starts, length = _windows(segment, period)
    orders = np.arange(1.0, min(int(_HIGHEST * period / segment.tick), MOST_HARMONICS) + 1.0)
    if not len(orders):
        raise RespondError(f"{segment.name}: a period of {period:.4g} s holds too few samples")
    omega = 2.0 * np.pi / period * orders
    u = np.array([of_voltage(segment, start, length, omega) for start in starts])
    count = _needed(u)
    windows = [of_samples(segment, start, length, omega[:count]) for start in starts]
    whole = [y is not None for y in windows]
    if sum(whole) < FEWEST_WINDOWS:
        raise RespondError(f"{segment.name}: samples are missing in all but {sum(whole)} windows")
    y = np.array([y for y in windows if y is not None])
    return _aligned(Spectra(period, orders[:count], u[whole, :count], y))


def excited(u: Complex) -> Flags:
    """Which lines the voltage excites, of the coefficients of each window."""
    size = np.abs(u.mean(axis=0))
    return np.asarray(size >= EXCITED * size.max())


def _needed(u: Complex) -> int:
    """So many harmonics: a little beyond the highest that is excited, and some of a single tone."""
    aligned = u * np.exp(-1j * np.outer(np.angle(u[:, 0]), np.arange(1, u.shape[1] + 1)))
    both = excited(u) | excited(aligned)
    highest = int(np.flatnonzero(both)[-1]) + 1
    return min(int(u.shape[1]), max(SINE, math.ceil(1.05 * highest) + 1))


def _windows(segment: Segment, period: float) -> tuple[Array, float]:
    """Where they begin and how long they are [s]: whole periods, and at most so many windows."""
    start = max(float(segment.t[0]), float(segment.began[0]))
    end = min(float(segment.t[-1]), float(segment.began[-1])) + segment.tick
    whole = int((end - start) / period * (1.0 + 1e-9))
    if whole < FEWEST_WINDOWS:
        what = (
            f"holds {whole} settled periods of {period:.4g} s; it takes {FEWEST_WINDOWS} to tell the variance"
        )
        raise RespondError(f"{segment.name}: {what}")
    length = max(1, whole // MOST_WINDOWS) * period
    starts = start + length * np.arange(float(int((end - start) / length * (1.0 + 1e-9))))
    return starts, length


def of_voltage(segment: Segment, start: float, length: float, omega: Array) -> Complex:
    """Exact coefficients of the stepwise voltage from `start` [s] over `length` [s]; shape of `omega`."""
    first = max(0, int(np.searchsorted(segment.began, start, side="right")) - 1)
    last = int(np.searchsorted(segment.began, start + length, side="left"))
    edges = np.concatenate(([start], segment.began[first + 1 : last], [start + length])) - start
    turned = np.exp(-1j * np.outer(edges, omega))
    pieces = (turned[:-1] - turned[1:]) / (1j * omega)
    return np.asarray(2.0 / length * (segment.u[first:last] @ pieces))


def of_samples(segment: Segment, start: float, length: float, omega: Array) -> Complex | None:
    """Least-squares coefficients of the samples, beside an offset and, of a position, a ramp.

    None where too many samples are missing.
    """
    first, last = np.searchsorted(segment.t, [start, start + length])
    t, y = segment.t[first:last] - start, segment.y[first:last]
    trend = 1 + (segment.output == "position")
    if len(t) < _FILLED * length / segment.tick or len(t) < 2 * len(omega) + trend:
        return None
    angle = np.outer(t, omega)
    columns = np.concatenate(
        [np.cos(angle), np.sin(angle), np.stack([np.ones_like(t), t / length - 0.5][:trend], 1)], axis=1
    )
    found = np.linalg.solve(columns.T @ columns, columns.T @ y)
    cosine, sine = found[: len(omega)], found[len(omega) : 2 * len(omega)]
    return np.asarray(cosine - 1j * sine)


def _aligned(found: Spectra) -> Spectra:
    """Where the first harmonic leads, as of a relay that runs freely, its phase is each window's origin."""
    size = np.abs(found.u).mean(axis=0)
    if found.orders[0] != 1.0 or size[0] < size.max():
        return found
    origin = np.exp(-1j * np.outer(np.angle(found.u[:, 0]), found.orders))
    return Spectra(found.period, found.orders, found.u * origin, found.y * origin)
