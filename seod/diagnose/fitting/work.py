"""How much was simulated: a clock that runs alike on every machine, idle or busy, on one core or on many.

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


def spend(steps: float, rows: int, *, orifice: bool = False) -> None:
    """Count one simulation of so many steps and rows; steps with an orifice take longer."""
    step_ns = WORK.orifice_step_ns if orifice else WORK.step_ns
    _used_ns.set(_used_ns.get() + WORK.simulation_ns + step_ns * int(steps) + WORK.row_ns * rows)


def used_s() -> float:
    """What was used so far [s of a usual machine]."""
    return 1e-9 * _used_ns.get()


def counted(parallel: ParallelMap) -> ParallelMap:
    """A map over trials that counts what each of them uses, whatever thread it runs in."""

    def mapped(act: Callable[[One], Made], some: Iterable[One]) -> list[Made]:
        begun = _used_ns.get()

        def alone(one: One) -> tuple[Made, int]:
            token = _used_ns.set(begun)
            try:
                return act(one), _used_ns.get() - begun
            finally:
                _used_ns.reset(token)

        made = list(parallel(alone, some))
        _used_ns.set(begun + sum(used for _, used in made))
        return [what for what, _ in made]

    return mapped
