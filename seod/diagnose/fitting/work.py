"""Trials side by side, and how much they simulate: a clock that runs alike on one core and on many.

It counts what simulations do (steps of the kernel, rows, simulations), in what each takes on a usual machine,
whole nanoseconds. Whoever works side by side counts by itself, from where all began, so that nobody's answer
depends on how far the others are; whoever waits for them has then used what all have.
"""

from __future__ import annotations

from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, TypeVar

from seod.diagnose.tuning.fitting import WORK

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    ParallelMap = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]

One = TypeVar("One")
Made = TypeVar("Made")


_used_ns: ContextVar[int] = ContextVar("used_ns", default=0)
_side_by_side: ContextVar[bool] = ContextVar("side_by_side", default=False)
"""Whether this is a trial among others: each has a core then, and trials within it would wait for theirs."""


def spend(steps: float, rows: int, *, orifice: bool = False) -> None:
    """Count one simulation of so many steps and rows; steps with an orifice take longer."""
    step_ns = WORK.orifice_step_ns if orifice else WORK.step_ns
    _used_ns.set(_used_ns.get() + WORK.simulation_ns + step_ns * int(steps) + WORK.row_ns * rows)


def used_s() -> float:
    """What was used so far [s of a usual machine]."""
    return 1e-9 * _used_ns.get()


def uncounted(act: Callable[[], Made]) -> Made:
    """What it gives; what it uses does not count."""
    used = _used_ns.get()
    try:
        return act()
    finally:
        _used_ns.set(used)


def counted(parallel: ParallelMap) -> ParallelMap:
    """A map over trials that counts what each of them uses, whatever thread it runs in.

    A single trial, and those within one of several, run where they are.
    """

    def mapped(act: Callable[[One], Made], some: Iterable[One]) -> list[Made]:
        some, begun, within = list(some), _used_ns.get(), _side_by_side.get()

        def alone(one: One) -> tuple[Made, int]:
            used, among = _used_ns.set(begun), _side_by_side.set(within or len(some) > 1)
            try:
                return act(one), _used_ns.get() - begun
            finally:
                _used_ns.reset(used)
                _side_by_side.reset(among)

        made = list((map if within or len(some) == 1 else parallel)(alone, some))
        _used_ns.set(begun + sum(used for _, used in made))
        return [what for what, _ in made]

    return mapped
