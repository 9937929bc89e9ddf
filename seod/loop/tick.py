"""The loop process: one tick after another, in real time. Everything slow is in the gateway process.

`Loop.tick` is the whole of it, in order; time is passed in, only the pacer reads a clock.
"""

from __future__ import annotations

import math
import os
import time
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Any

from seod.config.channels import condition_channels, input_channels
from seod.config.sensors import index_channel
from seod.config.settings import on_clock
from seod.loop import events, guard
from seod.loop.axis import Axis
from seod.loop.guard import Trip
from seod.loop.meter import TickMeter
from seod.loop.rowlog import RowLog
from seod.loop.signals import Signals
from seod.loop.turns import Turns
from seod.loop.validity import make_gates, pass_valid
from seod.processes.ring import OVERTAKEN, TOO_OLD, AxisState, Word

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivers.base import Driver, Sample
    from seod.config.model import RigConfig
    from seod.loop.pacer import Pacer
    from seod.processes.ring import Shared

FENCED = 3
"""Exit code of a loop that found itself fenced."""
UNHEARD = ("stale_sample", "estop", "silent")
"""Codes of trips that a channel without new samples may have."""
FOREIGN_S = 2.0
"""So long after a command of somebody else the rig may still move by it; it is told once in this time."""
FINAL_NEUTRALS, FINAL_S = 5, 0.02
"""At its end the loop repeats neutral so often at least, and for so long [s]."""
COMMANDS_A_TICK = 4
"""Most commands carried out in one tick: a flood of them, 20 us each, must not make it late."""


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
        self.estop_lines = [(line, channels.index(line.channel)) for line in config.guard.estops]
        self.gates = make_gates(config, channels)
        for axis, index in zip(self.axes, self.sensor_of, strict=True):
            axis.guard.gates = [gate for gate in self.gates if gate.index == index]
        self.signals = Signals(config, self.axes)
        self.overruns = guard.OverrunGuard(config.guard.overruns.count, config.guard.overruns.window)
        clocked = on_clock(config)
        self.supervisor = guard.SupervisorGuard(
            self.period if clocked else math.inf, config.loop.hang_timeout
        )
        self.pause = self.period if clocked else 0.0
        self.foreign, self.foreign_until = 0, -math.inf
        self.keepalive = -math.inf
        self.pending: Trip | None = None
        self.gateway_lost = False
        self.trouble = ""
        self.samples: Sequence[Sample] = ()
        self.turns = Turns(config.excitation.turn)
        self.faulted_at = dict.fromkeys(config.axes, 0)
        """Commands that had been asked for when each axis went into fault, by their count."""
        self.log = RowLog(shared, self.axes)
        self.meter = TickMeter(shared, driver, self.period)
        self.in_force = pacer.now(), [0.0] * len(self.axes)
        self.ending = False
        shared.commands.skip_to_head()
        self.estops = shared.words[Word.ESTOPS_OBEYED] = shared.words[Word.ESTOPS]
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
        samples = self.driver.read(t)
        self.samples = pass_valid(self.gates, t, samples) if self.gates else samples
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
                self.fault(t, self.explained(trip, [self.sensor_of[self.axes.index(axis)]]), axis)

    def explained(self, trip: Trip, places: Sequence[int]) -> Trip:
        """A trip for channels that are silent, with what the driver knows of the frames at these places."""
        if trip.code not in UNHEARD:
            return trip
        whys = dict.fromkeys(filter(None, map(self.driver.why_old, places)))
        return replace(trip, why="; ".join([trip.why, *whys]))

    def inspect_rig(self, t: float) -> Trip | None:
        """What concerns all axes."""
        trip, self.pending = self.pending, None
        late = self.overruns.inspect(t, self.pacer.lateness, self.period)
        if self.driver.trouble != self.trouble:
            self.note_trouble(t)
        if self.driver.foreign_commands != self.foreign or self.axes[0].foreign:
            trip = trip or self.note_foreign(t)
        if self.driver.remarks:
            self.tell_remarks(t)
        trip = trip or self.supervisor.inspect(self.shared.words[Word.BEATS])
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
        if self.signals.present:
            raw += self.signals.values()
        left = self.driver.write(t, raw) if moving else self.driver.neutral(t)
        self.shared.words[Word.COMMANDS_SENT] = self.driver.commands_sent
        if not math.isnan(left):  # else nothing left, and the command before is still in force
            self.in_force = left, volts
        return self.in_force

    def obey(self, t: float) -> None:
        """Carry out the commands that came through the mailbox, and answer each."""
        if self.shared.words[Word.ESTOPS] != self.estops:
            self.obey_estop()
        if self.gateway_lost:
            self.go_on_alone(t)
        for message in islice(self.shared.commands.take(), COMMANDS_A_TICK):
            self.shared.events.put(events.reply(message["id"], self.carry_out(t, message)))

    def obey_estop(self) -> None:
        """Stop in this tick, and carry out none of the commands that were there before the e-stop."""
        self.estops = self.shared.words[Word.ESTOPS]
        self.pending = Trip("estop", "e-stop by a client")
        for message in self.shared.commands.take():
            self.shared.events.put(events.reply(message["id"], OVERTAKEN))
        self.shared.words[Word.ESTOPS_OBEYED] = self.estops

    def go_on_alone(self, t: float) -> None:
        """The gateway is gone: nobody can stop the rig over TCP any more, or see what was still asked for."""
        self.gateway_lost = False
        self.shared.commands.skip_to_head()
        why = "the gateway process died or hung: nobody could stop the rig over TCP"
        if self.config.guard.gateway_lost == "stop":
            self.pending = Trip("gateway_died", why)
            return
        for axis in self.axes:
            axis.course.stop(t, why)
        self.shared.events.put(events.warning(t, None, "gateway_died", why))

    def let_go(self, client: str) -> None:
        """The last client that called keepalive is gone: there is nobody to wait for."""
        if self.config.guard.dead_man is not None and any(axis.course.active for axis in self.axes):
            self.pending = Trip("dead_man", f"the client that held the rig by keepalive is gone: {client}")

    def carry_out(self, t: float, message: dict[str, Any]) -> str | None:
        """One command; returns why it was not done."""
        chosen = self.axes if message["axis"] is None else [self.axes[message["axis"]]]
        op = message["op"]
        if op == "keepalive":
            self.keepalive = t
        elif op == "let_go":
            self.let_go(message["values"]["client"])
        elif op == "start":
            in_turn = message["axis"] is None and self.config.excitation.order == "in_turn"
            return self.start(t, chosen, in_turn)
        elif op == "drive":
            return self.start(t, chosen, **message["values"])
        elif op == "stop":
            for axis in chosen:
                axis.course.stop(t)
        elif op == "reset":
            return self.reset(t, chosen)
        else:
            return self.adjust(t, chosen, op, message["values"])
        return None

    def reset(self, t: float, chosen: list[Axis]) -> str | None:
        """Leave the faults that were there when it was asked for; returns why not."""
        if any(self.shared.commands.tail <= self.faulted_at[axis.name] for axis in chosen):
            return TOO_OLD
        for axis in chosen:
            axis.course.reset(t)
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
            self.shared.words[Word.FAULTS] += 1
        for each in latched:
            each.fault(t, trip)
            self.faulted_at[each.name] = self.shared.commands.head[0]

    def estop(self, t: float) -> Trip | None:
        """Why the e-stop lines do not allow movement; where all is silent, that is the reason told."""
        stale = self.config.guard.stale
        lines = [(line, self.samples[index]) for line, index in self.estop_lines]
        trip = guard.estop_open(lines, t, stale)
        if trip is None:
            return None
        trip = guard.silent(self.samples, t, stale) or trip
        old = [place for place, sample in enumerate(self.samples) if t - sample.t > stale]
        return self.explained(trip, old)

    def note_trouble(self, t: float) -> None:
        """Tell when the rig goes out of reach and when it returns."""
        self.trouble = self.driver.trouble
        why = self.trouble or "the rig can be reached again"
        self.shared.events.put(events.warning(t, None, "link", why))

    def finish(self) -> None:
        """Neutral, last row, neutral again, close."""
        self.write_neutral()
        self.log.flush(())
        self.repeat_neutral()
        self.meter.publish_counters()
        self.driver.close()

    def note_foreign(self, t: float) -> Trip | None:
        """Somebody else commands the rig, or just did: a fault, or a warning if the rig file says so."""
        came, self.foreign = self.driver.foreign_commands - self.foreign, self.driver.foreign_commands
        if came and self.config.guard.foreign_command == "fault":
            return Trip("foreign_command", self.driver.tell_foreign(), {"commands": float(came)})
        if came and t > self.foreign_until:
            self.shared.events.put(events.warning(t, None, "foreign_command", self.driver.tell_foreign()))
        if came:
            self.foreign_until = t + FOREIGN_S
        for axis in self.axes:
            axis.foreign = t <= self.foreign_until
        return None

    def tell_remarks(self, t: float) -> None:
        """Pass on what the driver found."""
        for code, why in self.driver.remarks:
            self.shared.events.put(events.warning(t, None, code, why))
        self.driver.remarks.clear()

    def write_neutral(self) -> None:
        """Neutral, whatever the axes ask for."""
        if self.shared.words[Word.FENCE] >= self.generation:
            self.on_fence()
        self.driver.neutral(self.pacer.now())

    def repeat_neutral(self) -> None:
        """Neutral for a moment more: a frame can be lost, and a killed supervisor writes none after us."""
        for _ in range(max(FINAL_NEUTRALS, math.ceil(FINAL_S / self.period))):
            time.sleep(self.pause)
            with suppress(Exception):  # the driver may be what failed
                self.driver.read(self.pacer.now())
            self.write_neutral()
