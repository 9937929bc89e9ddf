"""One axis: from its sensor's sample to a voltage, through the states idle, armed, exciting and holding.

start -> armed (polarity pulse, back to the start position or up to the speed) -> exciting (relay, entered by
a ramp) -> holding (back to where it stood; also the pause between bursts) -> idle. A fault can come from any
state. What is different in position and velocity control is in the axis' `mode`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from drivers.base import NO_SAMPLE, Sample
from seod.config.units import UNITS
from seod.loop.conditions import Conditions
from seod.loop.excite import Coast, Controller, Drive, PolarityPulse, Relay
from seod.loop.guard import AxisGuard, Trip
from seod.loop.position import PositionMode
from seod.loop.sensor import make_sensor
from seod.loop.velocity import VelocityMode
from seod.ring import FLAG_EXCITING, FLAG_FRESH, FLAG_LIMITED, FLAG_SATURATED, AxisState
from seod.settings import configured, refusal

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.config.model import AxisConfig, RigConfig
    from seod.loop.mode import Mode

ACTIVE = frozenset({AxisState.ARMED, AxisState.EXCITING, AxisState.HOLDING})
GROWTH_AFTER_S = 1.0
"""Growth means something once the relay has been at its amplitude for this long."""


class Axis:
    """State, controller and guard of one axis.

    Args:
        name: Name in the rig file.
        rig: The rig file.
        emit: Takes events (JSON-able mappings) for the clients.
    """

    def __init__(self, name: str, rig: RigConfig, emit: Callable[[dict[str, Any]], None]) -> None:
        config = rig.axes[name]
        self.sensor = make_sensor(rig.sensors[config.sensor])
        output = rig.outputs[config.output]
        self.name = name
        self.config: AxisConfig = config
        self.emit = emit
        self.settings = configured(config)
        self.conditions = Conditions(config, rig, self.warn)
        self.mode: Mode = (
            PositionMode(config, self.settings)
            if config.mode == "position"
            else VelocityMode(config, self.settings, self.warn)
        )
        self.guard = AxisGuard(name, config.limits, rig.guard, self.mode.quantity)
        self.guard.sensor = self.sensor
        self.raw_per_volt, self.raw_neutral = output.scale / UNITS[output.unit][1], output.offset
        self.smoothing = (
            1.0
            if config.filter is None
            else 1.0 - math.exp(-2.0 * math.pi * config.filter / rig.loop.rate_hz)
        )
        self.state = AxisState.IDLE
        self.controller: Controller = Coast()
        self.sample: Sample = NO_SAMPLE
        self.fresh = False
        self.y = self.filtered = math.nan
        self.polarity_known = not config.polarity.enabled
        self.started = self.entered = -math.inf
        self.stopping = False
        self.waiting = False
        """For its turn, holding the position; see `seod.loop.turns`."""
        self.driven: tuple[float, float] | None = None
        """Voltage [V] and duration [s] of a drive; None for the relay."""
        self.stays = False
        """Whether a drive ends where it has come to, and not where it began."""
        self.trip: Trip | None = None

    @property
    def active(self) -> bool:
        """The actuator may move."""
        return self.state in ACTIVE

    @property
    def exciting(self) -> bool:
        """The relay, or a drive, is on."""
        return self.state is AxisState.EXCITING

    @property
    def relay(self) -> Relay | None:
        """The relay, while it is on."""
        return self.controller if self.exciting and isinstance(self.controller, Relay) else None

    def sense(self, sample: Sample) -> None:
        """Take the newest sample: scale to SI, low-pass of section 2.3(2)."""
        self.fresh = sample.t != self.sample.t
        self.sample = sample
        if not self.fresh:
            return
        self.y = self.sensor.read(sample.value)
        if math.isfinite(self.filtered):
            self.filtered += self.smoothing * (self.y - self.filtered)
        else:
            self.filtered = self.y
        self.mode.sense(sample.t, self.y, self.filtered)

    def inspect(self, t: float) -> Trip | None:
        """The guard's verdict on the newest sample, while the axis may move."""
        relay = self.relay is not None
        at_amplitude = t - self.entered - self.config.excitation.entry > GROWTH_AFTER_S
        swing = self.mode.swing if relay else None
        return self.guard.inspect(t, self.sample, self.y, swing, relay, at_amplitude)

    def drive(self, t: float, volts: float, duration: float, stay: float = 0) -> str | None:
        """Put out `volts` [V], bias added, for `duration` [s], then hold as after a stop; returns why not.

        With `stay` it is held where the drive has brought it.
        """
        limits = self.config.limits
        if not math.isfinite(volts) or abs(volts) + abs(self.settings["bias"]) > limits.output:
            return f"{self.name}: |volts| + |bias| must be at most limits.output = {limits.output:g} V"
        if not 0.0 < duration <= limits.excitation:
            longest = f"limits.excitation = {limits.excitation:g} s"
            return f"{self.name}: duration must be > 0 and at most {longest}"
        self.stays = bool(stay)
        return self.start(t, (volts, duration))

    def start(self, t: float, driven: tuple[float, float] | None = None, waiting: bool = False) -> str | None:
        """Begin with the relay, with a drive (see `driven`) or by `waiting` for a turn; returns why not."""
        if self.state is AxisState.FAULT:
            return f"{self.name} is in fault: reset first"
        if self.active:
            return f"{self.name} is {self.state.name.lower()} already"
        trip = self.guard.ready(t, self.sample, self.y)
        if trip is not None:
            return trip.why
        if not self.conditions.known:
            return f"{self.name}: K_L is not known: the sensor {self.config.supply_pressure} is silent"
        self.guard.begin()
        self.filtered = self.y
        self.mode.start(self.y)
        self.started, self.stopping, self.trip = t, False, None
        self.driven, self.waiting = driven, waiting
        self._become(AxisState.ARMED, t, "start")
        if not self.polarity_known:
            pulse = self.config.polarity
            height = pulse.pulse or self.settings["e_a"]
            self.controller = PolarityPulse(t, height, pulse.duration, pulse.movement)
        elif self.mode.approaches:
            self._begin_hold(t)
        else:
            self._proceed(t)
        return None

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

    def fault(self, t: float, trip: Trip) -> None:
        """Latch. The loop writes neutral in the same tick."""
        self.guard.neutral(t)
        self.polarity_known = not self.config.polarity.enabled
        if self.state is not AxisState.FAULT:
            self._become(AxisState.FAULT, t, trip.why)

    def reset(self, t: float) -> None:
        """Leave the fault."""
        if self.state is AxisState.FAULT:
            self.trip = None
            self._become(AxisState.IDLE, t, "reset")

    def change(self, values: dict[str, float]) -> str | None:
        """Set what `seod.settings` tells; takes effect at once and without a jump. Returns why not."""
        why = refusal(self.config, self.settings, values)
        if why is not None:
            return f"{self.name}: {why}"
        self.settings.update(values)
        if "K_L" in values:
            self.conditions.set(values["K_L"])
        if isinstance(self.controller, Relay):
            self.controller.e_a = self.settings["e_a"]
            self.controller.hysteresis = self.settings["hysteresis"]
        return None

    def command(self, t: float) -> float:
        """The voltage asked for at `t` [V], before the guard; moves the state on for the next tick."""
        if not self.active:
            return 0.0
        mode, relay = self.mode, self.relay
        mode.advance(t, self.conditions.K_L, relay)
        u = self.controller.step(t, mode.error if relay is None else mode.signal) + mode.bias
        if not math.isfinite(u):
            self.trip = Trip("non_finite", f"{self.name}: the controller asked for {u} V")
            return 0.0
        self._advance(t)
        return u

    def flags(self, t: float, asked: float, passed: float) -> int:
        """Flags of this tick's row."""
        exciting = self.relay is not None and t - self.entered >= self.config.excitation.entry
        return (
            FLAG_EXCITING * exciting
            + FLAG_FRESH * self.fresh
            + FLAG_LIMITED * (asked != passed)
            + FLAG_SATURATED * self.sensor.saturated
        )

    def amplitude(self, t: float) -> float:
        """Relay amplitude in force at `t` [V]; 0 while it is off."""
        relay = self.relay
        return 0.0 if relay is None else relay.amplitude(t)

    def warn(self, code: str, why: str) -> None:
        """Tell the clients of something that does not stop the axis."""
        t = self.sample.t if math.isfinite(self.sample.t) else 0.0
        event = {"event": "warning", "t": t, "axis": self.name, "code": code}
        self.emit({**event, "why": f"{self.name}: {why}"})

    def _advance(self, t: float) -> None:
        if self.state is AxisState.ARMED:
            self._advance_armed(t)
        elif self.state is AxisState.EXCITING:
            self._advance_exciting(t)
        elif self.state is AxisState.HOLDING:
            self._advance_holding(t)

    def _advance_armed(self, t: float) -> None:
        if isinstance(self.controller, PolarityPulse):
            result = self.controller.result
            if result is None:
                return
            self.emit(
                {
                    "event": "polarity",
                    "t": t,
                    "axis": self.name,
                    "ok": result.ok,
                    "movement": result.movement,
                    "voltage": self.controller.voltage,
                    "why": result.why,
                }
            )
            if not result.ok:
                self.trip = Trip("polarity", f"{self.name}: {result.why}", {"movement": result.movement})
                return
            self.polarity_known = True
            self._begin_hold(t)
        elif self.hold_is_over(t):
            self._proceed(t)

    def _advance_exciting(self, t: float) -> None:
        plan, limits = self.config.excitation, self.config.limits
        if t - self.started > limits.excitation:
            self.warn("excitation_budget", f"stopped after limits.excitation = {limits.excitation:g} s")
            self.stop(t, "excitation budget used up")
        elif isinstance(self.controller, Drive):
            if t >= self.controller.end:
                if self.stays:
                    self.mode.start(self.y)
                self.stop(t, "drive over")
        elif plan.kind == "burst" and t - self.entered >= plan.entry + plan.duration:
            self._return(t, "burst over")

    def _advance_holding(self, t: float) -> None:
        plan = self.config.excitation
        over = self.hold_is_over(t)
        if self.stopping:
            if over:
                self._become(AxisState.IDLE, t, f"back at the {self.mode.quantity} at start")
        elif over and not self.waiting and t - self.entered >= plan.pause:
            self._excite(t)

    def _proceed(self, t: float) -> None:
        if self.waiting:
            self._return(t, "waiting for its turn")
        else:
            self._excite(t)

    def _excite(self, t: float) -> None:
        entry = self.config.excitation.entry
        if self.driven is not None:
            volts, duration = self.driven
            self.controller = Drive(t + duration, volts)
            self._become(AxisState.EXCITING, t, f"drive: {volts:g} V for {duration:g} s")
            return
        self.controller = Relay(t, entry, self.settings["e_a"], self.settings["hysteresis"])
        self.mode.relay_on(t)
        self.entered = t
        self._become(AxisState.EXCITING, t, "relay on")

    def _return(self, t: float, why: str) -> None:
        self._begin_hold(t)
        self._become(AxisState.HOLDING, t, why)

    def _begin_hold(self, t: float) -> None:
        self.controller = self.mode.hold(t, rest=self.stopping or self.waiting or self.driven is not None)
        self.entered = t

    def hold_is_over(self, t: float) -> bool:
        """Whether the axis is where it should be, or has tried for long enough."""
        return self.mode.arrived(t)

    def _become(self, state: AxisState, t: float, why: str) -> None:
        previous, self.state = self.state, state
        self.emit(
            {
                "event": "state",
                "t": t,
                "axis": self.name,
                "state": state.name.lower(),
                "previous": previous.name.lower(),
                "why": why,
            }
        )
