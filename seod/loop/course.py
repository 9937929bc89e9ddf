"""The course of one axis from start to rest: its states, what leads from one to the next, the controller.

start -> armed (polarity pulse, back to the start position or up to the speed) -> exciting (relay, entered by
a ramp) -> holding (back to where it stood; also the pause between bursts) -> idle. A fault can come from any
state. What is different in position and velocity control is in the axis' `mode`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from seod.loop import events
from seod.loop.excite import Coast, Controller, Drive, PolarityPulse
from seod.loop.guard import Trip
from seod.loop.tones import Tone, Tones
from seod.loop.two_phase import TwoPhaseRelay, TwoPhases
from seod.processes.ring import AxisState

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.config.axis import AxisConfig
    from seod.loop.mode import Mode

ACTIVE = frozenset({AxisState.ARMED, AxisState.EXCITING, AxisState.HOLDING})


class Push(NamedTuple):
    """A drive as it was asked for.

    Attributes:
        volts: Voltage, or with tones the largest of their sum [V].
        duration: [s].
        stay: It ends where it has come to.
        tones: For a frequency response, in velocity mode about the reference; none for a steady voltage.
    """

    volts: float
    duration: float
    stay: bool
    tones: tuple[Tone, ...] = ()


class Course:
    """State and controller of one axis.

    Args:
        name: The axis, for messages.
        config: Its section of the rig file.
        settings: Its settings in force; the axis changes them.
        mode: Position or velocity control.
        emit: Takes events for the clients.

    Attributes:
        state: Changed by `_become` alone, which keeps the three that follow from it.
        active: The actuator may move.
        exciting: The relay, or a drive, is on.
        relay: The relay, while it is on.
        controller: In force.
        entered: When the state, or what it consists of, began [s].
        waiting: For its turn, holding the position; see `seod.loop.turns`.
        stopping: On the way to idle.
        phases: The second phase of the relay, kept from burst to burst.
        pushed: The drive that takes the relay's place; None for the relay.
    """

    def __init__(
        self,
        name: str,
        config: AxisConfig,
        settings: dict[str, float],
        mode: Mode,
        emit: Callable[[events.Event], None],
    ) -> None:
        self.name, self.config, self.settings, self.mode, self.emit = name, config, settings, mode, emit
        self.state = AxisState.IDLE
        self.active = self.exciting = False
        self.relay: TwoPhaseRelay | None = None
        self.controller: Controller = Coast()
        self.polarity_known = not config.polarity.enabled
        self.started = self.entered = -math.inf
        self.stopping = self.waiting = False
        self.pushed: Push | None = None
        self.phases = TwoPhases(name, config.limits, settings, emit)

    def begin(self, t: float, push: Push | None, waiting: bool) -> None:
        """Start, with the relay or with a drive, or `waiting` for a turn."""
        self.started, self.stopping = t, False
        self.pushed, self.waiting = push, waiting
        self.phases.drop(t, None, "start", "start: to be chosen anew")
        self._become(AxisState.ARMED, t, "start")
        if not self.polarity_known:
            pulse = self.config.polarity
            height = pulse.pulse or self.settings["e_a"]
            self.controller = PolarityPulse(
                t,
                height,
                pulse.duration,
                pulse.movement,
                lambda: self.mode.t_sample,
                self.config.output,
                self.config.command_unit,
            )
        elif self.mode.approaches:
            self._begin_hold(t)
        else:
            self._proceed(t)

    def stop(self, t: float, why: str = "stop") -> None:
        """End the excitation and go back to where the axis stood at start."""
        self.stopping = True
        if self.state in (AxisState.ARMED, AxisState.EXCITING):
            self._return(t, why)

    def wait(self, t: float, why: str) -> None:
        """Turn the relay off and hold the position at start until `go_on`."""
        self.waiting = True
        self._return(t, why)

    def go_on(self, t: float) -> None:
        """Have the turn: the relay on at once, or after what has to come before it."""
        self.waiting = False
        if self.mode.approaches and not isinstance(self.controller, PolarityPulse):
            self._begin_hold(t)
        elif self.state is AxisState.HOLDING:
            self._excite(t)

    def fault(self, t: float, why: str) -> None:
        """Latch; the polarity has to be shown anew."""
        self.polarity_known = not self.config.polarity.enabled
        if self.state is not AxisState.FAULT:
            self.phases.drop(t, None, "fault", why)
            self._become(AxisState.FAULT, t, why)

    def reset(self, t: float) -> None:
        """Leave the fault."""
        if self.state is AxisState.FAULT:
            self._become(AxisState.IDLE, t, "reset")

    def advance(self, t: float, y: float) -> Trip | None:
        """Move on, once a tick, where the axis measures `y`; returns what makes it a fault."""
        if self.state is AxisState.EXCITING:
            self._advance_exciting(t, y)
        elif self.state is AxisState.HOLDING:
            self._advance_holding(t)
        elif isinstance(self.controller, PolarityPulse):
            return self._advance_pulse(t, self.controller)
        elif self.hold_is_over(t):
            self._proceed(t)
        return None

    def hold_is_over(self, t: float) -> bool:
        """Whether the axis is where it should be, or has tried for long enough."""
        return self.mode.arrived(t)

    def _advance_pulse(self, t: float, pulse: PolarityPulse) -> Trip | None:
        result = pulse.result
        if result is None:
            return None
        self.emit(events.polarity(t, self.name, result, pulse.voltage))
        if not result.ok:
            return Trip("polarity", f"{self.name}: {result.why}", {"movement": result.movement})
        self.polarity_known = True
        self._begin_hold(t)
        return None

    def _advance_exciting(self, t: float, y: float) -> None:
        plan, budget = self.config.excitation, self.config.limits.excitation
        if t - self.started > budget:
            why = f"{self.name}: stopped after limits.excitation = {budget:g} s"
            self.emit(events.warning(t, self.name, "excitation_budget", why))
            self.stop(t, "excitation budget used up")
        elif isinstance(self.controller, Drive):
            if t >= self.controller.end:
                if self.pushed and self.pushed.stay:
                    self.mode.start(y)
                self.stop(t, "drive over")
        elif plan.kind == "burst" and t - self.entered >= plan.entry + plan.duration:
            self._return(t, "burst over")

    def _advance_holding(self, t: float) -> None:
        over = self.hold_is_over(t)
        if self.stopping:
            if over:
                self._become(AxisState.IDLE, t, f"back at the {self.mode.quantity} at start")
        elif over and not self.waiting and t - self.entered >= self.config.excitation.pause:
            self._excite(t)

    def _proceed(self, t: float) -> None:
        if self.waiting:
            self._return(t, "waiting for its turn")
        else:
            self._excite(t)

    def _excite(self, t: float) -> None:
        if self.pushed is not None:
            self._drive(t, self.pushed)
            return
        entry = self.config.excitation.entry
        e_a, hysteresis = self.settings["e_a"], self.settings["hysteresis"]
        self.controller = TwoPhaseRelay(t, entry, e_a, hysteresis, self.phases.phase)
        self.mode.relay_on(t)
        self.entered = t
        self._become(AxisState.EXCITING, t, "relay on")

    def _drive(self, t: float, push: Push) -> None:
        end, what = t + push.duration, "drive"
        if push.tones:
            hold, entry = self.mode.hold(t, rest=False), self.config.excitation.entry
            self.controller = Tones(t, end, entry, push.volts, push.tones, hold)
            what = f"{len(push.tones)} tones"
        else:
            self.controller = Drive(end, push.volts)
        self._become(
            AxisState.EXCITING,
            t,
            f"{what}: {push.volts:g} {self.config.command_unit} for {push.duration:g} s",
        )

    def _return(self, t: float, why: str) -> None:
        self._begin_hold(t)
        self._become(AxisState.HOLDING, t, why)

    def _begin_hold(self, t: float) -> None:
        steady = self.pushed is not None and not self.pushed.tones
        self.controller = self.mode.hold(t, rest=self.stopping or self.waiting or steady)
        self.entered = t

    def _become(self, state: AxisState, t: float, why: str) -> None:
        previous, self.state = self.state, state
        self.active = state in ACTIVE
        self.exciting = state is AxisState.EXCITING
        self.relay = self.controller if self.exciting and isinstance(self.controller, TwoPhaseRelay) else None
        self.emit(events.state(t, self.name, state, previous, why))
