"""One axis: from its sensor's sample to a voltage. What it does, and what comes next, is its `course`'s."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivers.base import NO_SAMPLE, Sample
from seod.config.gain_in_force import is_identified
from seod.config.settings import configured, refusal
from seod.config.units import UNITS
from seod.loop import events
from seod.loop.conditions import Conditions
from seod.loop.course import Course, Push
from seod.loop.guard import AxisGuard, Trip
from seod.loop.position import PositionMode
from seod.loop.sensor import make_sensor
from seod.loop.tones import Tones, read_tones
from seod.loop.velocity import VelocityMode
from seod.processes.ring import (
    FLAG_EXCITING,
    FLAG_FOREIGN,
    FLAG_FRESH,
    FLAG_LIMITED,
    FLAG_SATURATED,
    FLAG_SECOND_PHASE,
    AxisState,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.config.axis import AxisConfig
    from seod.config.model import RigConfig
    from seod.loop.mode import Mode

GROWTH_AFTER_S = 1.0
"""Growth means something once the relay has been at its amplitude for this long."""


class Axis:
    """Sensor, set point, controller and guard of one axis.

    Args:
        name: Name in the rig file.
        rig: The rig file.
        emit: Takes events for the clients.
    """

    def __init__(self, name: str, rig: RigConfig, emit: Callable[[events.Event], None]) -> None:
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
        self.course = Course(name, config, self.settings, self.mode, emit)
        self.guard = AxisGuard(name, config.limits, rig.guard, self.mode.quantity)
        self.guard.sensor = self.sensor
        self.raw_per_volt, self.raw_neutral = output.scale / UNITS[output.unit][1], output.offset
        self.smoothing = (
            1.0
            if config.filter is None
            else 1.0 - math.exp(-2.0 * math.pi * config.filter / rig.loop.rate_hz)
        )
        self.sample: Sample = NO_SAMPLE
        self.fresh = False
        self.y = self.filtered = math.nan
        self.trip: Trip | None = None
        """What this tick's command found wrong."""
        self.foreign = False
        """Somebody else commanded the rig shortly before."""

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
        course = self.course
        relay = course.relay
        on = relay is not None
        at_amplitude_s = t - course.entered - self.config.excitation.entry if on else -math.inf
        swing = self.mode.swing if on or isinstance(course.controller, Tones) else None
        side = relay.sign if relay is not None and at_amplitude_s >= 0.0 and self.mode.has_ends else 0.0
        trip = self.guard.inspect(t, self.sample, self.y, swing, on, at_amplitude_s > GROWTH_AFTER_S, side)
        if trip is None:
            course.phases.watch(t, course.relay, self.guard.amplitude)
        return trip

    def second_phase(self, t: float, **values: float) -> str | None:
        """Have a second phase of the relay (`SecondPhase`); returns why not."""
        return self.course.phases.take(t, self.course.relay, values)

    def drive(
        self,
        t: float,
        volts: float,
        duration: float,
        stay: bool = False,
        tones: Sequence[Sequence[float]] = (),
    ) -> str | None:
        """Put out `volts` [V], bias added, for `duration` [s], then hold as after a stop; returns why not.

        With `stay` it is held where the drive has brought it. `tones`, [Hz, V, rad] each, take the place of
        the steady voltage, clipped at `volts`.
        """
        limits, unit = self.config.limits, self.config.command_unit
        if not math.isfinite(volts) or abs(volts) + abs(self.settings["bias"]) > limits.output:
            return f"{self.name}: |volts| + |bias| must be at most limits.output = {limits.output:g} {unit}"
        if not 0.0 < duration <= limits.excitation:
            longest = f"limits.excitation = {limits.excitation:g} s"
            return f"{self.name}: duration must be > 0 and at most {longest}"
        try:
            return self.start(t, Push(volts, duration, stay, read_tones(tones)))
        except ValueError as error:
            return f"{self.name}: {error}"

    def start(self, t: float, push: Push | None = None, waiting: bool = False) -> str | None:
        """Begin with the relay, with a drive or by `waiting` for a turn; returns why not."""
        why = self._unready(t)
        if why is None:
            self.guard.begin()
            self.filtered = self.y
            self.mode.start(self.y)
            self.course.begin(t, push, waiting)
        return why

    def _unready(self, t: float) -> str | None:
        if self.course.state is AxisState.FAULT:
            return f"{self.name} is in fault: reset first"
        if self.course.active:
            return f"{self.name} is {self.course.state.name.lower()} already"
        trip = self.guard.ready(t, self.sample, self.y)
        if trip is not None:
            return trip.why
        if not self.conditions.known:
            return f"{self.name}: K_L is not known: the sensor {self.config.supply_pressure} is silent"
        return None

    def fault(self, t: float, trip: Trip) -> None:
        """Latch. The loop writes neutral in the same tick."""
        self.guard.neutral(t)
        self.course.fault(t, trip.why)

    def change(self, t: float, values: dict[str, float]) -> str | None:
        """Set what `seod.config.settings` tells; takes effect at once and without a jump. Returns why not."""
        why = refusal(self.config, self.settings, values)
        if why is not None:
            return f"{self.name}: {why}"
        self.settings.update(values)
        if "K_L" in values:
            if is_identified(self.config.K_L):
                self.mode.absorb(values["K_L"])
            self.conditions.set(values["K_L"])
        self.guard.settings_changed()
        relay = self.course.relay
        if relay is not None:
            relay.e_a, relay.hysteresis = self.settings["e_a"], self.settings["hysteresis"]
        if values.keys() - {"K_L", "trim"}:  # the second phase was chosen for other settings
            self.course.phases.drop(t, relay, "settings", "other settings: the first phase goes on")
        return None

    def command(self, t: float) -> float:
        """The voltage asked for at `t` [V], before the guard; moves the state on for the next tick."""
        course, mode = self.course, self.mode
        if not course.active:
            return 0.0
        relay = course.relay
        mode.advance(t, self.conditions.K_L, relay)
        u = course.controller.step(t, mode.error if relay is None else mode.signal) + mode.bias
        if not math.isfinite(u):
            self.trip = Trip(
                "non_finite", f"{self.name}: the controller asked for {u} {self.config.command_unit}"
            )
            return 0.0
        self.trip = course.advance(t, self.y)
        return u

    def flags(self, t: float, asked: float, passed: float) -> int:
        """Flags of this tick's row."""
        course = self.course
        exciting = course.relay is not None and t - course.entered >= self.config.excitation.entry
        return (
            FLAG_EXCITING * exciting
            + FLAG_FRESH * self.fresh
            + FLAG_LIMITED * (asked != passed)
            + FLAG_SATURATED * self.sensor.saturated
            + FLAG_SECOND_PHASE * (exciting and course.relay is not None and course.relay.second)
            + FLAG_FOREIGN * self.foreign
        )

    def amplitude(self, t: float) -> float:
        """Relay amplitude in force at `t` [V]; 0 while it is off."""
        relay = self.course.relay
        return 0.0 if relay is None else relay.amplitude(t)

    def warn(self, code: str, why: str) -> None:
        """Tell the clients of something that does not stop the axis."""
        t = self.sample.t if math.isfinite(self.sample.t) else 0.0
        self.emit(events.warning(t, self.name, code, f"{self.name}: {why}"))
