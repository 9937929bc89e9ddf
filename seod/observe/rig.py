"""The rig as clients see it: takes events and rows out of shared memory, answers and publishes.

Nothing here waits: `poll` takes what there is. Time is that of the rows, handed in as `clock`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from seod import PROTOCOL, __version__
from seod.config.resolution import resolution_of
from seod.config.settings import is_replayed, on_clock
from seod.config.truth import truth
from seod.observe.estimation import Axis
from seod.observe.health import Health
from seod.observe.messages import message, sample_message
from seod.observe.model_monitor import ModelMonitor
from seod.observe.recording import Recording
from seod.observe.rows import RowReader
from seod.observe.timing import Timing
from seod.observe.two_phase import TwoPhases
from seod.processes import journal
from seod.processes.ring import Column
from seod.record.layout import ESTIMATES, EVENTS, HEALTH, MODEL_ERRORS
from seod.record.recorder import WAITING_ROWS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy as np
    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.estimate.base import Estimate, Estimator, EstimatorSettings
    from seod.observe.feeds import Feeds
    from seod.observe.messages import RowTuple
    from seod.processes.ring import Shared

    Event = dict[str, Any]

HEALTH_S = 1.0
SILENCE_S = 0.5
"""Without rows for this long, estimates are stale."""
LATE_S = 1.0
"""An answer that comes this long after its window tells of a rig that may be another by now."""
LATE = "estimation has fallen behind: this answer is of more than a second ago (see age_s)"
BEHIND = (0.5, 0.1)
"""Estimation rests while more of the ring waits than the first, and goes on below the second; by then rows
come in time again. So it costs no rows, however long it takes."""
STATES = ("fault", "exciting", "holding", "armed", "idle")
"""The rig's state is the first of these that any axis is in."""


class Rig:
    """State of all axes, and what there is to say about them.

    Args:
        config: The rig file.
        shared: The memory shared with the loop.
        hub: Where messages are published.
        make: Makes an estimator.
        clock: Time of the rows [s]: CLOCK_MONOTONIC, or simulated time.
        send: Sends the loop a command that nobody waits for: its name, the axis' number, values.
        recording: Takes all rows, estimates and events, and health.
    """

    def __init__(
        self,
        config: RigConfig,
        shared: Shared,
        hub: Feeds,
        make: Callable[[EstimatorSettings], Estimator],
        clock: Callable[[], float],
        send: Callable[[str, int, dict[str, Any]], None],
        recording: Recording | None = None,
    ) -> None:
        period = 1.0 / config.loop.rate_hz
        self.now = clock
        self._health = Health(shared)
        self._timing = Timing.of(period, self._health.stamps)
        self.axes = {
            name: Axis(name, axis, period, make, sensor.lag, resolution_of(sensor), self._timing)
            for name, axis in config.axes.items()
            for sensor in [config.sensors[axis.sensor]]
        }
        self._monitors = {name: ModelMonitor(config, name) for name in config.axes}
        self._two_phase = TwoPhases(self.axes, send, self._warn)
        self.clients: dict[str, Any] = {}
        """About the clients, for `health`; the gateway tells it."""
        self._dead_why = ""
        """Why there is no loop any more; "" while there is one, or while the first has not started yet."""
        self._dead_generation = 0
        self._config = config
        self._replayed = is_replayed(config)
        self._truth = truth(config) or None
        self._shared = shared
        self._hub = hub
        self._recording = recording or Recording()
        self._reader = RowReader(shared)
        self._rows_lost = 0
        self._may_rest = on_clock(config)
        self._resting = False
        self._dependent: dict[str, float] = {}
        self._started: Event = {"realtime": {"ok": False, "why": ["the loop has not started yet"]}}
        self._last_rows = self._next_health = clock()

    def take_events(self) -> None:
        """Take events, publish what they bring: what happened comes before what was measured since."""
        for event in self._events():
            self._on_event(event)
        self._hub.flush()

    def poll(self) -> None:
        """Take events and rows, publish what they bring."""
        head = self._reader.head  # what is written after it may come after an event that was not yet seen
        self.take_events()
        now = self.now()
        self._rest()
        rows = None if self._held_back() else self._reader.take(head)
        if rows is not None and len(rows):
            self._last_rows = now
            self._on_rows(rows)
        elif now - self._last_rows > SILENCE_S:
            self._note_silence()
        for monitor in self._monitors.values():
            self._on_model_errors(monitor)
        for news in self._recording.news():
            self._warn("recording", news)
        if now >= self._next_health:
            self._next_health = now + HEALTH_S
            self._publish_health(self.now())  # rows may have taken long, and ticks have gone on meanwhile
        self._hub.flush()

    def _rest(self) -> None:
        """Whether rows come faster than estimation takes them: then they are only recorded and streamed."""
        if not self._may_rest or self._reader.behind < BEHIND[0 if not self._resting else 1]:
            self._resting = False
            return
        if not self._resting:
            self._resting = True
            self._interrupt()
            why = "estimation rests until it has caught up: this computer is too busy for it"
            self._warn("estimator_rests", why)

    def _held_back(self) -> bool:
        """Simulated time waits for who takes its rows, so that the recorder can be waited for as well."""
        fast = self._config.driver.get("realtime") is False
        return fast and self._recording.waiting > WAITING_ROWS // 2

    def _events(self) -> Iterator[Event]:
        try:
            yield from self._shared.events.take()
        except ValueError:  # overwritten while it was read; the ring counts it as lost, rows tell the state
            return

    def _on_event(self, event: Event) -> None:
        kind, axis = event["event"], self.axes.get(event.get("axis") or "")
        if kind == "reply":
            return  # the gateway takes them
        if kind == "started":
            self._on_started(event)
        elif kind == "fault":
            self._fail(event)
        elif kind == "state" and axis is not None:
            axis.enter(event["t"], event["state"])
        elif kind == "changed" and axis is not None:
            axis.change(event["values"])
        elif kind == "warning" and event["code"] == "rows_lost":  # in a recording that is replayed
            self._interrupt()
        self._two_phase.heard(event)
        self._publish_event(event)

    def _on_started(self, event: Event) -> None:
        if event["generation"] > self._dead_generation:
            self._dead_why = ""
            self._started = event
            self._timing.untold_delay = event.get("untold_delay_s", self._timing.untold_delay)
            for axis in self.axes.values():
                axis.restarted(event["t"])

    def _fail(self, event: Event) -> None:
        for name in event.get("latched", self.axes):  # without a loop it is all of them
            self.axes[name].fail(event)
            self._publish_newest(self.axes[name])

    def _on_rows(self, rows: NDArray[np.void]) -> None:
        self._note_lost()
        self._recording.add(rows)
        ticks = rows["tick"].tolist()
        for index, axis in enumerate(self.axes.values()):
            block: list[RowTuple] = rows["axes"][:, index].tolist()
            if self._hub.wanted("sample", axis.name):
                for tick, row in zip(ticks, block, strict=True):
                    self._publish_sample(axis.name, tick, row)
            for estimate in [] if self._resting else self._estimates(axis, block):
                self._publish_estimate(axis.name, estimate)
                self._note_dependence(axis.name, estimate)
                if not self._replayed:
                    self._two_phase.consider(axis.name, estimate, reference=block[-1][Column.REFERENCE])
            if not self._resting:
                self._monitors[axis.name].feed(block)
            axis.reconcile(float(rows["tick_t"][-1]), block[-1][Column.STATE])

    def _estimates(self, axis: Axis, block: list[RowTuple]) -> list[Estimate]:
        try:
            return axis.feed(block)
        except (ValueError, ArithmeticError) as error:
            self._warn("estimator", f"{axis.name}: the estimator began anew: {error}", axis.name)
            return []

    def _note_dependence(self, axis: str, estimate: Estimate) -> None:
        """Tell, once for each pair of amplitudes, that the answer depends on them."""
        finding = estimate.e_a_dependence
        if estimate.quality == "ok":
            self._dependent.pop(axis, None)
        elif finding is not None and self._dependent.get(axis) != finding.other_e_a:
            self._dependent[axis] = finding.other_e_a
            self._warn("depends_on_e_a", f"{axis}: {estimate.advice}", axis)

    def _on_model_errors(self, monitor: ModelMonitor) -> None:
        axis = monitor.axis
        for error, news in monitor.answers():
            params = error.as_message(axis, monitor.left)
            self._recording.note(MODEL_ERRORS + axis, error.t, params)
            self._hub.publish("model_error", axis, error.t, lambda params=params: params)  # type: ignore[misc]
            if news:
                self._warn("model", f"{axis}: {news}", axis)
        if trouble := monitor.trouble():
            self._warn("model", f"{axis}: its model cannot be simulated beside it: {trouble}", axis)

    def _note_lost(self) -> None:
        lost = self._reader.lost - self._rows_lost
        if lost:
            self._rows_lost += lost
            self._interrupt()
            self._warn("rows_lost", f"{lost} rows were overwritten before the gateway could take them")

    def _interrupt(self) -> None:
        for axis in self.axes.values():
            axis.interrupted()
            self._monitors[axis.name].interrupted()

    def _note_silence(self) -> None:
        for axis in self.axes.values():
            if not axis.stale:
                axis.stale = True
                self._publish_newest(axis)

    def _publish_event(self, event: Event) -> None:
        tell_journal(self._config.rig, event)
        self._recording.note(EVENTS, event["t"], event)
        self._hub.publish("event", event.get("axis"), event["t"], lambda: event)

    def _publish_health(self, now: float) -> None:
        self._health.measure(now)
        health = self.health()
        self._recording.note(HEALTH, now, health)
        self._hub.publish("health", None, now, lambda: health)

    def _publish_sample(self, axis: str, tick: int, row: RowTuple) -> None:
        self._hub.publish("sample", axis, row[Column.T], lambda: sample_message(axis, tick, row))

    def _publish_estimate(self, axis: str, estimate: Estimate) -> None:
        now = self.now()
        if self._may_rest and now - estimate.t > LATE_S and estimate.quality == "ok":
            estimate = replace(estimate, quality="stale", advice=LATE)
        params = message(axis, estimate, now)
        self._recording.note(ESTIMATES + axis, estimate.t, params)
        self._hub.publish("estimate", axis, estimate.t, lambda: params)

    def _publish_newest(self, axis: Axis) -> None:
        newest = axis.newest(self.now())
        if newest is not None:
            self._hub.publish("estimate", axis.name, self.now(), lambda: newest)

    def _warn(self, code: str, why: str, axis: str | None = None) -> None:
        self._publish_event({"event": "warning", "t": self.now(), "axis": axis, "code": code, "why": why})

    def loop_died(self, death: Event) -> None:
        """The supervisor says that the loop process has died, and what became of the neutral command."""
        self.poll()  # what the loop still said comes first
        self._reader.restart()
        why = f"{death['why']}; {death['neutral']}"
        self._dead_why, self._dead_generation = why, death["generation"]
        fault = {
            "event": "fault",
            "t": death["t"],
            "axis": None,
            "code": "loop_died",
            "why": why,
            "numbers": {},
        }
        self._fail(fault)
        self._publish_event(fault)
        self._hub.flush()

    def change(self, axis: Axis, values: dict[str, Any], told: dict[str, Any]) -> None:
        """New settings are in force; `told` are those of which the loop does not tell the clients."""
        self.take_events()
        axis.change(values)
        if told:
            self._publish_event({"event": "changed", "t": self.now(), "axis": axis.name, "values": told})

    def info(self) -> dict[str, Any]:
        """The answer to `info`; `truth` is null for a real rig."""
        return {
            "version": __version__,
            "protocol": PROTOCOL,
            "rig": self._config.rig,
            "axes": list(self.axes),
            "realtime": self._realtime(),
            "simulated": self._config.simulation is not None,
            "truth": self._truth,
            "driver": self._config.driver["kind"],
            "rate_hz": self._config.loop.rate_hz,
            "dead_man": self._config.guard.dead_man,
            "state": min((axis.state for axis in self.axes.values()), key=STATES.index),
        }

    def status(self) -> dict[str, Any]:
        """The answer to `status`: everything at once."""
        axes = {name: self.whole(axis) for name, axis in self.axes.items()}
        return {**self.info(), "axes": axes, "health": self.health()}

    def whole(self, axis: Axis) -> dict[str, Any]:
        """The answer to `get`."""
        return {**axis.whole(self.now()), "model_error": self._monitors[axis.name].newest()}

    def record(self, on: bool) -> dict[str, Any]:
        """Begin a recording, or end the one that was begun so; `error` says why that cannot be."""
        error = self._recording.begin() if on else self._recording.end()
        return {**self._recording.report(), "error": error}

    def _realtime(self) -> dict[str, Any]:
        dead = self._dead_why
        realtime: dict[str, Any] = {"ok": False, "why": [dead]} if dead else self._started["realtime"]
        return realtime

    def health(self) -> dict[str, Any]:
        """The `health` message."""
        return {
            **self._health.loop(self.now(), self._started.get("counters", [])),
            "rows_lost": self._reader.lost,
            "events_lost": self._shared.events.lost,
            "clients": self.clients,
            **self._recording.report(),
            "realtime": self._realtime(),
        }

    def close(self) -> None:
        """Take the last rows, end the recording, let go of the memory."""
        self.poll()
        for monitor in self._monitors.values():
            monitor.close()
        self._reader.close()
        self._recording.close()


def tell_journal(rig: str, event: Event) -> None:
    """Faults and warnings, for whoever reads the journal; of a dead loop the supervisor tells."""
    kind, code = event["event"], event.get("code", "")
    if kind in ("fault", "warning") and code != "loop_died":
        priority = journal.ERROR if kind == "fault" else journal.WARNING
        axis = event.get("axis") or ""
        journal.tell(f"seod: {kind} {code}: {event['why']}", priority, RIG=rig, AXIS=axis, CODE=code)
