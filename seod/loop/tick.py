"""The loop process: one tick after another, in real time. Everything slow is in the gateway process.

`Loop.tick` is the whole of it, in order; time is passed in, only the pacer reads a clock.
"""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any

from seod.config.sensors import index_channel
from seod.loop import events, guard
from seod.loop.axis import Axis
from seod.loop.channels import condition_channels, input_channels
from seod.loop.guard import Trip
from seod.loop.meter import TickMeter
from seod.loop.rowlog import RowLog
from seod.loop.turns import Turns
from seod.ring import AxisState, Word

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivers.base import Driver, Sample
    from seod.config.model import RigConfig
    from seod.loop.pacer import Pacer
    from seod.ring import Shared

FENCED = 3
"""Exit code of a loop that found itself fenced."""


class Loop:
    """Driver, axes and guard, ticking.

    Args:
        config: The rig file.
        driver: Opened and started.
        shared: Where rows and events go.
        pacer: Says when to tick.
        generation: Number of this loop process; it may write only while it is above the fence.
        on_fence: What to do when fenced; must not return.
    """

    def __init__(
        self,
        config: RigConfig,
        driver: Driver,
        shared: Shared,
        pacer: Pacer,
        generation: int,
        on_fence: Callable[[], None] = lambda: os._exit(FENCED),
    ) -> None:
        self.config = config
        self.driver = driver
        self.shared = shared
        self.pacer = pacer
        self.generation = generation
        self.on_fence = on_fence
        self.period = 1.0 / config.loop.rate_hz
        self.axes = [Axis(name, config, shared.events.put) for name in config.axes]
        channels = input_channels(config)
        self.sensor_of = [channels.index(config.sensors[a.config.sensor].channel) for a in self.axes]
        self.conditions_of = [
            (axis.conditions, slow)
            for axis in self.axes
            if (slow := condition_channels(config, axis.config, channels)) != [None, None]
        ]
        self.marks = [
            (axis.sensor, channels.index(channel))
            for axis in self.axes
            if (channel := index_channel(config.sensors[axis.config.sensor])) is not None
        ]
        estop = config.guard.estop
        self.estop_index = None if estop is None else channels.index(estop.channel)
        self.overruns = guard.OverrunGuard(config.guard.overruns.count, config.guard.overruns.window)
        self.keepalive = -math.inf
        self.pending: Trip | None = None
        self.trouble = ""
        self.samples: Sequence[Sample] = ()
        self.turns = Turns(config.excitation.turn)
        self.log = RowLog(shared, self.axes)
        self.meter = TickMeter(shared, driver, self.period)
        self.in_force = pacer.now(), [0.0] * len(self.axes)
        self.ending = False
        shared.commands.skip_to_head()
        shared.words[Word.GENERATION] = generation

    def run(self) -> None:
        """Tick until told to end; neutral at the end, whatever ended it."""
        try:
            while not self.ending:
                t = self.pacer.next()
                self.tick(t)
                self.meter.note(t, self.pacer, self.samples)
        except Exception as error:
            self.fault(
                self.pacer.now(), Trip("exception", f"the loop failed: {type(error).__name__}: {error}")
            )
            raise
        finally:
            self.finish()

    def tick(self, t: float) -> None:
        """Read, sense, obey, guard, command, guard, write, log: at time `t` [s]."""
        self.samples = self.driver.read(t)
        self.log.flush(self.driver.left())
        for sensor, index in self.marks:
            sensor.mark(self.samples[index].value)
        for axis, index in zip(self.axes, self.sensor_of, strict=True):
            axis.sense(self.samples[index])
        for conditions, slow in self.conditions_of:
            conditions.sense(t, *[None if index is None else self.samples[index] for index in slow])
        self.obey(t)
        self.inspect(t)
        self.turns.step(t)
        asked = [axis.command(t) for axis in self.axes]
        self.inspect_commands(t)
        left, volts = self.write(t, asked)
        self.log.keep(t, left, asked, volts)

    def inspect(self, t: float) -> None:
        """The guard's verdict before anything is commanded: on the rig, then on each axis that may move."""
        trip = self.inspect_rig(t)
        if trip is not None:
            self.fault(t, trip)
        for axis in self.axes:
            if axis.course.active and (trip := axis.inspect(t)) is not None:
                self.fault(t, trip, axis)

    def inspect_rig(self, t: float) -> Trip | None:
        """What concerns all axes."""
        trip, self.pending = self.pending, None
        late = self.overruns.inspect(t, self.pacer.lateness, self.period)
        if self.driver.trouble != self.trouble:
            self.note_trouble(t)
        if trip is not None or not [axis for axis in self.axes if axis.course.active]:
            return trip
        return (
            guard.hung(self.pacer.lateness, self.config.loop.hang_timeout)
            or (Trip("link", f"the rig cannot be reached: {self.trouble}") if self.trouble else None)
            or self.estop(t)
            or late
            or guard.dead_man(self.config.guard.dead_man, t, self.keepalive)
        )

    def inspect_commands(self, t: float) -> None:
        """What the controllers found wrong while they computed their commands."""
        for axis in self.axes:
            if axis.course.active and axis.trip is not None:
                self.fault(t, axis.trip, axis)

    def write(self, t: float, asked: list[float]) -> tuple[float, list[float]]:
        """Send what the guard passes, or neutral; returns the command in force: when it left [s], volts."""
        if self.shared.words[Word.FENCE] >= self.generation:
            self.on_fence()
        volts, raw, moving = [], [], False
        for axis, u in zip(self.axes, asked, strict=True):
            volt = 0.0
            if axis.course.active:
                moving, volt = True, axis.guard.pass_command(t, u)
            volts.append(volt)
            raw.append(axis.raw_neutral + axis.raw_per_volt * volt)
        left = self.driver.write(t, raw) if moving else self.driver.neutral(t)
        self.shared.words[Word.COMMANDS_SENT] = self.driver.commands_sent
        if not math.isnan(left):  # else nothing left, and the command before is still in force
            self.in_force = left, volts
        return self.in_force

    def obey(self, t: float) -> None:
        """Carry out the commands that came through the mailbox, and answer each."""
        for message in self.shared.commands.take():
            error = self.carry_out(t, message)
            self.shared.events.put(
                {"event": "reply", "id": message["id"], "ok": error is None, "error": error}
            )

    def carry_out(self, t: float, message: dict[str, Any]) -> str | None:
        """One command; returns why it was not done."""
        chosen = self.axes if message["axis"] is None else [self.axes[message["axis"]]]
        op = message["op"]
        if op == "keepalive":
            self.keepalive = t
        elif op == "estop":
            self.pending = Trip("estop", "e-stop by a client")
        elif op == "start":
            in_turn = message["axis"] is None and self.config.excitation.order == "in_turn"
            return self.start(t, chosen, in_turn)
        elif op == "drive":
            return self.start(t, chosen, **message["values"])
        elif op == "stop":
            for axis in chosen:
                axis.course.stop(t)
        elif op == "reset":
            for axis in chosen:
                axis.course.reset(t)
        else:
            return self.adjust(t, chosen, op, message["values"])
        return None

    def adjust(self, t: float, chosen: list[Axis], op: str, values: dict[str, float]) -> str | None:
        """A command that leaves the axes in their states; returns why it was not done."""
        if op == "set":
            return self.change(t, chosen, values)
        if op == "second_phase":
            return chosen[0].second_phase(t, **values)
        return f"unknown command {op!r}"

    def start(self, t: float, chosen: list[Axis], in_turn: bool = False, **drive: Any) -> str | None:
        """Start axes, or drive them (`Axis.drive`), all or none; returns why not."""
        estop = self.estop(t)
        if self.trouble or estop is not None:
            return self.trouble or (estop.why if estop else None)
        self.keepalive = t
        started: list[Axis] = []
        for axis in chosen:
            waiting = in_turn and axis is not chosen[0]
            error = axis.drive(t, **drive) if drive else axis.start(t, waiting=waiting)
            if error is not None:
                for other in started:
                    other.course.stop(t, "another axis could not start")
                return error
            started.append(axis)
        if in_turn:
            self.turns.begin([axis.course for axis in chosen])
        return None

    def change(self, t: float, chosen: list[Axis], values: dict[str, float]) -> str | None:
        """Set values on axes; returns why not."""
        for axis in chosen:
            error = axis.change(t, values)
            if error is not None:
                return error
            self.shared.events.put({"event": "changed", "t": t, "axis": axis.name, "values": values})
        return None

    def fault(self, t: float, trip: Trip, axis: Axis | None = None) -> None:
        """Latch the axis whose fault it is, or all of them; of each axis the first reason is the one told."""
        alone = axis is not None and self.config.guard.fault_policy == "axis"
        chosen = [axis] if axis is not None and alone else self.axes
        latched = [each for each in chosen if each.course.state is not AxisState.FAULT]
        if latched:
            told = events.fault(t, axis.name if axis else None, [each.name for each in latched], trip)
            self.shared.events.put(told)
        for each in latched:
            each.fault(t, trip)

    def estop(self, t: float) -> Trip | None:
        """Why the e-stop line does not allow movement."""
        config = self.config.guard.estop
        if config is None or self.estop_index is None:
            return None
        return guard.estop_open(config, t, self.samples[self.estop_index], self.config.guard.stale)

    def note_trouble(self, t: float) -> None:
        """Tell when the rig goes out of reach and when it returns."""
        self.trouble = self.driver.trouble
        why = self.trouble or "the rig can be reached again"
        self.shared.events.put(events.warning(t, None, "link", why))

    def finish(self) -> None:
        """Neutral, last row, close."""
        if self.shared.words[Word.FENCE] >= self.generation:
            self.on_fence()
        self.driver.neutral(self.pacer.now())
        self.log.flush(())
        self.meter.publish_counters()
        self.driver.close()
