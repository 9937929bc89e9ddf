"""A recording that pauses, as several: what the machine did meanwhile nobody tells."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.data.recording import Recording

INTERVALS: Final = 100.0
"""Over the usual interval, beyond which one is a pause [-]. Chosen: lost samples come by the dozen, and the
command holds meanwhile."""
_MOST_ROWS: Final = 0.5
"""Of the rows, at least, in parts that tell something [-]. Chosen: where what changes is written alone, most
rows are in parts that are too short."""
_COLUMNS: Final = ("t", "u", "y", "t_u", "ps", "temperature", "f", "rows")


def between_pauses(every: Sequence[Recording], fewest: int) -> tuple[list[Recording], tuple[str, ...]]:
    """Parts of recordings between their pauses, and what is said of these.

    Args:
        every: Recordings.
        fewest: Samples of a part that tells something.

    Parts that are too short, or in which nothing changes, are left out. Where most rows are in such parts a
    recording stays as it is: a logger that writes what changes alone does not pause.
    """
    out: list[Recording] = []
    said: list[str] = []
    for one in every:
        parts = _parts(one)
        usable = [part for part in parts if _tells(part, fewest)]
        kept = sum(len(part.t) for part in usable)
        if len(parts) == 1 or kept < _MOST_ROWS * len(one.t):
            out.append(one)
            continue
        out += usable
        said.append(_sentence(one, parts, usable))
    return out, tuple(said)


def _parts(one: Recording) -> list[Recording]:
    """Between all that is longer than a pause has to be: of times, or of rows that were left out.

    Where a clock was set back the rows until it has caught up are left out, and those after them were not
    recorded when they say.
    """
    intervals = np.diff(one.t)
    if not len(intervals):
        return [one]
    left_out = np.diff(one.rows)
    long = (intervals > INTERVALS * np.median(intervals)) | (left_out > INTERVALS * np.median(left_out))
    pauses = np.flatnonzero(long) + 1
    return [_rows(one, first, last) for first, last in pairwise([0, *pauses.tolist(), len(one.t)])]


def _rows(one: Recording, first: int, last: int) -> Recording:
    columns = {name: getattr(one, name) for name in _COLUMNS}
    return replace(one, **{name: each[first:last] for name, each in columns.items() if each is not None})


def _tells(part: Recording, fewest: int) -> bool:
    """Whether it has enough samples, and a command and a signal that change."""
    y, u = part.y[np.isfinite(part.y)], part.u[np.isfinite(part.u)]
    return len(y) >= fewest and len(u) > 0 and bool(np.ptp(u) > 0.0 and np.ptp(y) > 0.0)


def _sentence(one: Recording, parts: Sequence[Recording], usable: Sequence[Recording]) -> str:
    steps = [float(after.t[0] - before.t[-1]) for before, after in pairwise(parts)]
    usual = float(np.median(np.diff(one.t)))
    set_back = sum(step <= INTERVALS * usual for step in steps)  # its rows were left out, not its times
    lost = len(one.t) - sum(len(part.t) for part in usable)
    breaks = []
    if len(steps) > set_back:
        breaks.append(f"pauses {_times(len(steps) - set_back)}, {max(steps):.3g} s at the longest")
    if set_back:
        breaks.append(f"leaves out more than {INTERVALS:g} rows {_times(set_back)}, as of a clock set back")
    text = (
        f"{one.paths[0]}: {' and '.join(breaks)}; what it has between "
        f"is taken as {len(usable)} recording{'s' if len(usable) > 1 else ''}"
    )
    return text + (f", without {lost} rows in parts that are too short or do not move" if lost else "")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
