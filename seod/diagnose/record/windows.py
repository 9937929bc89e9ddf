"""Recordings cut into windows: some to fit, as many that no fit sees."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from seod.diagnose.record.memory import has_past, unforeseen
from seod.diagnose.result import DiagnoseError
from seod.diagnose.tuning.record import SERIES, WINDOWS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, Mask, Rows


Of = TypeVar("Of", bound=np.generic)


class Run(NamedTuple):
    """Windows of one series, to be simulated: first rows, and rows after the last, of each; shape (w,).

    `own` tells which of the cut's windows they are; `reach` is the largest reading of the series [unit].
    """

    recording: Series
    own: list[int]
    first: Rows
    last: Rows
    reach: float


@dataclass(frozen=True)
class Cut:
    """Windows of several series, end to end. What is asked of it again and again is worked out once.

    Attributes:
        series: Their recordings.
        windows: (series, first row, row after the last) of each, ascending within a series.
        memory: Of the noise, newest first: errors are what it does not foretell. Empty: they are as they are.
        slow: Deviation of what else is in the noise, an offset that moves slowly [unit of y]; 0: nothing.
        untimed: When commands were given is a number beside the model.
    """

    series: Sequence[Series]
    windows: tuple[tuple[int, int, int], ...]
    memory: tuple[float, ...] = ()
    slow: float = 0.0
    untimed: bool = False

    @cached_property
    def sizes(self) -> Rows:
        """Rows of each window, shape (w,)."""
        return _kept(np.array([last - first for _, first, last in self.windows], np.int64))

    @cached_property
    def slices(self) -> list[slice]:
        """Where each window stands in what is end to end."""
        ends = np.cumsum(self.sizes)
        return [slice(int(end - size), int(end)) for end, size in zip(ends, self.sizes, strict=True)]

    @cached_property
    def runs(self) -> list[Run]:
        """Its windows, series by series."""
        out = []
        for k, one in enumerate(self.series):
            own = [w for w, (of, _, _) in enumerate(self.windows) if of == k]
            first, last = (np.array([self.windows[w][end] for w in own], np.int64) for end in (1, 2))
            if own:
                out.append(Run(one, own, first, last, float(np.max(np.abs(one.y)))))
        return out

    def gathered(self, name: str) -> Array:
        """An array of the series, windows end to end."""
        parts = [getattr(self.series[k], name)[first:last] for k, first, last in self.windows]
        return np.concatenate(parts)

    @cached_property
    def y(self) -> Array:
        """Readings, end to end."""
        return _kept(self.gathered("y"))

    @property
    def relayed(self) -> bool:
        """Whether a relay gave the commands of all recordings."""
        return all(recording.relayed for recording in self.series)

    @cached_property
    def good(self) -> Mask:
        """Rows that count, end to end."""
        good = self.gathered("good").astype(np.bool_)
        if self.memory:
            good = np.concatenate([has_past(good[rows], len(self.memory)) for rows in self.slices])
        return _kept(good)

    def remembering(self, memory: tuple[float, ...], slow: float = 0.0) -> Cut:
        """The same windows, of which errors are what noise with this memory does not foretell."""
        return replace(self, memory=memory, slow=slow)

    def unforeseen(self, error: Array) -> Array:
        """Errors, end to end, less what the noise foretells of them."""
        if not self.memory:
            return error
        return np.concatenate([unforeseen(error[rows], self.memory) for rows in self.slices])

    @cached_property
    def noise(self) -> Array:
        """Root mean square of the noise in each window, as far as errors count, shape (w,)."""
        return _kept(np.array([self.series[k].level for k, _, _ in self.windows]))

    @property
    def allowed(self) -> Array:
        """The same, with as much noise as there may be."""
        return np.array([self.series[k].allowed for k, _, _ in self.windows])

    @property
    def floor(self) -> Array:
        """Standard deviation of the samples in each window about a perfect simulation, shape (w,)."""
        return np.array([self.series[k].noise for k, _, _ in self.windows])

    @cached_property
    def slack(self) -> Array:
        """Error of each row that says nothing, end to end."""
        return _kept(np.repeat([self.series[k].slack for k, _, _ in self.windows], self.sizes))

    @cached_property
    def coarse(self) -> bool:
        """Whether any row has an error that says nothing."""
        return bool(np.any(self.slack > 0.0))

    def started(self) -> Mask:
        """Rows in the first part of their window, in which it settles, end to end."""
        return np.concatenate([_settling(self.series[k].t[first:last]) for k, first, last in self.windows])

    def only(self, chosen: Iterable[int]) -> Cut:
        """Some of the windows."""
        return Cut(self.series, tuple(self.windows[k] for k in chosen))


def _kept(array: NDArray[Of]) -> NDArray[Of]:
    """Not to be written to: others are given the same."""
    array.flags.writeable = False
    return array


def cut(every: Sequence[Series]) -> tuple[Cut, Cut]:
    """Windows to fit, and windows held out: every second one.

    Raises:
        DiagnoseError: The recordings are too short.
    """
    fitted: list[tuple[int, int, int]] = []
    held: list[tuple[int, int, int]] = []
    for k, one in enumerate(every):
        for number, (first, last) in enumerate(_windows(one)):
            if number % 2 == 0:
                fitted.append((k, first, last))
            elif can_be_scored(one, first, last):
                held.append((k, first, last))
    if not fitted or not held:
        raise DiagnoseError("the recordings are too short: a diagnosis needs four windows of 50 samples")
    return Cut(every, tuple(fitted)), Cut(every, tuple(held))


def exchanged(to_fit: Cut, held_out: Cut) -> tuple[Cut, Cut]:
    """The halves in each other's place.

    Raises:
        DiagnoseError: No window that was fitted can show an error.
    """
    every = to_fit.series
    told = tuple(one for one in to_fit.windows if can_be_scored(every[one[0]], *one[1:]))
    if not told:
        raise DiagnoseError("the windows that are fitted are too short to be held out")
    return held_out, Cut(every, told)


def _windows(recording: Series) -> list[tuple[int, int]]:
    pairs = [pair for first, last in recording.blocks for pair in _within(recording, first, last)]
    enough = [(a, b) for a, b in pairs if np.count_nonzero(recording.good[a:b]) >= WINDOWS.least_samples]
    moving = [
        (a, b)
        for a, b in enough
        if np.std(recording.y[a:b][recording.good[a:b]]) > WINDOWS.moving_above_noise * recording.noise
    ]
    return moving if len(moving) >= SERIES.fewest_windows else enough


def can_be_scored(recording: Series, first: int, last: int) -> bool:
    """Whether a window held out has samples to settle its initial state, and some after them."""
    t, good = recording.t[first:last], recording.good[first:last]
    settles = _settling(t)
    return bool(np.any(good & settles) and np.any(good & ~settles))


def _within(recording: Series, first: int, last: int) -> list[tuple[int, int]]:
    """First and last rows of a block's windows."""
    t = recording.t[first:last]
    begin = t[0] + min(WINDOWS.skipped_s, WINDOWS.skipped_part * float(t[-1] - t[0]))
    usual = int((t[-1] - begin) / recording.window_s + WINDOWS.rounding)
    count = max(SERIES.fewest_windows, usual)
    edges = np.linspace(begin, t[-1] + 0.5 * recording.tick, count + 1)
    rows = first + np.searchsorted(t, edges - WINDOWS.at_edge * recording.tick)
    return [(int(a), int(b)) for a, b in pairwise(rows)]


def _settling(t: Array) -> Mask:
    """Rows of a window in the first part of its time, shape (n,)."""
    end = WINDOWS.settling_part * float(t[-1] - t[0]) - WINDOWS.at_edge * float(t[-1] - t[0]) / max(
        len(t) - 1, 1
    )
    return np.asarray(t - t[0] < end)


def all_windows(every: Sequence[Series]) -> tuple[tuple[int, int, int], ...]:
    """All windows of recordings: (which, first row, row after the last)."""
    return tuple((k, first, last) for k, one in enumerate(every) for first, last in _windows(one))


def one_window_each(every: Sequence[Series]) -> tuple[tuple[int, int, int], ...]:
    """Each recording as one window."""
    return tuple((k, 0, len(one.t)) for k, one in enumerate(every))


def all_but(every: Sequence[Series], held_out: Cut) -> Cut:
    """Windows of whole recordings, without the rows of those held out."""
    out = []
    for k, one in enumerate(every):
        good = one.good.copy()
        for of, first, last in held_out.windows:
            good[first:last] &= of != k
        out.append(replace(one, good=good, blocks=((0, len(one.t)),)))
    return Cut(out, all_windows(out))


def hardly_settle(every: Cut) -> bool:
    """Whether windows have so few rows that the first fifth of one does not tell its initial state."""
    return float(np.median(every.sizes)) * WINDOWS.settling_part < WINDOWS.settling_rows


def fitted_windows(to_fit: Cut) -> Cut:
    """Windows to fit as they are fitted: segments, or, where these tell no initial state, whole recordings.

    A recording of few rows is simulated in no time, and has one initial state then.
    """
    return undivided(to_fit) if hardly_settle(to_fit) else segments(to_fit)


def segments(whole: Cut, longest_s: float | None = None) -> Cut:
    """The same rows in windows no longer than that; None: than `Series.segment_s`.

    In shorter ones the initial states make up for what is wrong with the model. Those without a sample tell
    nothing and are left out.
    """
    out = []
    for k, first, last in whole.windows:
        one = whole.series[k]
        length = one.segment_s if longest_s is None else longest_s
        count = math.ceil((one.t[last - 1] - one.t[first]) / length - WINDOWS.segment_longer)
        count = max(1, min(count, (last - first) // WINDOWS.least_segment_rows))
        edges = np.linspace(first, last, count + 1).astype(int).tolist()
        out += [(k, a, b) for a, b in pairwise(edges) if one.good[a:b].any()]
    return Cut(whole.series, tuple(out))


def undivided(whole: Cut) -> Cut:
    """Each block of a recording as one window, in which the same rows count."""
    every = list(whole.series)
    windows: list[tuple[int, int, int]] = []
    for k in sorted({k for k, _, _ in whole.windows}):
        own = [(first, last) for of, first, last in whole.windows if of == k]
        counts = np.zeros(len(every[k].t), np.bool_)
        for first, last in own:
            counts[first:last] = True
        every[k] = replace(every[k], good=every[k].good & counts)
        for begin, end in every[k].blocks:
            inside = [(first, last) for first, last in own if begin <= first < end]
            windows += [(k, inside[0][0], inside[-1][1])] if inside else []
    return Cut(every, tuple(windows))


def sample(whole: Cut, seconds: float) -> Cut:
    """Windows of about so many seconds together, spread evenly."""
    lengths = np.array([float(whole.series[k].t[b - 1] - whole.series[k].t[a]) for k, a, b in whole.windows])
    count = max(2, round(seconds / float(np.mean(lengths))))
    if count >= len(whole.windows):
        return whole
    return whole.only(np.unique(np.linspace(0, len(whole.windows) - 1, count).round().astype(int)).tolist())


def beginnings(whole: Cut, rows: int) -> Cut:
    """The same windows, of each the first part, where all have more than so many rows."""
    part = rows / int(whole.sizes.sum())
    if part >= 1.0:
        return whole
    return Cut(whole.series, tuple((k, a, a + math.ceil(part * (b - a))) for k, a, b in whole.windows))


def sparse(whole: Cut) -> Cut:
    """Of a relay's recordings, whose commands hold for long, no more samples than trials need.

    Without their first windows: how a limit cycle grows tells much of a plant that is nearly right, and leads
    astray from any other.
    """
    strides = [_stride(recording) for recording in whole.series]
    every = [one.sparser(stride) for one, stride in zip(whole.series, strides, strict=True)]
    kept = [one.kept(stride) for one, stride in zip(whole.series, strides, strict=True)]
    windows = tuple((k, _row(kept[k], a), _row(kept[k], b)) for k, a, b in whole.windows)
    grown = tuple(
        (k, a, b)
        for n, (k, a, b) in enumerate(windows)
        if not every[k].relayed or (n and windows[n - 1][0] == k)
    )
    return Cut(every, grown if len(grown) > 1 else windows)


def _row(kept: Rows, row: int) -> int:
    """Where a row is among those that are kept."""
    return int(np.searchsorted(kept, row))


def _stride(recording: Series) -> int:
    """Samples of a relay's recording of which one is enough: between them the others are as they were.

    A limit cycle is smooth; what oscillates after each switch of slow commands is not.
    """
    stride = (
        max(1, int(recording.period_s / (WINDOWS.samples_a_period * recording.reading_s)))
        if recording.relayed
        else 1
    )
    while stride > 1 and not _smooth(recording, stride):
        stride //= 2
    return stride


def _smooth(recording: Series, stride: int) -> bool:
    """Whether every so manieth sample tells the others, but for noise."""
    rows = np.flatnonzero(recording.good)
    kept = rows[::stride]
    if len(kept) < WINDOWS.fewest_of_curve:
        return False
    error = np.abs(recording.y[rows] - CubicSpline(recording.t[kept], recording.y[kept])(recording.t[rows]))
    return float(np.quantile(error, WINDOWS.mostly)) < WINDOWS.between * recording.noise + recording.slack
