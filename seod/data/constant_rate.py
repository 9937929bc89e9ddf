"""Files whose rows come at a constant rate and tell no time: `--columns t=50Hz` says which rate."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.data.source import Block, Column, ReadError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from seod.data.source import Source

TIME: Final = "row / rate"
"""What the column of times is called: like none of a file."""

_RATE: Final = re.compile(r"(?P<number>[0-9.eE+-]+)\s*(?P<unit>[kM]?)Hz")
_UNITS: Final = {"": 1.0, "k": 1e3, "M": 1e6}


def rate_of(text: str) -> float | None:
    """The rate [Hz] that `50Hz` or `2 kHz` says; None of other words.

    Raises:
        ReadError: It is no rate above 0.
    """
    told = _RATE.fullmatch(text.strip())
    if told is None:
        return None
    try:
        rate = float(told["number"]) * _UNITS[told["unit"]]
    except ValueError:
        return None
    if not (math.isfinite(rate) and rate > 0.0):
        raise ReadError(f"--columns: t={text}: a rate is above 0 Hz, such as t=50Hz")
    return rate


def with_times(source: Source, columns: Mapping[str, str]) -> tuple[Source, Mapping[str, str]]:
    """The source with a column of times, where `t` is a rate and no column is called so; else as they are."""
    named = columns.get("t", "")
    if any(group.column(named) for group in source.groups):
        return source, columns
    rate = rate_of(named)
    return (source, columns) if rate is None else (_Timed(source, rate), {**columns, "t": TIME})


class _Timed:
    """A source whose rows come at a constant rate [Hz], the first of each group at 0 s."""

    def __init__(self, source: Source, rate: float) -> None:
        self._source, self._rate = source, rate
        self.path, self.format, self.remarks = source.path, source.format, source.remarks
        time = Column(TIME, "s")
        self.groups = tuple(replace(each, columns=(*each.columns, time)) for each in source.groups)

    @property
    def notes(self) -> Mapping[str, str]:
        """As `Source`."""
        return self._source.notes

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`."""
        groups, before = {each.name: each for each in self.groups}, defaultdict[str, int](int)
        own = {name: [each for each in names if each != TIME] for name, names in wanted.items()}
        for block in self._source.blocks(own):
            first = before[block.group.name]
            before[block.group.name] += len(block.rows)
            times = np.arange(first, first + len(block.rows)) / self._rate
            yield replace(block, group=groups[block.group.name], values={**block.values, TIME: times})

    def close(self) -> None:
        """As `Source`."""
        self._source.close()
