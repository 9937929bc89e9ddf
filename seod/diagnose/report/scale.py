"""From a quantity's range to pixels, with round ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scale:
    """One axis of a picture.

    Attributes:
        low, high: Range of the quantity; both above 0 for a logarithmic one.
        start, end: Pixels that belong to them.
        log: Logarithmic.
    """

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def pixels(self, x: Array) -> Array:
        """Where values are; those outside at the border."""
        low, high = self._own(self.low), self._own(self.high)
        with np.errstate(divide="ignore", invalid="ignore"):
            own = np.log10(x) if self.log else x
        share = np.clip((own - low) / (high - low), 0.0, 1.0)
        return np.asarray(self.start + share * (self.end - self.start))

    def ticks(self) -> list[float]:
        """Round values within the range, three to eight of them."""
        decades = _decades(self.low, self.high) if self.log else []
        return decades if len(decades) > 2 else _round_steps(self.low, self.high)

    def _own(self, value: float) -> float:
        return math.log10(value) if self.log else value


def covering(values: Iterable[Array], start: float, end: float, log: bool = False) -> Scale:
    """The scale that shows all finite values, with a little room; of a logarithmic one all above 0."""
    finite = [x[np.isfinite(x) & ((x > 0.0) | (not log))] for x in values]
    every = np.concatenate([x for x in finite if len(x)] or [np.array([1.0 if log else 0.0])])
    low, high = float(every.min()), float(every.max())
    if log:
        return Scale(low / 1.2, high * 1.2, start, end, log)
    room = 0.04 * (high - low) or 0.5 * abs(high) or 1.0
    return Scale(low - room, high + room, start, end)


def _round_steps(low: float, high: float) -> list[float]:
    rough = (high - low) / 5.0
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= 0.999 * rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(f"{k * step:.10g}") for k in range(first, last + 1)]


def _decades(low: float, high: float) -> list[float]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    factors = (1.0,) if last - first > 3 else (1.0, 2.0, 5.0)
    every = max(1, (last - first) // 7)
    ticks = [f * 10.0**k for k in range(first, last + 1, every) for f in factors]
    return [tick for tick in ticks if low <= tick <= high]
