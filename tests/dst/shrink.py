"""The fewest faults with which a failing run still fails."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.dst.run import Outcome, run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.dst.faults import Fault

TRIES = 200
"""Runs at most."""


def shrunk(outcome: Outcome, duration: float) -> Outcome:
    """Take faults away, halves first, then ever fewer, as long as it fails (ddmin)."""
    best, tries, parts = outcome, 0, 2
    while tries < TRIES and best.faults:
        size = -(-len(best.faults) // parts)
        for at in range(0, len(best.faults), size):
            kept: Sequence[Fault] = best.faults[:at] + best.faults[at + size :]
            tries += 1
            again = run(outcome.seed, duration, kept, wire=outcome.wire)
            if again.failures:
                best, parts = again, max(2, parts - 1)
                break
        else:
            if size == 1:
                break
            parts = min(len(best.faults), parts * 2)
    return best
