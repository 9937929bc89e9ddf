"""Rows of an excited axis cut into segments that a model is simulated over."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.model_monitor.window import Segment
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH, Column

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from seod.observe.messages import RowTuple

PERIODS: Final = 6.0
"""Of the plant's natural frequency in a segment,"""
SPAN_S: Final = (0.25, 2.0)
"""within these bounds."""
BEFORE_S: Final = 0.15
"""Commands that are kept from before a segment: longer than delay and lag of any plant."""
_FEWEST: Final = 60
"""Fresh samples of a segment."""
_USED: Final = (Column.T, Column.Y, Column.U, Column.T_U, Column.PS)


class Segments:
    """Cuts rows as they come.

    Args:
        omega_n: Of the plant [rad/s].
        nominal: Supply pressure at which the plant is nominal [Pa], if rows tell it.
    """

    def __init__(self, omega_n: float, nominal: float | None) -> None:
        self.span = min(SPAN_S[1], max(SPAN_S[0], PERIODS * 2.0 * math.pi / omega_n))
        self._nominal = nominal
        self._rows: list[RowTuple] = []

    def add(self, rows: Iterable[RowTuple]) -> Iterator[Segment]:
        """The segments that these rows complete; their ends are kept for the next ones."""
        for row in rows:
            if not row[Column.FLAGS] & FLAG_EXCITING:
                self._rows.clear()
                continue
            self._rows.append(row)
            if row[Column.T] - self._rows[0][Column.T] >= self.span + BEFORE_S:
                segment = segment_of(self._rows, self._nominal)
                self._rows = [each for each in self._rows if each[Column.T] > row[Column.T] - BEFORE_S]
                if segment is not None:
                    yield segment

    def clear(self) -> None:
        """Begin anew: rows are missing."""
        self._rows.clear()


def segment_of(rows: Sequence[RowTuple], nominal: float | None) -> Segment | None:
    """Fresh samples after the first `BEFORE_S`, and all commands; None where too few are fresh.

    Args:
        rows: In their order.
        nominal: Supply pressure at which the plant is nominal [Pa], if rows tell it.
    """
    t, y, u, t_u, ps = np.array([[row[column] for column in _USED] for row in rows]).T
    fresh = np.array([bool(row[Column.FLAGS] & FLAG_FRESH) for row in rows])
    kept = fresh & np.isfinite(y) & (t >= t[0] + BEFORE_S)
    kept[1:] &= np.diff(t) > 0.0
    sent = np.isfinite(u) & np.isfinite(t_u)
    if np.count_nonzero(kept) < _FEWEST or not sent.any():
        return None
    supply = ps[kept] / nominal if nominal and np.isfinite(ps[kept]).all() else np.empty(0)
    return Segment(t[kept], y[kept], t_u[sent], u[sent], supply)
