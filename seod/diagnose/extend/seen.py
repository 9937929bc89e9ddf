"""What a recording tells of its excitation: amplitude, hysteresis and centre of a relay, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.data import Recording

    Array = NDArray[np.float64]

_FEWEST_SWITCHES: Final = 6
"""Of a relay, so that its thresholds are told."""
_SETTLED: Final = 0.25
"""Part of a recording at its beginning that may be a relay's entry."""
_TWO_VALUES: Final = 0.98
"""Part of the rest that a relay spends at its two voltages."""


@dataclass(frozen=True, slots=True)
class Seen:
    """How a recording was excited.

    Attributes:
        rate_hz: Of the samples.
        unit: Of y; "" where it is not known.
        relay: Whether u has two values that y switches.
        e_a: Amplitude [V]; of anything but a relay half of its largest voltage.
        bias: Mean of the relay's two voltages [V]; else 0.
        hysteresis: Half-width [unit of y; of its integral for a speed].
        centre: What the relay switches about, else the mean [unit of y].
        low, high: Range of y.
        most_volts: Largest |u| [V].
        supply_pressure: Median [Pa], or None.
    """

    rate_hz: float
    unit: str
    relay: bool
    e_a: float
    bias: float
    hysteresis: float
    centre: float
    low: float
    high: float
    most_volts: float
    supply_pressure: float | None


def seen(recording: Recording, speed: bool) -> Seen:
    """Look at a recording; `speed` says that y is one."""
    u, y = recording.u, recording.y
    low_volts, high_volts = _two_values(u)
    switches = np.empty(0, np.intp) if high_volts == low_volts else _switches(u, low_volts, high_volts)
    is_relay = len(switches) >= _FEWEST_SWITCHES
    threshold, centre = 0.0, float(np.nanmean(y))
    if is_relay and not speed:
        threshold, centre = _thresholds(u, y, switches)
    volts = float(np.nanmax(np.abs(u)))
    ps = recording.ps
    return Seen(
        rate_hz=recording.rate_hz,
        unit=recording.units.get("y", ""),
        relay=is_relay,
        e_a=0.5 * (high_volts - low_volts) if is_relay else 0.5 * volts,
        bias=0.5 * (high_volts + low_volts) if is_relay else 0.0,
        hysteresis=threshold,
        centre=centre,
        low=float(np.nanmin(y)),
        high=float(np.nanmax(y)),
        most_volts=volts,
        supply_pressure=None if ps is None else float(np.nanmedian(ps)),
    )


def _two_values(u: Array) -> tuple[float, float]:
    """A relay's voltages, the lower one first; equal where it is none."""
    settled = u[int(_SETTLED * len(u)) :]
    settled = settled[np.isfinite(settled)]
    if not len(settled):
        return 0.0, 0.0
    middle = 0.5 * (settled.min() + settled.max())
    above, below = settled[settled > middle], settled[settled <= middle]
    if not len(above):
        return 0.0, 0.0
    low, high = float(np.median(below)), float(np.median(above))
    near = np.minimum(np.abs(settled - low), np.abs(settled - high)) < 0.01 * (high - low)
    return (low, high) if np.mean(near) > _TWO_VALUES else (0.0, 0.0)


def _switches(u: Array, low: float, high: float) -> NDArray[np.intp]:
    """Rows that switch, the entry left out."""
    up = u > 0.5 * (low + high)
    rows = np.flatnonzero(up[1:] != up[:-1]) + 1
    return np.asarray(rows[rows > _SETTLED * len(u)])


def _thresholds(u: Array, y: Array, switches: NDArray[np.intp]) -> tuple[float, float]:
    """Half-width of the hysteresis and its centre.

    The relay saw what was recorded, noise included: its threshold lies between the farthest sample that did
    not switch it and the nearest one that did.
    """
    rows = switches[(switches > 0) & np.isfinite(y[switches]) & np.isfinite(y[switches - 1])]
    down = u[rows] < u[rows - 1]
    if not down.any() or down.all():
        return 0.0, float(np.nanmean(y))
    upper = 0.5 * (y[rows[down]].min() + y[rows[down] - 1].max())
    lower = 0.5 * (y[rows[~down]].max() + y[rows[~down] - 1].min())
    return max(0.0, 0.5 * float(upper - lower)), 0.5 * float(upper + lower)
