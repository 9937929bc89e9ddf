"""Measurement and simulation as a picture: all of it, where it is simulated worst, and one period."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from seod.estimate.advice import INTERVAL
from seod.identify.record import IdentifyError
from seod.plots.style import BEFORE, new_figure, style
from seod.terminal.text import number, with_sd

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.figure import Figure

    from seod.estimate.arrays import Array
    from seod.identify.answer import Result
    from seod.identify.fit import Fit
    from seod.identify.record import Record

VALUES: Final = {"omega_n": (1.0, "rad/s"), "zeta": (1.0, ""), "delay": (1000.0, "ms"), "K_L": (1.0, "")}
"""Factor and unit of each value; that of K_L depends on y."""
DRAWN: Final = 20_000
"""Most samples of a line: more are not seen."""
CLOSE: Final = 8.0
"""Periods of the close view on the worst place: its neighbours are in it, each period is still seen."""
NEARER: Final = 1.25
"""Rows of a part over those of a view, from which on the view is looked for within it."""
LEAST: Final = 40
"""Samples of a close view, at least: fewer show no course."""


def draw(records: Sequence[Record], units: Sequence[str], result: Result, gain_unit: str) -> Figure:
    """Draw each recording.

    Args:
        records: As they were fitted.
        units: Of each one's y.
        result: With a fit.
        gain_unit: Of K_L.

    Raises:
        IdentifyError: There is no plant to draw.
    """
    if result.fit is None:
        raise IdentifyError(f"nothing to draw: {result.message}")
    with style():
        figure = new_figure(11.0, 0.8 + 6.4 * len(records))
        figure.suptitle(f"{_numbers(result.fit, gain_unit)}\nquality: {result.quality}")
        parts = figure.subfigures(len(records), 1, squeeze=False)[:, 0]
        for part, record, unit, left in zip(parts, records, units, result.fit.residual, strict=True):
            _draw(part, record, unit, left)
    return figure


def _numbers(fit: Fit, gain_unit: str) -> str:
    told = []
    for name, (factor, own) in VALUES.items():
        wide = INTERVAL * fit.sd[name] * factor
        value = with_sd(fit.value[name] * factor, wide if np.isfinite(wide) else None)
        told.append(f"{name} {value} {gain_unit if name == 'K_L' else own}".rstrip())
    return ", ".join(told) + f" (95 %); error {100.0 * fit.nrmse:.2f} %"


class Look(NamedTuple):
    """Rows of a recording that a view shows, and its title."""

    rows: slice
    title: str


def _draw(part: Any, record: Record, unit: str, left: Array) -> None:
    """Whole recording and residual over the full width, and two close views below."""
    places = part.subplot_mosaic(
        [["whole", "whole"], ["residual", "residual"], ["worst", "period"]], height_ratios=[1.2, 0.8, 1.2]
    )
    part.suptitle(record.name)
    rms = number(_rms(left), 3)
    whole = Look(slice(None), "")
    _lines(places["whole"], record, unit, left, whole)
    _residual(places["residual"], record, unit, left, rms)
    for name, look in zip(("worst", "period"), close_views(record, left), strict=True):
        _lines(places[name], record, unit, left, look)
        places["whole"].axvspan(*record.t[look.rows][[0, -1]], color="0.5", alpha=0.15, linewidth=0, zorder=0)
    places["whole"].legend(loc="upper right")


def _lines(axes: Any, record: Record, unit: str, left: Array, look: Look) -> None:
    t, y, simulated = (each[look.rows] for each in (record.t, record.y, record.y - left))
    every = slice(None, None, 1 + len(t) // DRAWN)
    is_close = len(t) < len(record.t)
    axes.plot(t[every], y[every], "." if is_close else "-", markersize=3, linewidth=0.8, label="measured")
    axes.plot(t[every], simulated[every], "-" if is_close else "--", linewidth=0.9, label="simulated")
    axes.set_title(look.title)
    axes.set_ylabel(f"y [{unit}]")
    axes.set_xlabel("t [s]")


def _residual(axes: Any, record: Record, unit: str, left: Array, rms: str) -> None:
    every = slice(None, None, 1 + len(left) // DRAWN)
    axes.plot(record.t[every], left[every], linewidth=0.6, color=BEFORE)
    axes.set_title(f"measured - simulated: rms {rms} {unit}")
    axes.set_ylabel(f"residual [{unit}]")


def close_views(record: Record, left: Array) -> tuple[Look, Look]:
    """Where the simulation errs most, over some periods, and one period whose error is the usual one."""
    worst, usual = _closer(record, left, CLOSE, np.argmax), _closer(record, left, 1.0, _median_place)
    length = number(1000.0 * float(np.ptp(record.t[usual])), 3)
    return (
        Look(worst, f"where the simulation errs most: rms {number(_rms(left[worst]), 3)}"),
        Look(usual, f"one period, {length} ms, with the usual error: rms {number(_rms(left[usual]), 3)}"),
    )


def _closer(record: Record, left: Array, periods: float, choose: Callable[[Array], int]) -> slice:
    """Rows of so many periods: in a sweep the period is another one nearer by."""
    inside = slice(0, len(left))
    while True:
        rows = max(round(periods * period_s(record.t[inside], record.y[inside]) / record.tick), LEAST)
        if inside.stop - inside.start < NEARER * rows:
            return inside
        begins = np.linspace(inside.start, inside.stop - rows, 1 + (inside.stop - inside.start) // rows)
        parts = [slice(begin, begin + rows) for begin in begins.astype(int).tolist()]
        inside = parts[choose(np.array([_rms(left[part]) for part in parts]))]


def _median_place(errors: Array) -> int:
    return int(np.argsort(errors)[len(errors) // 2])


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def period_s(t: Array, y: Array) -> float:
    """Period of the largest line in the spectrum of the detrended y [s]."""
    even = np.linspace(t[0], t[-1], len(t))
    signal = np.interp(even, t, y)
    line = np.polynomial.Polynomial.fit(even, signal, 1)
    spectrum = np.abs(np.fft.rfft((signal - line(even)) * np.hanning(len(even))))
    return float(t[-1] - t[0]) / (1 + int(np.argmax(spectrum[1:])))
