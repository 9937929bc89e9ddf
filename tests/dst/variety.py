"""What differs between seeds besides chances and faults: how often things are looked at, sent, asked for."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

SAMPLES = ("estimate", "sample", "event", "health")


@dataclass(frozen=True)
class Variety:
    """One rig and one watcher.

    Attributes:
        sensor_hz: Samples that the rig sends [1/s].
        looks: Ticks from one look of the gateway to the next, and of the process that estimates. In the
            daemon it is a fixed time: 0.4 ticks at 100 Hz, one at 250 Hz, eight at 2 kHz.
        topics: What the watcher subscribes to; `messages_hz` at most so many a second of each, None all.
    """

    sensor_hz: int = 200
    looks: tuple[int, int] = (1, 1)
    topics: tuple[str, ...] = SAMPLES
    messages_hz: int | None = None


FIRST_VARIED = 100_000
"""Seeds from here on differ: those below stay as they were when they found something."""


def variety(seed: int) -> Variety:
    """That of a seed."""
    if seed < FIRST_VARIED:
        return Variety()
    rng = Random(f"{seed} variety")
    return Variety(
        rng.choice((100, 100, 200)),
        (rng.choice((1, 2, 4)), rng.choice((1, 4, 8, 16))),
        *rng.choice(((SAMPLES, None), (SAMPLES, 10), (("estimate", "event", "health"), None))),
    )
