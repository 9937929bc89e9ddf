"""Defects of a recording, recognised before any physics is blamed for them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.record.column_checks import column_remarks
from seod.diagnose.record.fourth_differences import stencils
from seod.diagnose.record.held_readings import held_readings
from seod.diagnose.record.outliers import outliers, remaining_outliers
from seod.diagnose.record.sensor_step import Counts, counts
from seod.diagnose.record.timing_jitter import Jitter, remaining_jitter, timing_jitter
from seod.diagnose.result import SD_OF_95, Parameter
from seod.diagnose.tuning.record import DEFECTS
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.data import Recording
    from seod.diagnose.record.held_readings import Held
    from seod.diagnose.result import Array, Mask, Rows

_LARGEST: Final = 1e100


@dataclass(frozen=True, slots=True)
class Defect:
    """A defect with its numbers, named as in `sim.effects`.

    Attributes:
        name: `outliers`, `missing_samples`, `timing_jitter` or `held_readings`.
        parameters: By name.
        p_value: Of a recording without it.
    """

    name: str
    parameters: Mapping[str, Parameter]
    p_value: float


@dataclass(frozen=True, slots=True)
class Defects:
    """What is wrong with one recording.

    Attributes:
        bad: Rows whose `y` is not to be believed: outliers, readings at the end of the range, repeated ones;
            shape (n,).
        found: Defects with numbers.
        counts: The step of a coarse sensor.
        late: Mean squared error of samples taken at other times than told [unit^2 of y], 0 without jitter.
        off: Rows of outliers, shape (m,).
        readings: Their `y`, shape (m,).
        taken: When readings were taken [s], shape (n,); None: at the times of their rows.
        remarks: What a person should look at, in sentences.
    """

    bad: Mask
    found: tuple[Defect, ...] = ()
    counts: Counts = field(default_factory=Counts)
    late: float = 0.0
    off: Rows = field(default_factory=lambda: np.empty(0, np.int64))
    readings: Array = field(default_factory=lambda: np.empty(0))
    taken: Array | None = None
    remarks: tuple[str, ...] = ()

    @property
    def step(self) -> float:
        """Of a coarse sensor [unit of y]; 0 where none is seen."""
        return self.counts.step

    @property
    def coarse(self) -> Defect | None:
        """The step as an effect; None where none is seen."""
        step, wide = self.step, SD_OF_95 * self.counts.sd
        ends = {"step": (step - wide, step + wide)}
        return _named("sensor_quantization", {"step": step}, ends, 0.0) if step > 0.0 else None

    @property
    def held(self) -> Defect | None:
        """For how long the sensor repeats a reading, as an effect; None where each row has its own."""
        return next((each for each in self.found if each.name == "held_readings"), None)

    @property
    def has_outliers(self) -> bool:
        """Whether single readings are far off."""
        return any(each.name == "outliers" for each in self.found)

    def confirmed(self, t: Array, y: Array, simulated: Array) -> tuple[Defect, ...]:
        """Those that a model leaves as they are.

        A corner or a jump of the signal looks like an outlier, and many like late samples; a model that
        moves like that leaves less of them, whatever else it leaves.

        Args:
            t: Times of samples [s], shape (n,).
            y: Samples, NaN where there is none to believe, shape (n,).
            simulated: The model's readings, NaN where it was not asked, shape (n,).
        """
        left = {"outliers": self._outliers_left, "timing_jitter": self._jitter_left}
        gone = [name for name, part in left.items() if part(t, y, simulated) < DEFECTS.remains]
        return tuple(each for each in self.found if each.name not in gone)

    def _outliers_left(self, t: Array, y: Array, simulated: Array) -> float:
        """Part of the outliers that is left by a model; 1 where it was asked of none."""
        y = y.copy()
        y[self.off] = self.readings
        rows = _compared(y, simulated)
        if len(rows) < DEFECTS.fewest_samples:
            return 1.0
        return remaining_outliers(stencils(t, y, rows), stencils(t, y - simulated, rows), self.off)

    def _jitter_left(self, t: Array, y: Array, simulated: Array) -> float:
        """Part of the variance of the samples' times that is left by a model, in rows without outliers."""
        told = next((each for each in self.found if each.name == "timing_jitter"), None)
        rows = _compared(y, simulated)
        if told is None or len(rows) < DEFECTS.fewest_samples:
            return 1.0
        left = remaining_jitter(stencils(t, y - simulated, rows), t[rows], y[rows])
        return left / told.parameters["deviation"].value ** 2


def examine(recording: Recording) -> Defects:
    """Look for defects in one recording."""
    name = str(recording.paths[0]) if recording.paths else "recording"
    present, absurd = np.isfinite(recording.y), _absurd(recording.y)
    recording = replace(recording, y=np.where(absurd, np.nan, recording.y))
    rows, times = np.flatnonzero(present & ~absurd), recording.t
    remarks = column_remarks(name, recording)
    if len(rows) < DEFECTS.fewest_samples or np.ptp(recording.y[rows]) == 0.0:
        return Defects(absurd, remarks=tuple(remarks))
    held = held_readings(recording.t, recording.y)
    if held is not None:
        recording = replace(recording, t=held.taken, y=np.where(held.repeated, np.nan, recording.y))
    bad = clipped(recording.y)
    if bad.any():
        remarks.append(_clipped_remark(name, recording.y[bad]))
    bad |= absurd if held is None else absurd | held.repeated
    rest = rows[~bad[rows]]
    found = stencils(recording.t, recording.y, rest)
    if found.noise > DEFECTS.mostly_noise * float(np.std(recording.y[rest])):
        remarks.append(f"{name}: y is mostly noise: does the load move, is it the right column?")
    step = counts(recording.y[rest], found.noise)
    late = timing_jitter(found, recording.t[rest], recording.y[rest]) if step.step == 0.0 else Jitter()
    spread = late.deviations(max(found.noise, step.step / math.sqrt(12.0)), found)
    off = outliers(found, spread)
    bad[off.rows] = True
    defects = [_missing(times, present), _kept(held)]
    if off.p_value < 1.0:
        defects.append(_named("outliers", off.values, off.ci95, off.p_value))
    if late.deviation > 0.0:
        values, ends = {"deviation": late.deviation}, {"deviation": late.ci95}
        defects.append(_named("timing_jitter", values, ends, late.p_value))
    error = float(np.mean(spread[found.usable] ** 2)) if late.deviation > 0.0 else 0.0
    seen = tuple(each for each in defects if each)
    taken = None if held is None else held.taken
    return Defects(bad, seen, step, error, off.rows, recording.y[off.rows], taken, tuple(remarks))


def _kept(held: Held | None) -> Defect | None:
    if held is None:
        return None
    ends = {"time": (held.time - SD_OF_95 * held.sd, held.time + SD_OF_95 * held.sd)}
    return _named("held_readings", {"time": held.time}, ends, 0.0)


def _compared(y: Array, simulated: Array) -> Rows:
    """Rows with a reading of both, but for those in which a simulation is beyond all bounds."""
    return np.flatnonzero(np.abs(y - simulated) < _LARGEST)


def _absurd(y: Array) -> Mask:
    """Readings that lie beyond all bounds, shape (n,)."""
    near = np.isfinite(y) & (np.abs(y) < _LARGEST)
    if not near.any():
        return np.isfinite(y)
    middle = float(np.median(y[near]))
    spread = float(np.quantile(np.abs(y[near] - middle), DEFECTS.nearly_all))
    return np.isfinite(y) & ~(
        near & ((spread == 0.0) | (np.abs(y / DEFECTS.absurd - middle / DEFECTS.absurd) <= spread))
    )


def _named(
    name: str, values: Mapping[str, float], ci95: Mapping[str, tuple[float, float]], p_value: float
) -> Defect:
    units = {each.name: each.unit for each in EFFECTS[name].parameters}
    shown = {of: Parameter(value, units[of], ci95[of]) for of, value in values.items()}
    return Defect(name, shown, p_value)


def _missing(t: Array, present: Mask) -> Defect | None:
    """Rows without a reading, and rows that are not there at all."""
    steps = np.maximum(np.round(np.diff(t) / np.median(np.diff(t))), 1.0).astype(np.int64)
    there = np.zeros(1 + int(steps.sum()), np.bool_) if steps.sum() < DEFECTS.most_rows * len(t) else present
    if there is not present:
        there[np.concatenate([[0], np.cumsum(steps)])] = present
    lost = int(np.count_nonzero(~there))
    gaps = int(np.count_nonzero(np.diff(np.concatenate([[True], there]).astype(np.int8)) == -1))
    if lost < DEFECTS.unmentioned_gaps * len(there):
        return None
    rate, length = lost / len(there), lost / gaps
    spread = math.exp(SD_OF_95 * math.sqrt((2.0 - 1.0 / length) / gaps))
    width = math.exp(SD_OF_95 * math.sqrt((1.0 - 1.0 / length) / gaps))
    ends = {
        "rate": (rate / spread, min(1.0, rate * spread)),
        "length": (max(1.0, length / width), length * width),
    }
    return _named("missing_samples", {"rate": rate, "length": length}, ends, 0.0)


def clipped(y: Array) -> Mask:
    """Readings that stand still at an end of their range and came there by larger steps; shape (n,)."""
    out = np.zeros(len(y), np.bool_)
    present = np.flatnonzero(np.isfinite(y))
    seen = y[present]
    steps = np.abs(np.diff(seen))
    least = DEFECTS.clipped_step * float(np.min(steps[steps > 0.0], initial=math.inf))
    for end in (float(np.max(seen)), float(np.min(seen))):
        for first, last in _runs(seen == end):
            before, behind = steps[max(0, first - 2) : first], steps[last - 1 : last + 1]
            came = min(np.max(before, initial=0.0), np.max(behind, initial=0.0))
            if came >= least:
                out[present[first:last]] = True
    return out


def _runs(at_end: Mask) -> list[tuple[int, int]]:
    edges = np.diff(np.concatenate([[0], at_end.astype(np.int8), [0]]))
    pairs = zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True)
    return [(first, last) for first, last in pairs if last - first >= DEFECTS.clipped_readings]


def _clipped_remark(name: str, ends: Array) -> str:
    places = " and ".join(f"{end:g}" for end in np.unique(ends).tolist())
    return (
        f"{name}: y stands at {places} (unit of y) in {len(ends)} rows: the sensor's range ends there; "
        "they are left out"
    )
