"""Two programs that take turns, so that what disturbs the machine meets both alike."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class Pairs:
    """Times of the runs of each [s], in the order in which they were made."""

    first: list[float]
    second: list[float]

    @property
    def ratio(self) -> float:
        """Median of first over second."""
        return median(a / b for a, b in zip(self.first, self.second, strict=True))


def spent(run: Callable[[], object], repeat: int = 1, clock: Callable[[], float] = perf_counter) -> float:
    start = clock()
    for _ in range(repeat):
        run()
    return (clock() - start) / repeat


def alternate(
    first: Callable[[], object],
    second: Callable[[], object],
    rounds: int,
    repeat_second: int = 1,
    clock: Callable[[], float] = perf_counter,
) -> Pairs:
    """Run both `rounds` times, each of them first in every other round, after one run for nothing.

    Another `clock` is `time.process_time`: for what computes alone, on a machine that others use too.
    """
    first(), second()
    found = Pairs([], [])
    for k in range(rounds):
        if k % 2:
            found.second.append(spent(second, repeat_second, clock))
        found.first.append(spent(first, 1, clock))
        if not k % 2:
            found.second.append(spent(second, repeat_second, clock))
    return found
