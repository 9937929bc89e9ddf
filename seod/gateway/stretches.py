"""Rows of an excited axis cut into stretches that a model is simulated over."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.beside.window import Stretch
from seod.ring import FLAG_EXCITING, FLAG_FRESH

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from seod.gateway.messages import RowTuple

PERIODS: Final = 6.0
"""Of the plant's natural frequency in a stretch,"""
SPAN_S: Final = (0.25, 2.0)
"""within these bounds."""
BEFORE_S: Final = 0.15
"""Commands that are kept from before a stretch: longer than delay and lag of any plant."""
_FEWEST: Final = 60
"""Fresh samples of a stretch."""


class Stretches:
    """Cuts rows as they come.

    Args:
        omega_n: Of the plant [rad/s].
        nominal: Supply pressure at which the plant is nominal [Pa], if rows tell it.
    """

    def __init__(self, omega_n: float, nominal: float | None) -> None:
        self.span = min(SPAN_S[1], max(SPAN_S[0], PERIODS * 2.0 * math.pi / omega_n))
        self._nominal = nominal
        self._rows: list[RowTuple] = []

    def add(self, rows: Iterable[RowTuple]) -> Iterator[Stretch]:
        """The stretches that these rows complete; their ends are kept for the next ones."""
        for row in rows:
            if not row[-1] & FLAG_EXCITING:
                self._rows.clear()
                continue
            self._rows.append(row)
            if row[0] - self._rows[0][0] >= self.span + BEFORE_S:
                stretch = stretch_of(self._rows, self._nominal)
                self._rows = [each for each in self._rows if each[0] > row[0] - BEFORE_S]
                if stretch is not None:
                    yield stretch

    def clear(self) -> None:
        """Begin anew: rows are missing."""
        self._rows.clear()


def stretch_of(rows: Sequence[RowTuple], nominal: float | None) -> Stretch | None:
    """Fresh samples after the first `BEFORE_S`, and all commands; None where too few are fresh.

    Args:
        rows: In their order.
        nominal: Supply pressure at which the plant is nominal [Pa], if rows tell it.
    """
    table = np.array([(row[0], row[1], row[3], row[4], row[8]) for row in rows])
    fresh = np.array([bool(row[-1] & FLAG_FRESH) for row in rows])
    t = table[:, 0]
    kept = fresh & np.isfinite(table[:, 1]) & (t >= t[0] + BEFORE_S)
    kept[1:] &= np.diff(t) > 0.0
    sent = np.isfinite(table[:, 2]) & np.isfinite(table[:, 3])
    if np.count_nonzero(kept) < _FEWEST or not sent.any():
        return None
    ps = table[kept, 4]
    supply = ps / nominal if nominal and np.isfinite(ps).all() else np.empty(0)
    return Stretch(t[kept], table[kept, 1], table[sent, 3], table[sent, 2], supply)
