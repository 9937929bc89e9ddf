"""Command voltages that do not look at the plant: sine, sweep, multisine, steps, and those of a CSV file.

Each is a function of the times [s] and returns volts without offset, of the same shape. `random` is a seeded
generator: the same seed makes the same signal, bit for bit.
"""

from __future__ import annotations

import csv
import gzip
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.random import Generator
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

INPUT_COLUMNS = ("t", "u", "ps", "temperature")
"""Columns that are read from a file; the last two may be missing."""


def sine(t: Array, amplitude: float, frequency: float) -> Array:
    """`amplitude` [V] sin(2 pi `frequency` [Hz] t) from the first of the times `t` [s] on, shape (n,)."""
    wave: Array = amplitude * np.sin(2.0 * math.pi * frequency * (t - t[0]))
    return wave


def sweep(t: Array, amplitude: float, band: tuple[float, float], linear: bool = False) -> Array:
    """From the lower to the upper frequency of the band, once.

    Args:
        t: Times [s], shape (n,), n > 1.
        amplitude: [V]
        band: Lowest and highest frequency [Hz]; above 0 unless `linear`.
        linear: By hertz; else by octaves.

    Returns:
        Voltages [V], shape (n,).
    """
    low, high = band
    since, duration = t - t[0], t[-1] - t[0]
    if linear or low == high:
        cycles = low * since + 0.5 * (high - low) / duration * since**2
    else:
        growth = math.log(high / low) / duration
        cycles = low / growth * np.expm1(growth * since)
    wave: Array = amplitude * np.sin(2.0 * math.pi * cycles)
    return wave


def multisine(
    t: Array, amplitude: float, band: tuple[float, float], period: float, lines: int | None, random: Generator
) -> Array:
    """Sines of equal amplitude and random phase; the largest of their sum is `amplitude` [V].

    Args:
        t: Times [s], equally spaced.
        amplitude: Largest voltage within a period [V].
        band: Lowest and highest frequency [Hz].
        period: The signal repeats after this [s], rounded to whole ticks; lines are multiples of 1 / period.
        lines: So many of them, spread by equal octaves; None for all.
        random: Where the phases come from.

    Raises:
        ValueError: No line lies in the band, or some lie above half the rate of the times.
    """
    tick = float(t[-1] - t[0]) / (len(t) - 1)
    ticks = max(1, round(period / tick))
    orders = multisine_orders(band, ticks * tick, lines)
    if 2 * int(orders[-1]) >= ticks:
        raise ValueError(
            f"the band {band[0]:g}:{band[1]:g} Hz must end below half the rate, {0.5 / tick:g} Hz"
        )
    spectrum = np.zeros(ticks // 2 + 1, np.complex128)
    spectrum[orders] = np.exp(1j * random.uniform(0.0, 2.0 * math.pi, len(orders)))
    one = np.fft.irfft(spectrum, ticks)
    return one[np.arange(len(t)) % ticks] * (amplitude / float(np.max(np.abs(one))))


def multisine_orders(band: tuple[float, float], period: float, lines: int | None = None) -> NDArray[np.int64]:
    """Whole multiples of 1 / period [1/s] that lie in the band [Hz], thinned to about `lines`.

    Raises:
        ValueError: There is none.
    """
    first, last = math.ceil(band[0] * period - 1e-9), math.floor(band[1] * period + 1e-9)
    first = max(first, 1)
    if last < first:
        raise ValueError(
            f"no multiple of 1 / period = {1.0 / period:g} Hz lies in the band {band[0]:g}:{band[1]:g} Hz; "
            "a longer period has more lines"
        )
    if lines is None:
        return np.arange(first, last + 1)
    return np.unique(np.rint(np.geomspace(first, last, lines)).astype(np.int64))


def steps(t: Array, amplitude: float, frequency: float, random: Generator) -> Array:
    """Steps to random voltages, each followed by its mirror image so that the position comes back.

    Args:
        t: Times [s].
        amplitude: Largest voltage [V]; the levels lie evenly between it and its negative.
        frequency: Mean number of such pairs each second [Hz]; they last 0.5 to 1.5 of its inverse.
        random: Where levels and lengths come from.
    """
    since, end = t - t[0], float(t[-1] - t[0])
    edges, levels = [0.0], []
    while edges[-1] <= end:
        level, half = random.uniform(-amplitude, amplitude), random.uniform(0.25, 0.75) / frequency
        edges += [edges[-1] + half, edges[-1] + 2.0 * half]
        levels += [level, -level]
    course: Array = np.asarray(levels)[np.searchsorted(edges, since, side="right") - 1]
    return course


@dataclass(frozen=True, slots=True)
class GivenInput:
    """A command from a file; arrays of one length.

    Attributes:
        t: Times [s], ascending.
        u: Command [V].
        ps: Supply pressure [Pa]; None where the file has no such column.
        temperature: [K]; likewise.
    """

    t: Array
    u: Array
    ps: Array | None = None
    temperature: Array | None = None


def read_input(path: Path) -> GivenInput:
    """Read a command from a CSV file (plain or gzip) with a header that names `t` and `u`.

    Raises:
        ValueError: It is no such file; line and column are named.
        OSError: It cannot be read.
    """
    opened = gzip.open if path.name.endswith(".gz") else open
    try:
        with opened(path, "rt", newline="", encoding="utf-8-sig") as file:
            columns = _columns(str(path), csv.reader(file))
    except (UnicodeDecodeError, gzip.BadGzipFile, EOFError, csv.Error) as error:
        raise ValueError(f"{path}: no CSV file: {error}") from error
    t = columns["t"]
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if len(back):
        raise ValueError(f"{path}: t must ascend, and does not after t = {t[back[0]]:g}")
    if len(t) < 2:
        raise ValueError(f"{path}: has {len(t)} rows; a recording needs two or more")
    return GivenInput(t, columns["u"], columns.get("ps"), columns.get("temperature"))


def _columns(name: str, lines: Iterable[Sequence[str]]) -> dict[str, Array]:
    rows = iter(lines)
    header = [cell.strip() for cell in next(rows, [])]
    missing = [wanted for wanted in INPUT_COLUMNS[:2] if wanted not in header]
    if missing:
        there = ", ".join(header) or "nothing"
        raise ValueError(f"{name}:1: no column {', '.join(missing)}; the header has {there}")
    places = {wanted: header.index(wanted) for wanted in INPUT_COLUMNS if wanted in header}
    values: dict[str, list[float]] = {wanted: [] for wanted in places}
    for number, row in enumerate(rows, 2):
        for wanted, place in places.items():
            values[wanted].append(_number(f"{name}:{number}: {wanted}", row, place))
    return {wanted: np.asarray(column) for wanted, column in values.items()}


def _number(where: str, row: Sequence[str], place: int) -> float:
    cell = row[place].strip() if place < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{where}: {cell!r} is no number")
    return value
