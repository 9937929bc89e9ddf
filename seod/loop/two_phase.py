"""Two-phase excitation: some cycles as they are, as many with each switch late, and so on.

One phase cannot tell gain from damping, for both set the amplitude; another frequency can. How late, the
gateway chooses from its first estimate (`seod.estimate.two_phase.second_phase`), and it foretells how far the
axis will swing; where it swings farther the first phase is back before any limit is reached.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from seod.loop import events
from seod.loop.excite import Relay

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from seod.config.axis import LimitsConfig

SAME_PERIOD = 0.5
"""Part of a period that a cycle lasts at least: what noise switches in between is none."""


class SecondPhase(NamedTuple):
    """What was chosen for an axis.

    Attributes:
        late: How long after the crossing each switch comes [s].
        cycles: Of each phase.
        period: Of the first phase [s].
        e_a: Amplitude of the relay that it was chosen for [V].
        swing: Half the peak-to-peak movement beyond which it is given up [axis unit].
    """

    late: float
    cycles: float
    period: float
    e_a: float
    swing: float


class TwoPhaseRelay(Relay):
    """A relay that has a second phase as soon as one is chosen.

    Args:
        start, entry, e_a, hysteresis: As of `Relay`.
        phase: The second phase, None for none yet.
    """

    def __init__(
        self, start: float, entry: float, e_a: float, hysteresis: float, phase: SecondPhase | None = None
    ) -> None:
        super().__init__(start, entry, e_a, hysteresis)
        self.phase = phase
        self.wanted = 1.0
        self.due = self.began = -math.inf
        self.late = 0.0
        self.count = 0

    @property
    def second(self) -> bool:
        """Whether the second phase is on."""
        return self.late > 0.0

    @property
    def turning(self) -> bool:
        """Whether the cycle that has just ended was one between the phases: its halves differ."""
        return self.phase is not None and self.count == 0

    def take(self, phase: SecondPhase | None) -> None:
        """Have another second phase from the next cycle on, or none from now on."""
        self.phase = phase
        if phase is None:
            self.late, self.due = 0.0, -math.inf
        elif not self.second:
            self.count = max(self.count, int(phase.cycles))  # the first estimate has seen enough of the first

    def step(self, t: float, e: float) -> float:
        """Switch where the error has crossed the hysteresis, or so much later."""
        wanted = 1.0 if e > self.hysteresis else -1.0 if e < -self.hysteresis else self.wanted
        if wanted != self.wanted:
            self.wanted = wanted
            if wanted > 0.0:
                self._end_cycle(t)
            self.due = t + self.late
        if t >= self.due:
            self.sign = self.wanted
        return self.sign * self.amplitude(t)

    def _end_cycle(self, t: float) -> None:
        phase = self.phase
        if phase is None or t - self.began < SAME_PERIOD * phase.period:
            return
        self.began = t
        self.count += 1
        if self.count >= phase.cycles:
            self.count, self.late = 0, 0.0 if self.second else phase.late


class TwoPhases:
    """The second phase of one axis: taken, watched and given up.

    Args:
        name: The axis, for messages.
        limits: Its limits.
        settings: Its settings in force; the axis changes them.
        emit: Takes events for the clients.
    """

    def __init__(
        self,
        name: str,
        limits: LimitsConfig,
        settings: dict[str, float],
        emit: Callable[[events.Event], None],
    ) -> None:
        self.name, self.limits, self.settings, self.emit = name, limits, settings, emit
        self.phase: SecondPhase | None = None

    def take(self, t: float, relay: TwoPhaseRelay | None, values: Mapping[str, float]) -> str | None:
        """Have a second phase, from the next cycle on; returns why not."""
        phase = SecondPhase(**values)
        why = self._refusal(relay, phase)
        if why is None and relay is not None:
            self.phase = phase
            relay.take(phase)
            what = f"every {phase.cycles:g} cycles, as many with each switch {phase.late * 1e3:.2f} ms late"
            self.emit(events.two_phase(t, self.name, phase._asdict(), "chosen", what))
        return why

    def _refusal(self, relay: TwoPhaseRelay | None, phase: SecondPhase) -> str | None:
        if relay is None or not self.settings["two_phase"]:
            return f"{self.name}: the relay is off, or two_phase is"
        if phase.e_a != self.settings["e_a"]:
            return f"{self.name}: e_a is another by now"
        if not 0.0 < phase.late < 0.5 * phase.period < math.inf or phase.cycles < 1.0:
            return f"{self.name}: a second phase must be late by less than half a period, for whole cycles"
        if not 0.0 < phase.swing <= self.limits.amplitude:
            return f"{self.name}: a second phase may swing by at most limits.amplitude"
        return None

    def watch(self, t: float, relay: TwoPhaseRelay | None, swing: float) -> None:
        """Give the second phase up where the axis swings farther than was foreseen."""
        if relay is not None and relay.second and self.phase is not None and swing > self.phase.swing:
            why = f"it swings by {swing:.4g}, farther than foreseen: the first phase goes on"
            self.drop(t, relay, "swing", why)

    def drop(self, t: float, relay: TwoPhaseRelay | None, code: str, why: str) -> None:
        """Be in the first phase from now on, until another second phase is taken."""
        if relay is not None:
            relay.take(None)
        if self.phase is not None:
            self.phase = None
            self.emit(events.two_phase(t, self.name, None, code, why))
