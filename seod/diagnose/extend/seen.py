"""What a recording tells of its excitation: amplitude, hysteresis and centre of a relay, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.record.column_checks import tells_supply

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.data import Recording

    Array = NDArray[np.float64]
    Rows = NDArray[np.intp]

_FEWEST_SWITCHES: Final = 6
"""Of a relay, so that its thresholds are told."""
_ENTRY: Final = 2
"""Switches of a relay at its beginning that may be its entry."""
_SAME_VOLTAGE: Final = 0.02
"""Difference of voltages, over all there are, up to which they are one."""
_NO_ROWS: Final = np.empty(0, np.intp)


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
    u, y = np.where(np.isfinite(recording.u), recording.u, 0.0), recording.y
    switches = _relay(u)
    low_volts, high_volts = _two_values(u, switches)
    is_relay = len(switches) > 0
    threshold, centre = 0.0, float(np.nanmean(y))
    if is_relay and not speed:
        threshold, centre = _thresholds(u, y, switches)
    elif is_relay:
        centre = float(np.nanmean(y[switches[0] : switches[-1]]))
    volts = float(np.nanmax(np.abs(u)))
    ps = recording.ps if tells_supply(recording) else None
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


def _relay(u: Array) -> Rows:
    """Rows at which a relay switches, its entry left out; none where there is no relay.

    A recording also has what was before and after: rest, the check of the polarity, other amplitudes. The
    relay is the longest segment of steps to and fro between two voltages.
    """
    same = _SAME_VOLTAGE * float(np.nanmax(u) - np.nanmin(u))
    steps = np.flatnonzero(np.abs(np.diff(u)) > same) + 1
    if len(steps) < _FEWEST_SWITCHES:
        return _NO_ROWS
    segments = np.split(u, steps)
    level = np.array([float(np.median(segment)) for segment in segments])
    flat = np.array([float(np.max(np.abs(segment - np.median(segment)))) <= same for segment in segments])
    alternates = (np.abs(level[2:] - level[:-2]) <= same) & flat[2:] & flat[1:-1] & flat[:-2]
    first, last = _longest(alternates)
    found = steps[first : last + 1][_ENTRY:] if last > first else _NO_ROWS
    return found if len(found) >= _FEWEST_SWITCHES else _NO_ROWS


def _longest(true: NDArray[np.bool_]) -> tuple[int, int]:
    """First of the longest run of these and the one after its last; (0, 0) without any."""
    edges = np.flatnonzero(np.diff(np.r_[False, true, False].astype(np.int8)))
    if not len(edges):
        return 0, 0
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * longest]), int(edges[2 * longest + 1])


def _two_values(u: Array, switches: Rows) -> tuple[float, float]:
    """A relay's voltages, the lower one first."""
    if not len(switches):
        return 0.0, 0.0
    one, other = float(np.median(u[switches[::2]])), float(np.median(u[switches[1::2]]))
    return (one, other) if one < other else (other, one)


def _thresholds(u: Array, y: Array, switches: Rows) -> tuple[float, float]:
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
