"""Recordings cut into windows: some to fit, as many that no fit sees."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from seod.diagnose.answer import DiagnoseError
from seod.diagnose.coarse import readings
from seod.diagnose.noise import noise_sd

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.data import Recording
    from seod.diagnose.answer import Array, Mask

Rows = NDArray[np.int64]

PERIODS: Final = 10
SHORTEST_S: Final = 1.0
"""A window is that many dominant periods, but at least this long."""
FEWEST: Final = 4
"""Windows of a recording: two to fit, two held out."""
START: Final = 0.2
"""Part of a held-out window to which its initial state is fitted."""
PIECE_S: Final = 2.0
"""Windows are fitted in pieces no longer than this or a period, each from a state of its own."""
SKIPPED_S: Final = 0.1
"""Of a recording's start: the commands before it, which delay and lag still show, are unknown."""
MOVING: Final = 3.0
"""Deviation over the noise from which on a window shows a movement; the others tell nothing of the plant."""
LEVELS: Final = 4
"""Commands that a relay gives, at most: two, with another bias four."""
ENOUGH: Final = 50
"""Samples of a limit cycle by which it is tried what it may come from."""
_LEAST_SAMPLES: Final = 200
_MOSTLY: Final = 0.9
"""Part of the samples that others have to tell."""
_BETWEEN: Final = 3.0
"""Error with which they do, over the noise: both have some."""
_FINEST: Final = 1 << 15


@dataclass(frozen=True, slots=True)
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
        noise: Standard deviation of the samples' noise.
        window_s: Length of its windows [s].
        period_s: Dominant period [s].
        sees_speed: `y` is a speed.
        step: Of a coarse sensor [unit of y], 0 where none is seen.
        slack: Error that says nothing: half such a step, see `coarse`.
        level: Root mean square of what noise leaves beyond it, at least.
        allowed: At most.
    """

    t: Array
    y: Array
    good: Mask
    t_u: Array
    u: Array
    supply: Array
    warmth: Array
    noise: float
    window_s: float
    period_s: float
    sees_speed: bool
    step: float
    slack: float
    level: float
    allowed: float

    @property
    def tick(self) -> float:
        """Median interval [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def relayed(self) -> bool:
        """Whether a relay gave the commands."""
        return len(np.unique(self.u)) <= LEVELS

    def sparser(self, stride: int) -> Series:
        """Every so manieth sample, and the commands that change something."""
        told = np.flatnonzero(np.diff(self.u, prepend=np.nan) != 0.0)
        rows = {name: getattr(self, name)[::stride] for name in ("t", "y", "good", "supply", "warmth")}
        return replace(self, **rows, t_u=self.t_u[told], u=self.u[told])


def series(
    recording: Recording,
    bad: Mask | None = None,
    *,
    sees_speed: bool = False,
    step: float = 0.0,
    late: float = 0.0,
    nominal_ps: float | None = None,
    nominal_temperature: float | None = None,
) -> Series:
    """A recording prepared; rows that are `bad` do not count.

    `step` is a coarse sensor's, `late` the mean squared error of samples taken at other times than told.

    Raises:
        DiagnoseError: It has no command, too few samples, or one that never changes.
    """
    name = recording.paths[0]
    u, good = _held(recording.u), np.isfinite(recording.y)
    if not np.isfinite(u).any():
        raise DiagnoseError(f"{name}: has no command u: name its column by --columns u=...")
    if np.count_nonzero(good) < _LEAST_SAMPLES:
        message = f"has {np.count_nonzero(good)} samples of y; a diagnosis needs {_LEAST_SAMPLES}"
        raise DiagnoseError(f"{name}: {message}")
    for what, values in (("command u", u), ("signal y", recording.y[good])):
        if np.ptp(values) == 0.0:
            raise DiagnoseError(f"{name}: the {what} never changes: it tells nothing of the plant")
    if bad is not None:
        good &= ~bad
    t, y = recording.t, np.where(good, recording.y, 0.0)
    t_u = t if recording.t_u is None else np.where(np.isfinite(recording.t_u), recording.t_u, t)
    noise, period_s = noise_sd(t, y, good), 1.0 / dominant_hz(t, y, good)
    least = max(1e-9 * float(np.std(y[good])), math.sqrt(late))
    noise = max(noise, least) if math.isfinite(noise) else least
    slack, level, allowed = 0.0, noise, noise
    if step > 0.0:
        y, slack, level, allowed, noise = readings(y, good, step, noise)
    return Series(
        t=np.ascontiguousarray(t),
        y=y,
        good=good,
        t_u=np.maximum.accumulate(t_u),
        u=u,
        supply=_relative(recording.ps, nominal_ps),
        warmth=_above(recording.temperature, nominal_temperature),
        noise=noise,
        window_s=_window_s(t, period_s),
        period_s=period_s,
        sees_speed=sees_speed,
        step=step,
        slack=slack,
        level=level,
        allowed=allowed,
    )


def _held(x: Array) -> Array:
    """Each missing value as the one before it; before the first the first."""
    known = np.flatnonzero(np.isfinite(x))
    if not len(known):
        return x
    return np.asarray(x[known[np.maximum(np.searchsorted(known, np.arange(len(x)), "right") - 1, 0)]])


def _relative(ps: Array | None, nominal: float | None) -> Array:
    if ps is None:
        return np.empty(0)
    return np.maximum(_held(ps) / (nominal or float(np.nanmedian(ps))), 0.01)


def _above(temperature: Array | None, nominal: float | None) -> Array:
    if temperature is None:
        return np.empty(0)
    return _held(temperature) - (float(np.nanmean(temperature)) if nominal is None else nominal)


def _window_s(t: Array, period_s: float) -> float:
    """Ten dominant periods, at least a second; less where the recording has not four of them."""
    span = float(t[-1] - t[0])
    return min(max(SHORTEST_S, PERIODS * period_s), span / FEWEST)


def dominant_hz(t: Array, y: Array, good: Mask) -> float:
    """Frequency at which the detrended `y` has its largest line [Hz]."""
    count = min(len(t), 8 * _FINEST)
    even = np.linspace(t[0], t[-1], count)
    signal = np.interp(even, t[good], y[good])
    line = np.polynomial.Polynomial.fit(even, signal, 1)
    signal = (signal - line(even)) * np.hanning(count)
    spectrum = np.abs(np.fft.rfft(signal))
    peak = 1 + int(np.argmax(spectrum[1:]))
    return peak / float(t[-1] - t[0])


@dataclass(frozen=True, slots=True)
class Cut:
    """Windows of several series, end to end.

    Attributes:
        series: Their recordings.
        windows: (series, first row, row after the last) of each, ascending within a series.
    """

    series: Sequence[Series]
    windows: tuple[tuple[int, int, int], ...]

    @property
    def sizes(self) -> Rows:
        """Rows of each window, shape (w,)."""
        return np.array([last - first for _, first, last in self.windows], np.int64)

    @property
    def slices(self) -> list[slice]:
        """Where each window stands in what is end to end."""
        ends = np.cumsum(self.sizes)
        return [slice(int(end - size), int(end)) for end, size in zip(ends, self.sizes, strict=True)]

    def gathered(self, name: str) -> Array:
        """An array of the series, windows end to end."""
        pieces = [getattr(self.series[k], name)[first:last] for k, first, last in self.windows]
        return np.concatenate(pieces)

    @property
    def good(self) -> Mask:
        """Rows that count, end to end."""
        return self.gathered("good").astype(np.bool_)

    @property
    def noise(self) -> Array:
        """Root mean square of the noise in each window, as far as errors count, shape (w,)."""
        return np.array([self.series[k].level for k, _, _ in self.windows])

    @property
    def allowed(self) -> Array:
        """The same, with as much noise as there may be."""
        return np.array([self.series[k].allowed for k, _, _ in self.windows])

    @property
    def floor(self) -> Array:
        """Standard deviation of the samples in each window about a perfect simulation, shape (w,)."""
        return np.array([self.series[k].noise for k, _, _ in self.windows])

    @property
    def slack(self) -> Array:
        """Error of each row that says nothing, end to end."""
        return np.repeat([self.series[k].slack for k, _, _ in self.windows], self.sizes)

    def started(self, part: float = START) -> Mask:
        """Rows in the first part of their window, end to end."""
        pieces = []
        for k, first, last in self.windows:
            t = self.series[k].t[first:last]
            pieces.append(t - t[0] < part * (t[-1] - t[0]))
        return np.concatenate(pieces)

    def only(self, chosen: Iterable[int]) -> Cut:
        """Some of the windows."""
        return Cut(self.series, tuple(self.windows[k] for k in chosen))


def cut(every: Sequence[Series], aside: int = 0, finer: float = 1.0) -> tuple[Cut, Cut]:
    """Windows to fit, and windows held out: every second one, and all of the last `aside` series.

    There are `finer` times as many as usual.
    """
    fitted: list[tuple[int, int, int]] = []
    held: list[tuple[int, int, int]] = []
    for k, one in enumerate(every):
        whole = k >= len(every) - aside
        for number, (first, last) in enumerate(_windows(one, finer)):
            (held if whole or number % 2 else fitted).append((k, first, last))
    if not fitted or not held:
        raise DiagnoseError("the recordings are too short: a diagnosis needs four windows of 50 samples")
    return Cut(every, tuple(fitted)), Cut(every, tuple(held))


def _windows(one: Series, finer: float) -> list[tuple[int, int]]:
    span = float(one.t[-1] - one.t[0])
    begin = one.t[0] + min(SKIPPED_S, 0.05 * span)
    count = round(finer * max(FEWEST, int((one.t[-1] - begin) / one.window_s + 1e-6)))
    edges = np.searchsorted(one.t, np.linspace(begin, one.t[-1] + 0.5 * one.tick, count + 1))
    pairs = [(int(a), int(b)) for a, b in pairwise(edges)]
    told = [(a, b) for a, b in pairs if np.count_nonzero(one.good[a:b]) >= 50]
    moving = [(a, b) for a, b in told if np.std(one.y[a:b][one.good[a:b]]) > MOVING * one.noise]
    return moving if len(moving) >= FEWEST else told


def pieces(whole: Cut, longest_s: float | None = None) -> Cut:
    """The same rows in windows no longer than that; None: than 2 s or a dominant period.

    In shorter ones the initial states make up for what is wrong with the model.
    """
    out = []
    for k, first, last in whole.windows:
        one = whole.series[k]
        length = max(PIECE_S, one.period_s) if longest_s is None else longest_s
        count = max(1, math.ceil((one.t[last - 1] - one.t[first]) / length - 0.05))
        edges = np.linspace(first, last, count + 1).astype(int).tolist()
        out += [(k, a, b) for a, b in pairwise(edges)]
    return Cut(whole.series, tuple(out))


def undivided(whole: Cut) -> Cut:
    """Each recording as one window, in which the same rows count."""
    every = list(whole.series)
    windows: list[tuple[int, int, int]] = []
    for k in sorted({k for k, _, _ in whole.windows}):
        own = [(first, last) for of, first, last in whole.windows if of == k]
        counts = np.zeros(len(every[k].t), np.bool_)
        for first, last in own:
            counts[first:last] = True
        every[k] = replace(every[k], good=every[k].good & counts)
        windows.append((k, own[0][0], own[-1][1]))
    return Cut(every, tuple(windows))


def sample(whole: Cut, seconds: float) -> Cut:
    """Windows of about so many seconds together, spread evenly."""
    lengths = np.array([float(whole.series[k].t[b - 1] - whole.series[k].t[a]) for k, a, b in whole.windows])
    count = max(2, round(seconds / float(np.mean(lengths))))
    if count >= len(whole.windows):
        return whole
    return whole.only(np.unique(np.linspace(0, len(whole.windows) - 1, count).round().astype(int)).tolist())


def sparse(whole: Cut) -> Cut:
    """Of a relay's recordings, whose commands hold for long, no more samples than trials need.

    Without their first windows: how a limit cycle grows tells much of a plant that is nearly right, and leads
    astray from any other.
    """
    strides = [_stride(one) for one in whole.series]
    every = [one.sparser(stride) for one, stride in zip(whole.series, strides, strict=True)]
    windows = tuple((k, -(-a // strides[k]), -(-b // strides[k])) for k, a, b in whole.windows)
    grown = tuple(
        (k, a, b)
        for n, (k, a, b) in enumerate(windows)
        if not every[k].relayed or (n and windows[n - 1][0] == k)
    )
    return Cut(every, grown if len(grown) > 1 else windows)


def _stride(one: Series) -> int:
    """Samples of a relay's recording of which one is enough: between them the others are as they were.

    A limit cycle is smooth; what swings after each switch of slow commands is not.
    """
    stride = max(1, int(one.period_s / (ENOUGH * one.tick))) if one.relayed else 1
    while stride > 1 and not _smooth(one, stride):
        stride //= 2
    return stride


def _smooth(one: Series, stride: int) -> bool:
    """Whether every so manieth sample tells the others, but for noise."""
    rows = np.flatnonzero(one.good)
    kept = rows[::stride]
    error = np.abs(one.y[rows] - CubicSpline(one.t[kept], one.y[kept])(one.t[rows]))
    return float(np.quantile(error, _MOSTLY)) < _BETWEEN * one.noise + one.slack
