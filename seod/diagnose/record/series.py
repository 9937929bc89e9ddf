"""A recording as the simulation takes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.record.coarse_sensor import Readings, readings
from seod.diagnose.record.noise import noise_sd
from seod.diagnose.record.relay import relayed
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.result import DiagnoseError
from seod.diagnose.tuning.record import SERIES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.data import Recording
    from seod.diagnose.result import Array, Hold, Mask, Rows


@dataclass(frozen=True)
class Series:
    """A recording as the simulation takes it; arrays of shape (n,).

    Attributes:
        t: Times of samples [s].
        y: Samples, 0 where there is none to believe.
        good: Where there is one.
        t_u: When commands left [s].
        u: Commands [V].
        supply: Supply pressure over nominal; shape (0,) where nobody tells it.
        warmth: Temperature above nominal [K], likewise.
        force: Mean of what is measured of a disturbance on the way to each sample, less `nominal_f`; shape
            (0,) where there is no such channel.
        noise: Standard deviation of the samples' noise.
        window_s: Length of its windows [s].
        period_s: Dominant period [s].
        sees_speed: `y` is a speed.
        step: Of a coarse sensor [unit of y], 0 where none is seen.
        slack: Error that says nothing: half such a step, see `coarse`.
        level: Root mean square of what noise leaves beyond it, at least.
        allowed: At most.
        tick: Median interval of its samples [s].
        levels: How many different commands it has.
        blocks: (first row, row after the last) of the parts that windows are cut from.
        relayed: A relay gave the commands.
        other_drive: Times [s] and volts that the valve is given where commands are not simulated as recorded,
            such as what runs straight on between them; None: they are.
        held: Most rows repeat a reading, and are not `good`.
        timed: It is told when commands were given: by a column, or by the user.
        lead: By how many rows earlier than held from where they are recorded, on average, they are given.
        late: Mean squared error of samples that were taken at other times than told [unit^2 of y].
    """

    t: Array
    y: Array
    good: Mask
    t_u: Array
    u: Array
    supply: Array
    warmth: Array
    force: Array
    noise: float
    window_s: float
    period_s: float
    sees_speed: bool
    step: float
    slack: float
    level: float
    allowed: float
    tick: float
    levels: int
    blocks: tuple[tuple[int, int], ...]
    relayed: bool = False
    other_drive: tuple[Array, Array] | None = None
    held: bool = False
    timed: bool = False
    lead: float = 0.0
    late: float = 0.0

    @property
    def errs_as_it_moves(self) -> bool:
        """Whether the sensor alone errs more where the load moves: by its steps, or by when it is read."""
        return self.step > 0.0 or self.late > 0.0

    @property
    def as_recorded(self) -> bool:
        """Whether commands are simulated as they are recorded: each from its row to the next."""
        return self.other_drive is None

    @property
    def drive(self) -> tuple[Array, Array]:
        """Commands as they are simulated: times [s] and volts, of shape (m,) each."""
        return self.other_drive or (self.t_u, self.u)

    @property
    def runs_on(self) -> bool:
        """Whether commands are simulated to run on between their rows."""
        return len(self.drive[0]) > len(self.t_u)

    @cached_property
    def segment_s(self) -> float:
        """Longest segment of a window to fit [s]. A sweep has no period of its own."""
        periods = 1.0 if sweeps(self.t, self.u_of_rows) else SERIES.segment_periods
        return max(SERIES.segment_s, periods * self.period_s)

    @cached_property
    def travelled(self) -> Array:
        """Positions by the integral of a speed, from 0, shape (n,). Not to be written to."""
        y = np.interp(self.t, self.t[self.good], self.y[self.good])
        place = _integral(self.t, y)
        place.flags.writeable = False
        return place

    @cached_property
    def u_of_rows(self) -> Array:
        """The command of each sample, shape (n,), also where only those are kept that change something."""
        return _of_rows(self.t, self.t_u, self.u)

    @property
    def reading_s(self) -> float:
        """Median interval of readings [s]: of a sensor that repeats them, of new ones."""
        return float(np.median(np.diff(self.t[self.good]))) if self.held else self.tick

    def sparser(self, stride: int) -> Series:
        """Every so manieth sample, and the commands that change something."""
        changes = np.flatnonzero(np.diff(self.u, prepend=np.nan) != 0.0)
        kept = self.kept(stride)
        rows = {name: getattr(self, name) for name in ("t", "y", "good", "supply", "warmth")}
        rows = {name: each[kept] if len(each) else each for name, each in rows.items()}
        rows["force"] = _means(self.force, kept)
        blocks = tuple((int(a), int(b)) for a, b in np.searchsorted(kept, self.blocks))
        tick = float(np.median(np.diff(rows["t"])))
        return replace(self, **rows, t_u=self.t_u[changes], u=self.u[changes], tick=tick, blocks=blocks)

    def kept(self, stride: int) -> Rows:
        """Every so manieth row; of a sensor that repeats its readings, of those with a new one."""
        if not self.held or stride == 1:
            return np.arange(0, len(self.t), stride)
        return np.flatnonzero(self.good)[::stride]

    def searched_in(self, begins: Sequence[int], size: int) -> Series:
        """The same, windows cut from blocks of so many rows that begin there."""
        return replace(self, blocks=tuple((begin, begin + size) for begin in begins))


def series(
    recording: Recording,
    bad: Mask | None = None,
    *,
    sees_speed: bool = False,
    step: float = 0.0,
    late: float = 0.0,
    nominal_ps: float | None = None,
    nominal_temperature: float | None = None,
    nominal_f: float | None = None,
    taken: Array | None = None,
    hold: Hold | None = None,
) -> Series:
    """A recording prepared.

    Args:
        recording: Columns of shape (n,).
        bad: Rows that do not count, shape (n,); None: all do.
        sees_speed: `y` is a speed.
        step: Of a coarse sensor [unit of y]; 0: it is not.
        late: Mean squared error of samples that were taken at other times than told [unit^2 of y].
        nominal_ps: Supply pressure that counts as 1 [that of the column]; None: its median.
        nominal_temperature: Temperature that counts as 0 [K or deg C, as the column]; None: its mean.
        nominal_f: Disturbance that counts as 0 [that of the column]; None: its mean.
        taken: When a sensor that repeats its readings took them [s], shape (n,); None: it does not.
        hold: Whether a command holds until the next or runs straight on to it; None: it holds, but nobody
            tells.

    Raises:
        DiagnoseError: It has no command, too few samples, or one that never changes.
    """
    u, good = _held(recording.u), np.isfinite(recording.y)
    _check(str(recording.paths[0]), u, recording.y[good])
    _check_pauses(str(recording.paths[0]), recording.t)
    if bad is not None:
        good &= ~bad
    t, y = recording.t, np.where(good, recording.y, 0.0)
    t = np.ascontiguousarray(t)
    t_u = t if recording.t_u is None else np.where(np.isfinite(recording.t_u), recording.t_u, t)
    if taken is not None:
        t = taken
    t_u = np.maximum.accumulate(t_u)
    drifts = not sees_speed and len(t) > SERIES.drifting_rows
    noise = _noise(t, y, good, taken is not None)
    period_s = 1.0 / dominant_hz(t, y, good, noise if drifts else None)
    read = _readings(y, good, noise, step, late, held=taken is not None)
    supply, warmth, force = _channels(recording, nominal_ps, nominal_temperature, nominal_f)
    return Series(
        t=t,
        y=read.y,
        good=good,
        t_u=t_u,
        u=u,
        supply=supply,
        warmth=warmth,
        force=force,
        noise=read.noise,
        window_s=_window_s(t, period_s),
        period_s=period_s,
        sees_speed=sees_speed,
        step=step,
        slack=read.slack,
        level=read.level,
        allowed=read.allowed,
        tick=float(np.median(np.diff(t))),
        levels=len(np.unique(u)),
        relayed=_relayed(t, t_u, u, read.y, good, sees_speed),
        blocks=((0, len(t)),),
        other_drive=straight_on(t_u, u) if hold == "first" else None,
        held=taken is not None,
        timed=hold is not None or (recording.t_u is not None and not np.array_equal(t_u, recording.t)),
        late=late,
    )


def _of_rows(t: Array, t_u: Array, u: Array) -> Array:
    """The command of each row, shape (n,)."""
    return u if len(u) == len(t) else u[np.maximum(np.searchsorted(t_u, t, "right") - 1, 0)]


def _integral(t: Array, y: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t))])


def _relayed(t: Array, t_u: Array, u: Array, y: Array, good: Mask, sees_speed: bool) -> bool:
    """Whether a relay gave the commands, by the position."""
    y = np.interp(t, t[good], y[good])
    return relayed(_of_rows(t, t_u, u), _integral(t, y) if sees_speed else y)


def _check(name: str, u: Array, y: Array) -> None:
    """Commands and samples must be there, and change."""
    if not np.isfinite(u).any():
        raise DiagnoseError(f"{name}: has no command u: name its column by --columns u=...")
    if len(y) < SERIES.least_samples:
        raise DiagnoseError(f"{name}: has {len(y)} samples of y; a diagnosis needs {SERIES.least_samples}")
    for what, values in (("command u", u), ("signal y", y)):
        if np.ptp(values) == 0.0:
            raise DiagnoseError(f"{name}: the {what} never changes: it tells nothing of the plant")


def _check_pauses(name: str, t: Array) -> None:
    """A simulation goes through all pauses."""
    usual, length = float(np.median(np.diff(t))), float(t[-1] - t[0])
    if length > SERIES.most_paused * usual * len(t):
        raise DiagnoseError(
            f"{name}: is {length:.3g} s long and has {len(t)} rows, {usual:.3g} s apart but for pauses: "
            f"nobody tells what moved. A diagnosis needs {SERIES.least_samples} rows without a pause"
        )


def straight_on(t_u: Array, u: Array) -> tuple[Array, Array]:
    """Commands that run straight on to the next, as short steps of their own mean: times [s] and volts."""
    parts = np.arange(SERIES.steps_between) / SERIES.steps_between
    wide, high = np.append(np.diff(t_u), 0.0), np.append(np.diff(u), 0.0)
    times = (t_u[:, None] + wide[:, None] * parts).ravel()
    volts = (u[:, None] + high[:, None] * (parts + 0.5 / SERIES.steps_between)).ravel()
    return times, volts


def _readings(y: Array, good: Mask, noise: float, step: float, late: float, *, held: bool) -> Readings:
    """Samples, and how far their errors count; `noise` is what differences show, nan where nothing."""
    least = max(SERIES.least_noise * float(np.std(y[good])), math.sqrt(late))
    noise = max(noise, least) if math.isfinite(noise) else least
    return readings(y, good, step, noise, held=held) if step > 0.0 else Readings(y, 0.0, noise, noise, noise)


def _channels(
    recording: Recording, nominal_ps: float | None, nominal_temperature: float | None, nominal_f: float | None
) -> tuple[Array, Array, Array]:
    """Supply, warmth and force; shape (0,) each where there is no such channel."""
    return (
        _relative(recording.ps, nominal_ps),
        _above(recording.temperature, nominal_temperature),
        _on_the_way(_above(recording.f, nominal_f)),
    )


def _noise(t: Array, y: Array, good: Mask, held: bool) -> float:
    """Of the samples; of a sensor that repeats its readings, of one after the other."""
    if held:
        t, y, good = t[good], y[good], good[good]
    return noise_sd(t, y, good)


def _held(x: Array) -> Array:
    """Each missing value as the one before it; before the first the first."""
    known = np.flatnonzero(np.isfinite(x))
    if not len(known):
        return x
    return np.asarray(x[known[np.maximum(np.searchsorted(known, np.arange(len(x)), "right") - 1, 0)]])


def _relative(ps: Array | None, nominal: float | None) -> Array:
    if ps is None:
        return np.empty(0)
    return np.maximum(_held(ps) / (nominal or float(np.nanmedian(ps))), SERIES.least_supply)


def _above(values: Array | None, nominal: float | None) -> Array:
    if values is None:
        return np.empty(0)
    return _held(values) - (float(np.nanmean(values)) if nominal is None else nominal)


def _on_the_way(values: Array) -> Array:
    """Mean of a channel from each sample to the next, at the latter."""
    return values if not len(values) else 0.5 * (values + np.r_[values[0], values[:-1]])


def _means(values: Array, kept: Rows) -> Array:
    """Mean of the rows up to each one that is kept, from the one before."""
    if not len(values):
        return values
    total = np.r_[0.0, np.cumsum(values)]
    first = np.r_[0, kept[:-1] + 1]
    means: Array = (total[kept + 1] - total[first]) / (kept + 1 - first)
    return means


def _window_s(t: Array, period_s: float) -> float:
    """Ten dominant periods, at least a second; less where the recording has not four of them."""
    span = float(t[-1] - t[0])
    return min(max(SERIES.shortest_window_s, SERIES.window_periods * period_s), span / SERIES.fewest_windows)


def dominant_hz(t: Array, y: Array, good: Mask, drifts_beside: float | None = None) -> float:
    """Frequency at which the detrended `y` has its largest line [Hz].

    Of a position that drifts, beside this noise [unit], its speed has: the longer it is recorded, the slower
    is what moves it farthest. Lines that may be the noise's do not count: the highest would be the fastest.
    """
    count = min(len(t), SERIES.most_spectrum_rows)
    even = np.linspace(t[0], t[-1], count)
    signal = np.interp(even, t[good], y[good])
    line = np.polynomial.Polynomial.fit(even, signal, 1)
    taper = np.hanning(count)
    spectrum = np.abs(np.fft.rfft((signal - line(even)) * taper))
    if drifts_beside is not None and math.isfinite(drifts_beside):
        lines = spectrum > SERIES.line_above_noise * drifts_beside * math.sqrt(float(taper @ taper))
        spectrum *= np.arange(len(spectrum)) * lines if lines[1:].any() else 1.0
    peak = 1 + int(np.argmax(spectrum[1:]))
    return peak / float(t[-1] - t[0])
