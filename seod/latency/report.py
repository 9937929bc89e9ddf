"""How late this machine wakes a program up, what that means for a rig, and what to change. Pure analysis.

A latency is the time between the instant a program asked to be woken at and the instant it ran. All are whole
microseconds, rounded down, as cyclictest counts them.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

    from seod.latency.machine import Machine

BAR = 22
"""Longest bar of the text histogram [characters]."""

BANDS = (
    (20, "very good", "enough for any rate up to 10 kHz"),
    (50, "good", "enough for 2 kHz with ease, and for several kHz"),
    (
        500,
        "acceptable",
        "enough for 2 kHz: a late tick costs part of a period, and estimators know when it acted",
    ),
    (math.inf, "not good enough", "too late for a rig at 2 kHz until something below is changed"),
)
"""Upper limit of the worst latency [us], verdict, meaning. LinuxCNC's bands; "good" lies between what its
documentation calls very good and what it calls acceptable."""


@dataclass(frozen=True)
class Latencies:
    """Latencies of one program.

    Attributes:
        source: What was measured, for people.
        counts: Number of wake-ups by whole microseconds.
    """

    source: str
    counts: Counter[int] = field(default_factory=Counter)

    @property
    def total(self) -> int:
        """Number of wake-ups."""
        return self.counts.total()

    @property
    def worst(self) -> int:
        """Largest latency [us]."""
        return max(self.counts, default=0)

    def quantile(self, fraction: float) -> int:
        """The latency [us] that this fraction of the wake-ups did not exceed."""
        reached = 0
        for us in sorted(self.counts):
            reached += self.counts[us]
            if reached >= fraction * self.total:
                return us
        return 0

    def late(self, period_us: float) -> int:
        """Number of wake-ups that were more than a period late."""
        return sum(count for us, count in self.counts.items() if us >= period_us)

    def __add__(self, other: Latencies) -> Latencies:
        return Latencies(self.source, self.counts + other.counts)

    def as_json(self) -> dict[str, Any]:
        """Percentiles and histogram [us]."""
        quantiles = {
            f"p{name}_us": self.quantile(f) for name, f in (("50", 0.5), ("99", 0.99), ("999", 0.999))
        }
        bins = [[us, self.counts[us]] for us in sorted(self.counts)]
        return {
            "source": self.source,
            "samples": self.total,
            **quantiles,
            "max_us": self.worst,
            "counts": bins,
        }


def count_seconds(source: str, seconds: Iterable[float]) -> Latencies:
    """Latencies from times in s."""
    return Latencies(source, Counter(max(0, int(s * 1e6)) for s in seconds))


def parse_cyclictest(text: str) -> Latencies:
    """The histogram that `cyclictest -q -h US` prints; what lies beyond it counts as the largest latency.

    Raises:
        ValueError: No histogram in it.
    """
    counts = Counter({int(us): int(n) for us, n in re.findall(r"^(\d{6}) (\d{6,})\s*$", text, re.MULTILINE)})
    beyond = re.search(r"^# Histogram Overflows: (\d+)", text, re.MULTILINE)
    largest = re.search(r"^# Max Latencies: (\d+)", text, re.MULTILINE)
    if beyond and largest:
        counts[int(largest[1])] += int(beyond[1])
    counts += Counter()  # drops empty bins
    if not counts:
        raise ValueError("cyclictest printed no histogram")
    return Latencies("cyclictest", counts)


def band(worst_us: float) -> tuple[str, str]:
    """Verdict on a worst latency [us], and what it means for a rig."""
    return next((verdict, enough) for limit, verdict, enough in BANDS if worst_us < limit)


def histogram(left: Latencies, right: Latencies) -> str:
    """Both side by side, an octave of microseconds a line; bars are logarithmic: one late tick shows."""
    octaves = [Counter[int]() for _ in range(2)]
    for octave, latencies in zip(octaves, (left, right), strict=True):
        for us, count in latencies.counts.items():
            octave[us.bit_length()] += count
    longest = math.log1p(max([1, *octaves[0].values(), *octaves[1].values()]))
    width = BAR + 9
    lines = [f"{'us':>13}  {left.source:<{width}}  {right.source}"]
    used = octaves[0].keys() | octaves[1].keys()
    for k in range(min(used, default=0), max(used, default=-1) + 1):
        cells = [f"{octave[k]:>8} {'#' * round(BAR * math.log1p(octave[k]) / longest)}" for octave in octaves]
        low, high = (1 << k) >> 1, 1 << k
        lines.append(f"{low:>5} - {high:<5}  {cells[0]:<{width}}  {cells[1]}".rstrip())
    return "\n".join(lines)


def summary(latencies: Latencies) -> str:
    """Percentiles in one line."""
    q = latencies.quantile
    return (
        f"{latencies.source:<24} p50 {q(0.5):>5}   p99 {q(0.99):>5}   p99.9 {q(0.999):>5}   "
        f"worst {latencies.worst:>6}  [us], {latencies.total} wake-ups"
    )


@dataclass(frozen=True)
class Report:
    """All that `seod latency` says.

    Attributes:
        machine: A bare timer's latencies.
        loop: Those of the loop.
        rate_hz: Rate of both.
        refusals: What the machine refused the loop's process, as sentences.
        state: What the machine is.
        note: Why the machine's latencies are not cyclictest's ("" where they are).
    """

    machine: Latencies
    loop: Latencies
    rate_hz: float
    refusals: list[str]
    state: Machine
    note: str = ""

    def advice(self) -> list[str]:
        """What to change, one sentence each, with the command."""
        return [*self.refusals, *self.state.advice()]

    def as_json(self) -> dict[str, Any]:
        """The report for programs."""
        return {
            "rate_hz": self.rate_hz,
            "machine": self.machine.as_json(),
            "loop": self.loop.as_json(),
            "verdict": {"machine": band(self.machine.worst)[0], "loop": band(self.loop.worst)[0]},
            "late_ticks": self.loop.late(1e6 / self.rate_hz),
            "realtime": {"ok": not self.refusals, "why": self.refusals},
            "system": self.state.describe(),
            "note": self.note or None,
            "advice": self.advice(),
        }

    def as_text(self) -> str:
        """The report for people."""
        verdicts = [band(side.worst)[0] for side in (self.machine, self.loop)]
        late, period_us = self.loop.late(1e6 / self.rate_hz), 1e6 / self.rate_hz
        lines = [
            self.state.describe(),
            *filter(None, [self.note]),
            "",
            histogram(self.machine, self.loop),
            "",
        ]
        lines += [summary(self.machine), summary(self.loop), ""]
        lines += [
            f"By their worst, the machine is {verdicts[0]} and the loop {verdicts[1]}: "
            f"{band(self.loop.worst)[1]}.",
            f"{late} of {self.loop.total} ticks began more than a period ({period_us:.0f} us) late.",
        ]
        advice = self.advice()
        lines += ["", "To change:"] if advice else ["", "Nothing to change."]
        return "\n".join([*lines, *(f"- {sentence}" for sentence in advice)])
