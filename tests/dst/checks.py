"""What must hold at every step, seen from outside the daemon: from the rig, the wire and the clients."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from seod.loop.guard import SUPERVISOR_SILENT_S
from seod.processes.ring import AxisState, Word
from tests.dst.frames import VOLTS

if TYPE_CHECKING:
    from tests.dst.bus import CanSocket
    from tests.dst.exchange import System
    from tests.dst.frames import Valve
    from tests.dst.line import Command, Port
    from tests.dst.rig import Rig
    from tests.dst.world import Process, World

SUPERVISOR_S = 0.020
"""Promised: neutral so long after the end of the loop, where the supervisor acts."""
WIRE_S = 0.004
"""A frame, and those before it, on the wire."""
TICKS = 2
"""Promised: neutral after so many ticks, where the loop lives and the bus works."""
SETTLED_S = 0.5
"""After trouble of the bus: until neutral has left again, or the rig's own watchdog has acted."""
ORDER = 8
"""Frames whose counter is so far behind are older ones; one that is farther ahead is in doubt."""
ESTOP_OPEN, SAMPLES_STOPPED = "the e-stop line was opened", "samples stopped coming"
SUPERVISOR_STOOD = "the supervisor stood still"


class LoopSeen:
    """A loop process with what the outside knows of it."""

    def __init__(self, loop: Any, process: Process) -> None:
        self.loop, self.process = loop, process
        self.ticks = 0
        self.states = [axis.course.state for axis in loop.axes]
        self.active_at = -math.inf
        link = loop.driver._link
        self.end: CanSocket | Port | None = link._port if hasattr(link, "_port") else link._raw
        self.overdue = dict.fromkeys((ESTOP_OPEN, SAMPLES_STOPPED, SUPERVISOR_STOOD), 0)
        self.last_tick = -math.inf


class Checks:
    """All invariants of one world.

    Args:
        world: Where failures go.
        system: Its shells.
        config: The rig file.
    """

    def __init__(self, world: World, system: System, config: Any) -> None:
        self.world, self.system, self.config = world, system, config
        self._wire = system.bus
        self.period = 1.0 / config.loop.rate_hz
        self.limit = config.axes["motor"].limits.output
        self._stale = config.guard.stale
        self._silent_ticks = math.ceil(max(SUPERVISOR_SILENT_S, config.loop.hang_timeout) / self.period)
        self.rig: Rig
        self.seen: LoopSeen | None = None
        self.supervisor: Process | None = None
        self.gateway: Process | None = None
        self.resets = self.starts = 0
        self.resets_at_fault = self.starts_at_fault = 0
        self.disturbed: dict[int, float] = {}
        """When the outside last took hold of a process [s]."""
        self.loop_lost_at = -math.inf
        self.supervisor_lost_at = -math.inf
        self.estop_open_at = self.estop_shut_at = -math.inf
        self.heard_at = world.now
        self._newest = self._far = -1
        self.foreign_at = -math.inf
        self.bus_broken_at = -math.inf
        self.checked = 0
        self.neutral_by: list[tuple[float, str, int]] = []
        system.loop_made = self._loop_made
        system.mailbox_made = self._mailbox_made
        system.bus.on_command = self._on_command
        system.network.on_bytes = self._on_bytes
        world.after_step = self._step

    # ---- what is told

    def touched(self, process: Process) -> None:
        """The outside took hold of a process."""
        self.disturbed[process.pid] = self.world.now

    def _calm_since(self, process: Process | None, t: float) -> bool:
        return process is not None and process.able and self.disturbed.get(process.pid, -math.inf) < t

    def _loop_made(self, loop: Any) -> Any:
        process = self.world.me().process
        seen = self.seen = LoopSeen(loop, process)
        tick, fault = loop.tick, loop.fault

        def ticked(t: float) -> None:
            tick(t)
            self._ticked(seen, t)

        def faulted(t: float, *rest: Any) -> None:
            if any(axis.course.state is not AxisState.FAULT for axis in loop.axes):
                self.resets_at_fault, self.starts_at_fault = self.resets, self.starts
            fault(t, *rest)

        loop.tick, loop.fault = ticked, faulted
        process.deaths.append(lambda: self._loop_ended(seen))
        return loop

    def _mailbox_made(self, mailbox: Any) -> Any:
        """Resets count from when the gateway begins them: before, it cannot know when they were asked for."""
        post = mailbox.post

        async def posted(op: str, *rest: Any) -> None:
            self.resets += op == "reset"
            await post(op, *rest)

        mailbox.post = posted
        return mailbox

    def _loop_ended(self, seen: LoopSeen) -> None:
        self.loop_lost_at = self.world.now
        self.resets_at_fault = self.resets
        self.starts_at_fault = self.starts
        self._count(seen)

    def _on_bytes(self, data: bytes) -> None:
        self.starts += data.count(b'"start"') + data.count(b'"drive"')
        if b'"estop"' in data:
            self._estop_asked()

    def _estop_asked(self) -> None:
        if self.gateway is not None and self.gateway.able:
            self._must_stop("a client's e-stop", 0.02, [self.gateway])

    def commanded_by_others(self) -> None:
        """A command of somebody else reached this computer, and the rig."""
        self.foreign_at = self.world.now
        self._must_stop("a command of somebody else", 0.0, [])

    def _must_stop(self, what: str, within: float, by: list[Process]) -> None:
        """No axis moves after `within` [s] and two ticks, if nobody is held up and nobody starts."""
        now, seen = self.world.now, self.seen
        if seen is None or not seen.process.able or self.bus_broken_at > now - SETTLED_S:
            return
        starts, processes = self.starts, [*by, seen.process]
        within += (TICKS + 1) * (self.period + seen.process.latency[1])

        def look() -> None:
            calm = all(self._calm_since(each, now - 1.0) for each in processes)
            moving = any(axis.course.active for axis in seen.loop.axes)
            if calm and moving and self.starts == starts and self.bus_broken_at < now - SETTLED_S:
                self.world.fail(f"the rig moves two ticks after {what}")

        self.world.at(now + within, look)

    # ---- commands

    def _on_command(self, source: CanSocket | Port, valve: Valve | Command) -> None:
        self.checked += 1
        if not valve.sound:
            self.world.fail(f"a damaged command left from {source.process.name}")
        if valve.volts == 0.0:
            return
        if abs(valve.volts) > self.limit + VOLTS:
            self.world.fail(f"{valve.volts} V left: limits.output is {self.limit} V")
        seen = self.seen
        if seen is None or source.process is not seen.process:
            self.world.fail(f"{valve.volts} V left from {source.process.name}, which may send neutral only")
            return
        self._guarded(seen, valve)

    def _guarded(self, seen: LoopSeen, valve: Valve | Command) -> None:
        axis, loop = seen.loop.axes[0], seen.loop
        if not axis.course.active:
            self.world.fail(f"{valve.volts} V left while the axis is {axis.course.state.name}")
        if abs(valve.volts - axis.guard.last_u) > VOLTS:
            self.world.fail(f"{valve.volts} V left, the guard passed {axis.guard.last_u} V")
        if loop.shared.words[Word.FENCE] >= loop.generation:
            self.world.fail(f"{valve.volts} V left from a loop that is fenced")
        if self.starts == self.starts_at_fault:
            self.world.fail(f"{valve.volts} V left, and nobody asked for a start since the last fault")

    # ---- ticks

    def _ticked(self, seen: LoopSeen, t: float) -> None:
        seen.ticks += 1
        seen.last_tick = t
        active = False
        for place, axis in enumerate(seen.loop.axes):
            active = active or axis.course.active
            self._latched(seen, place, axis.course.state)
        if active:
            seen.active_at = t
        self._conditions(seen, t, active)

    def _latched(self, seen: LoopSeen, place: int, state: AxisState) -> None:
        before, seen.states[place] = seen.states[place], state
        left = before is AxisState.FAULT and state is not AxisState.FAULT
        if left and self.resets == self.resets_at_fault:
            self.world.fail("a fault was left, and nobody asked for a reset")

    def _conditions(self, seen: LoopSeen, t: float, active: bool) -> None:
        opened = self.estop_open_at
        self._stops(seen, ESTOP_OPEN, self.estop_shut_at < opened < t, 0, active)
        self._stops(seen, SAMPLES_STOPPED, t - self.heard_at > self._stale, 0, active)
        stood = self.supervisor is not None and self.supervisor.stopped
        self._stops(seen, SUPERVISOR_STOOD, stood, self._silent_ticks, active)

    def _stops(self, seen: LoopSeen, what: str, holds: bool, allowed: int, active: bool) -> None:
        """No axis moves two ticks after something has held for longer than `allowed` ticks."""
        if not holds:
            seen.overdue[what] = 0
            return
        seen.overdue[what] += 1
        if seen.overdue[what] > allowed + TICKS and active:
            self.world.fail(f"the rig moves {seen.overdue[what]} ticks after {what}")

    # ---- what the sensors said, as it reached this computer

    def sensed(self, run: bool, sound: bool, counter: int | None) -> None:
        """A sample arrived at this computer; what it says of the e-stop counts in the order of counters."""
        now = self.world.now
        if not sound:
            return
        self.heard_at = now
        if counter is not None and not self._comes_next(counter):
            return
        if not run and self.estop_open_at <= self.estop_shut_at:
            self.estop_open_at = now
        elif run and self.estop_shut_at <= self.estop_open_at:
            self.estop_shut_at = now

    def _comes_next(self, counter: int) -> bool:
        """Not an older frame, nor one far ahead, unless the next one goes on from that."""
        ahead, of_far = (counter - self._newest) % 256, (counter - self._far) % 256
        if ahead == 0 or ahead >= 256 - ORDER:
            return False
        near = ahead <= ORDER or 0 < of_far <= ORDER
        self._far = counter
        if near:
            self._newest = counter
        return near

    # ---- the rig

    def _step(self) -> None:
        if not self._wire.works:
            self.bus_broken_at = self.world.now
        if self.rig.volts != 0.0:
            self._moving()

    def _moving(self) -> None:
        """The amplifier puts out a voltage: is there still somebody who may want that?"""
        now, seen = self.world.now, self.seen
        if now - self.bus_broken_at < SETTLED_S or now - self.foreign_at < SETTLED_S:
            return
        if seen is not None and seen.process.able:
            pace = self.period + seen.process.latency[1]
            if now - max(seen.active_at, self.disturbed.get(seen.process.pid, -math.inf)) <= (
                TICKS * pace + WIRE_S
            ):
                return
            self.world.fail(f"{self.rig.volts} V at the rig, and no axis moves")
            return
        self._moving_alone()

    def _moving_alone(self) -> None:
        """The loop is dead, or stands still."""
        now, seen, supervisor = self.world.now, self.seen, self.supervisor
        dead = seen is None or not seen.process.alive
        if dead:
            since, allowed = self.loop_lost_at, SUPERVISOR_S + WIRE_S
        else:
            assert seen is not None
            since = self.disturbed.get(seen.process.pid, -math.inf)
            allowed = self.config.loop.hang_timeout + 0.025 + SUPERVISOR_S + WIRE_S
        if not self._calm_since(supervisor, since - 0.5) or now - self.supervisor_lost_at < 1.0:
            return  # then the rig's own watchdog is all there is
        if now - since > allowed:
            what = "died" if dead else "stood still"
            self.world.fail(
                f"{self.rig.volts} V at the rig {1e3 * (now - since):.0f} ms after the loop {what}"
            )

    # ---- counters

    def _count(self, seen: LoopSeen) -> None:
        why = "" if seen.end is None else seen.end.miscount(seen.loop.driver.counters)
        if why:
            self.world.fail(why)

    # ---- clients

    def heard(self, topic: str, params: dict[str, Any]) -> None:
        """A client got a notification."""
        if topic == "estimate" and params["quality"] == "ok":
            self._fresh(params)

    def _fresh(self, params: dict[str, Any]) -> None:
        age = params["age_s"]
        if age > 1.0:
            self.world.fail(f"an estimate of quality ok was published {age:.2f} s after its window's end")
        if params["t"] - self.heard_before(params["t"]) > 0.5:
            self.world.fail("an estimate of quality ok while no sample came")

    def heard_before(self, t: float) -> float:
        """The last encoder frame until `t` [s], as far as known."""
        return min(self.heard_at, t) if self.heard_at <= t else t
