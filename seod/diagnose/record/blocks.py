"""Blocks of a long recording in which causes are searched: all of it tells no more of what they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.tuning.record import BLOCKS, SERIES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.record.series import Series

MARKS: Final = ((0,), (0, 1), (0, 1, 3), (0, 1, 4, 6), (0, 1, 4, 9, 11))
"""Where blocks begin, over the last one's place: Golomb's rulers. No two distances are alike, so that a wave
which fits all blocks is not mistaken for one with some turns more between them."""


def in_blocks(every: Sequence[Series]) -> list[Series]:
    """The same recordings; of those that are long, blocks from their beginning to their end."""
    part = BLOCKS.searched_rows / max(sum(len(one.t) for one in every), 1)
    return [_in_blocks(one, round(part * len(one.t))) if part < 1.0 else one for one in every]


def _in_blocks(recording: Series, rows: int) -> Series:
    """As many blocks as are long enough and lie beside each other, of so many rows together."""
    n = len(recording.t)
    least = max(int(SERIES.fewest_windows * recording.window_s / recording.tick), 1)
    if max(rows, least) >= n:
        return recording
    most = min(max(rows // least, 1), len(MARKS))
    count = max(k for k in range(1, most + 1) if k == 1 or (MARKS[k - 1][-1] + 1) * (rows // k) <= n)
    size = max(rows // count, least)
    marks = MARKS[count - 1]
    return recording.searched_in([mark * (n - size) // max(marks[-1], 1) for mark in marks], size)
