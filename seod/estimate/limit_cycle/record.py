"""The newest rows of one excitation, parted into half cycles."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from itertools import pairwise
from statistics import fmean
from typing import TYPE_CHECKING

from seod.estimate.limit_cycle.switches import Switch, SwitchTracker
from seod.estimate.quality import NoiseMeter

if TYPE_CHECKING:
    from seod.estimate.base import EstimatorSettings, Row

_LARGEST = 1e9
"""Numbers beyond this are no measurements (and their squares would overflow)."""
_GAP_TICKS = 10.0
_GAP_PART = 0.25
"""A gap in time longer than 10 ticks, and than this part of a half cycle, breaks the record."""
NO_SWITCH_S = 1.0
"""A relay that has not switched for this long (or for four half cycles, if longer) does not oscillate."""
BIAS_JUMP = 0.05
"""A bias that moves within a row by more than this part of e_a is another one; less is a drift or a trim."""
_NOISE_MEMORY = 1000.0
_SAMPLES_MAX = 200_000


class Record:
    """Samples since some half cycles ago, and the relay's switches of the window.

    Attributes:
        times: When the samples were taken [s], ascending.
        samples: Position [axis unit], one for each of `times`.
        switches: The newest `window + 1` switches, with the delay known beforehand added.
        now: When the newest row's command left [s].
        switched: When u changed last, or when the record began [s].
    """

    def __init__(self, settings: EstimatorSettings, window: int) -> None:
        self._settings = settings
        self.times: list[float] = []
        self.samples: list[float] = []
        self.switches: deque[Switch] = deque(maxlen=window + 1)
        self.noise = NoiseMeter()
        self.now = self.switched = -math.inf
        self.reference = self.e_a = self.bias = math.nan
        self.gains: deque[float] = deque(maxlen=window + 1)
        self._tracker = SwitchTracker()
        self._up: bool | None = None
        self._half = 0.0

    @property
    def has_begun(self) -> bool:
        """Whether a row was taken."""
        return self.now > -math.inf

    @property
    def durations(self) -> list[float]:
        """Half cycles between the switches of the window [s]."""
        return [b.t - a.t for a, b in pairwise(self.switches)]

    @property
    def is_stale(self) -> bool:
        """Whether no new sample came for longer than a record may miss."""
        newest = self.times[-1] if self.times else self.switched
        return self.now - newest > self._longest_gap + _GAP_TICKS * self._settings.period_s

    @property
    def is_still(self) -> bool:
        """Whether the relay has not switched for so long that nothing oscillates."""
        return self.now - self.switched > max(NO_SWITCH_S, 4.0 * self._half)

    def breaks(self, row: Row) -> bool:
        """Whether `row` cannot continue this record: another set point or amplitude, or time is missing."""
        if not self.has_begun:
            return False
        same = (row.reference, row.e_a) == (self.reference, self.e_a)
        same = same and abs(row.bias - self.bias) <= BIAS_JUMP * row.e_a
        gap = bool(self.times) and row.fresh and row.t - self.times[-1] > self._longest_gap
        return not same or gap or row.t_u < self.now

    def is_new(self, row: Row) -> bool:
        """Whether `row` has a sample later than the newest one."""
        return row.fresh and not (self.times and row.t <= self.times[-1])

    def take(self, row: Row) -> Switch | None:
        """Add one sound row.

        Returns:
            The switch before the newest one, when the half cycle that it began has just ended.
        """
        if not self.has_begun:
            self.reference, self.e_a = row.reference, row.e_a
            self.switched = row.t_u
            self.gains.append(self.gain_of(row))
        self.now, self.bias = row.t_u, row.bias
        self._add_sample(row)
        drive = row.u - row.bias
        if drive == 0.0:
            return None
        up = drive > 0.0
        if up is not self._up:
            self._up, self.switched = up, row.t_u
            self.gains.append(self.gain_of(row))
        switch = self._tracker.update(row.t, row.t_u + self._settings.delay_s, up)
        if switch:
            self._half = switch.t - self.switches[-1].t if self.switches else 0.0
            self.switches.append(switch)
        return switch

    @property
    def K_L(self) -> float:
        """Gain in force in the window [axis unit/s/V]."""
        return fmean(self.gains) if self.gains else self._settings.K_L

    def gain_of(self, row: Row) -> float:
        """In force at a row [axis unit/s/V]; that of the settings where the row does not tell."""
        return row.K_L if 0.0 < row.K_L < _LARGEST else self._settings.K_L

    def since(self, t: float) -> int:
        """Index of the first sample at or after `t`."""
        return bisect_left(self.times, t)

    def forget(self, t: float) -> None:
        """Drop the samples before `t`."""
        count = self.since(t)
        del self.times[:count], self.samples[:count]

    def _add_sample(self, row: Row) -> None:
        if not self.is_new(row):
            self.noise.skip()
            return
        self.times.append(row.t)
        self.samples.append(row.y)
        self.noise.update(row.y, _NOISE_MEMORY)
        if len(self.times) > _SAMPLES_MAX:
            del self.times[: _SAMPLES_MAX // 2], self.samples[: _SAMPLES_MAX // 2]

    @property
    def _longest_gap(self) -> float:
        return max(_GAP_TICKS * self._settings.period_s, _GAP_PART * self._half)


def sound(row: Row) -> Row | None:
    """`row` fit for arithmetic: not fresh where its sample is no measurement, None where it tells nothing."""
    if not all(abs(x) < _LARGEST for x in (row.u, row.t_u, row.reference, row.e_a, row.bias)):
        return None
    if abs(row.y) < _LARGEST and abs(row.t_u - row.t) < 1.0 and row.e_a > 0.0:
        return row
    return row._replace(fresh=False)
