"""The numbers that steer a sheet, each with its reason: what counts, what is an alarm, how much is shown."""

from __future__ import annotations

from typing import Final, NamedTuple

QUANTITIES: Final = ("zeta", "omega_n", "K_L")
"""What a sheet follows over time."""

DRIFT: Final[dict[str, float]] = {"zeta": 0.10, "omega_n": 0.05, "K_L": 0.05}
"""Change against the reference period that is tolerated, in parts of the reference.

Chosen. 5 % is where the daemon's monitor begins to say that a rig has left its model
(`seod.model_monitor.judge.TOLERANCE`). zeta gets twice that: oil temperature and e_a alone move it so far.
"""

GOOD: Final = "ok"
"""Quality of the estimates that count: all others say themselves that they are not to be believed."""

DIAGNOSES: Final = 20
FAULTS: Final = 50
"""Most rows of these tables, the newest; the sheet says how many there are. More make no sheet but a log."""

SETTLED: Final = 0.05
"""Band about the final speed within which a step response has settled, in parts of it; chosen, as many do."""
RISE: Final = (0.1, 0.9)
"""Parts of the final speed between which the rise time is counted; the usual ones."""


class Limit(NamedTuple):
    """A quantity must lie between these; `axis` "" for all axes."""

    axis: str
    name: str
    low: float
    high: float


def parse_limit(text: str) -> Limit:
    """`zeta=0.1:0.3`, `motor.omega_n=100:`, `K_L=:20` (SI units).

    Raises:
        ValueError: It is none of these; the message says what would be right.
    """
    place, equals, span = text.partition("=")
    axis, _, name = place.rpartition(".")
    low, colon, high = span.partition(":")
    if name not in QUANTITIES:
        raise ValueError(f"--limit {text}: {name!r} is none of {', '.join(QUANTITIES)}")
    try:
        limit = Limit(axis, name, float(low or "-inf"), float(high or "inf"))
    except ValueError:
        limit = Limit(axis, name, 0.0, 0.0)
    if not equals or not colon or not limit.low < limit.high:
        raise ValueError(f"--limit {text}: must read like zeta=0.1:0.3, lower end first; one may be empty")
    return limit
