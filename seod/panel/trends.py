"""Estimates of hours, thinned: the newest as they come, older ones at growing distances."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.estimate.base import QUALITIES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

KEYS: Final = (
    "t",
    "zeta",
    "zeta_sd",
    "omega_n",
    "omega_n_sd",
    "K_L",
    "K_L_sd",
    "ps",
    "temperature",
    "amplitude",
    "frequency",
    "quality",
)
"""Of an `estimate`, in this order."""
RECENT: Final = 2400
"""Estimates that are kept as they came: some minutes."""
OLDER: Final = 4000
"""Estimates before that, at most; half of them go once there are more."""


class Trend:
    """Of one axis; in two pieces of memory, whatever has passed."""

    def __init__(self) -> None:
        self._recent = np.full((RECENT, len(KEYS)), np.nan)
        """A ring: estimate k is in row k modulo its length."""
        self._older = np.full((OLDER + 1, len(KEYS)), np.nan)
        self._count = self._kept = self._passed = 0
        self._every = 1

    def add(self, estimate: Mapping[str, Any]) -> None:
        """Take one more estimate."""
        numbers = [np.nan if estimate.get(key) is None else estimate[key] for key in KEYS[:-1]]
        quality = estimate.get("quality")
        if self._count and numbers[0] < self._recent[(self._count - 1) % RECENT, 0]:
            return  # told again, as stale
        place = self._recent[self._count % RECENT]
        if self._count >= RECENT:
            self._age(place)
        place[:-1] = numbers
        place[-1] = QUALITIES.index(quality) if quality in QUALITIES else np.nan
        self._count += 1

    def _age(self, point: NDArray[np.float64]) -> None:
        self._passed += 1
        if self._passed % self._every == 0:
            self._older[self._kept] = point
            self._kept += 1
        if self._kept > OLDER:
            thinned = self._older[1::2].copy()
            self._kept = len(thinned)
            self._older[: self._kept] = thinned
            self._every *= 2

    def columns(self, since: float | None = None) -> dict[str, list[Any]]:
        """All that is kept, or what came after a time [s]: a list for each of `KEYS`."""
        newest = np.arange(max(0, self._count - RECENT), self._count) % RECENT
        points = np.concatenate([self._older[: self._kept], self._recent[newest]])
        if since is not None:
            points = points[points[:, 0] > since]
        columns = {
            key: [None if np.isnan(value) else value for value in column.tolist()]
            for key, column in zip(KEYS, points.T, strict=True)
        }
        return columns | {"quality": [_word(value) for value in columns["quality"]]}


def _word(number: float | None) -> str | None:
    return None if number is None else QUALITIES[int(number)]
