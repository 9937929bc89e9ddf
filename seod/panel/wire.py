"""Binary messages to the page: a head of 32 bytes and float32 values, little-endian.

| bytes | is |
| --- | --- |
| 0 | kind: 1 live, 2 one sweep of a trigger, 3 the answer to `history` |
| 1 | number of the axis |
| 2 to 3 | rows of the table that follows |
| 4 to 7 | its columns |
| 8 to 11 | number of the view, or of the question |
| 12 to 15 | 0 |
| 16 to 23 | float64: of live messages the number of the first interval, else its time [s] |
| 24 to 31 | float64: length of an interval [s] |

The table holds lowest and highest of u, y and signal in each interval, row by row. One live message may hold
a block for each axis.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

HEAD: Final = struct.Struct("<BBHIIIdd")
LIVE: Final = 1
SWEEP: Final = 2
ANSWER: Final = 3


def block(kind: int, axis: int, number: int, start: float, step: float, table: NDArray[np.float32]) -> bytes:
    """One block: its head and its table, shape (rows, columns)."""
    rows, columns = table.shape
    return HEAD.pack(kind, axis, rows, columns, number, 0, start, step) + table.astype("<f4").tobytes()
