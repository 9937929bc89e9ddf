"""The `health` message: how well loop and gateway keep up, from the shared status block."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivers.base import StampError
from seod.estimate.base import finite_or_none
from seod.processes.ring import Word, bin_edges_us

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.processes.ring import Shared


def percentile_us(bins: Sequence[int], fraction: float, maximum_us: float) -> float | None:
    """Upper edge [us] of the bin in which this fraction of the ticks is reached; None without ticks."""
    total = sum(bins)
    if total == 0:
        return None
    edges = [*bin_edges_us(), maximum_us]
    reached = 0
    for ticks, edge in zip(bins, edges, strict=True):
        reached += ticks
        if reached >= fraction * total:
            return min(edge, maximum_us)
    return maximum_us


def histogram(bins: Sequence[int], maximum_s: float) -> dict[str, Any]:
    """Percentiles [us] and the counts themselves."""
    maximum_us = maximum_s * 1e6
    return {
        "p50_us": percentile_us(bins, 0.5, maximum_us),
        "p99_us": percentile_us(bins, 0.99, maximum_us),
        "p999_us": percentile_us(bins, 0.999, maximum_us),
        "max_us": maximum_us,
        "bins": list(bins),
    }


class Health:
    """Reads the status block; remembers the last reading to tell the rate."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._last: tuple[float, int] | None = None
        self._rate: float | None = None

    def measure(self, now: float) -> None:
        """Note ticks and time [s], once for each message, so that the rate is that since the last one.

        There is none yet where the loop had not begun at the last one.
        """
        ticks = self._shared.words[Word.TICKS]
        if self._last is not None and self._last[1] and now > self._last[0]:
            self._rate = (ticks - self._last[1]) / (now - self._last[0])
        self._last = (now, ticks)

    def stamps(self) -> StampError:
        """How far the times of samples may be off now."""
        floats = self._shared.floats
        return StampError(floats[Word.STAMP_COMMON_D], floats[Word.STAMP_SCATTER_D])

    def loop(self, now: float, counter_names: Sequence[str]) -> dict[str, Any]:
        """What the loop says about itself."""
        words, floats = self._shared.words, self._shared.floats
        return {
            "t": now,
            "ticks": words[Word.TICKS],
            "rate_hz": self._rate,
            "overruns": words[Word.OVERRUNS],
            "lateness": histogram(self._shared.lateness.tolist(), floats[Word.LATENESS_MAX_D]),
            "execution": histogram(self._shared.execution.tolist(), floats[Word.EXECUTION_MAX_D]),
            "sample_age_s": floats[Word.SAMPLE_AGE_D],
            "sample_age_max_s": floats[Word.SAMPLE_AGE_MAX_D],
            "stamp_common_sd_s": finite_or_none(self.stamps().common),
            "stamp_scatter_sd_s": finite_or_none(self.stamps().scatter),
            "counters": dict(zip(counter_names, self._shared.counters.tolist(), strict=False)),
        }
