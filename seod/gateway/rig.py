"""The rig as the gateway knows it: takes events and rows out of shared memory, answers and publishes.

Nothing here waits: `poll` takes what there is. Time is that of the rows, handed in as `clock`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from seod import PROTOCOL, __version__
from seod.config.resolution import resolution_of
from seod.config.truth import truth
from seod.gateway.beside import Beside
from seod.gateway.estimation import Axis
from seod.gateway.health import Health
from seod.gateway.mailbox import Mailbox
from seod.gateway.messages import message, sample_message
from seod.gateway.recording import Recording
from seod.gateway.rows import RowReader
from seod.gateway.two_phase import TwoPhases
from seod.record.layout import ESTIMATES, EVENTS, HEALTH, MODEL_ERRORS
from seod.record.recorder import WAITING_ROWS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy as np
    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.estimate.base import Estimate, Estimator, EstimatorSettings
    from seod.gateway.hub import Hub
    from seod.gateway.messages import RowTuple
    from seod.ring import Shared

    Event = dict[str, Any]

HEALTH_S = 1.0
SILENCE_S = 0.5
"""Without rows for this long, estimates are stale."""
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
        restart_loop: Asks the supervisor for a new loop process.
        recording: Takes all rows, estimates and events, and health.
    """

    def __init__(
        self,
        config: RigConfig,
        shared: Shared,
        hub: Hub,
        make: Callable[[EstimatorSettings], Estimator],
        clock: Callable[[], float],
        restart_loop: Callable[[], None],
        recording: Recording | None = None,
    ) -> None:
        period = 1.0 / config.loop.rate_hz
        self.now = clock
        self.axes = {
            name: Axis(name, axis, period, make, sensor.lag, resolution_of(sensor))
            for name, axis in config.axes.items()
            for sensor in [config.sensors[axis.sensor]]
        }
        self._beside = {name: Beside(config, name) for name in config.axes}
        self.mailbox = Mailbox(shared.commands, restart_loop)
        self._two_phase = TwoPhases(self.axes, self.mailbox, self._warn)
        self.clients: Callable[[], dict[str, Any]] = dict
        """Tells about the clients in `health`; the server sets it."""
        self._config = config
        self._replayed = config.driver["kind"] == "replay"
        self._truth = truth(config) or None
        self._shared = shared
        self._hub = hub
        self._recording = recording or Recording()
        self._reader = RowReader(shared)
        self._rows_lost = 0
        self._dependent: dict[str, float] = {}
        self._health = Health(shared)
        self._started: Event = {"realtime": {"ok": False, "why": ["the loop has not started yet"]}}
        self._last_rows = self._next_health = clock()

    def poll(self) -> None:
        """Take events and rows, publish what they bring."""
        head = self._reader.head  # what is written after it may come after an event that was not yet seen
        for event in self._events():
            self._on_event(event)
        self._hub.flush()  # what happened comes before what was measured since
        now = self.now()
        rows = None if self._held_back() else self._reader.take(head)
        if rows is not None and len(rows):
            self._last_rows = now
            self.mailbox.rows_come()
            self._on_rows(rows)
        elif now - self._last_rows > SILENCE_S:
            self._note_silence()
        for beside in self._beside.values():
            self._on_model_errors(beside)
        for news in self._recording.news():
            self._warn("recording", news)
        if now >= self._next_health:
            self._next_health = now + HEALTH_S
            self._publish_health(now)
        self._hub.flush()

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
            self.mailbox.answered(event)
            return
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
        if self.mailbox.loop_started(event["generation"]):
            self._started = event
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
            for estimate in self._estimates(axis, block):
                self._publish_estimate(axis.name, estimate)
                self._note_dependence(axis.name, estimate)
                if not self._replayed:
                    self._two_phase.consider(axis.name, estimate, reference=block[-1][2])
            self._beside[axis.name].feed(block)
            axis.reconcile(float(rows["tick_t"][-1]), block[-1][-2])

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

    def _on_model_errors(self, beside: Beside) -> None:
        axis = beside.axis
        for error, news in beside.answers():
            params = error.as_message(axis, beside.left)
            self._recording.note(MODEL_ERRORS + axis, error.t, params)
            self._hub.publish("model_error", axis, error.t, lambda params=params: params)  # type: ignore[misc]
            if news:
                self._warn("model", f"{axis}: {news}", axis)
        if trouble := beside.trouble():
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
            self._beside[axis.name].interrupted()

    def _note_silence(self) -> None:
        for axis in self.axes.values():
            if not axis.stale:
                axis.stale = True
                self._publish_newest(axis)

    def _publish_event(self, event: Event) -> None:
        self._recording.note(EVENTS, event["t"], event)
        self._hub.publish("event", event.get("axis"), event["t"], lambda: event)

    def _publish_health(self, now: float) -> None:
        self._health.measure(now)
        health = self.health()
        self._recording.note(HEALTH, now, health)
        self._hub.publish("health", None, now, lambda: health)

    def _publish_sample(self, axis: str, tick: int, row: RowTuple) -> None:
        self._hub.publish("sample", axis, row[0], lambda: sample_message(axis, tick, row))

    def _publish_estimate(self, axis: str, estimate: Estimate) -> None:
        params = message(axis, estimate, self.now())
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
        self.mailbox.loop_died(death["generation"], why)
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
        axis.change(values)
        if told:
            self._publish_event({"event": "changed", "t": self.now(), "axis": axis.name, "values": told})

    async def reset(self, axis: int | None = None) -> None:
        """Leave the fault; where the loop has died, have a new one started and wait until it ticks.

        Args:
            axis: Number of one axis; None for all. A new loop has none in fault.

        Raises:
            RpcError: Refused, or the new loop does not come up.
        """
        if self.mailbox.dead_why:
            await self.mailbox.restart()
        else:
            await self.mailbox.post("reset", axis)

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
            "state": min((axis.state for axis in self.axes.values()), key=STATES.index),
        }

    def status(self) -> dict[str, Any]:
        """The answer to `status`: everything at once."""
        axes = {name: self.whole(axis) for name, axis in self.axes.items()}
        return {**self.info(), "axes": axes, "health": self.health()}

    def whole(self, axis: Axis) -> dict[str, Any]:
        """The answer to `get`."""
        return {**axis.whole(self.now()), "model_error": self._beside[axis.name].newest()}

    def _realtime(self) -> dict[str, Any]:
        dead = self.mailbox.dead_why
        realtime: dict[str, Any] = {"ok": False, "why": [dead]} if dead else self._started["realtime"]
        return realtime

    def health(self) -> dict[str, Any]:
        """The `health` message."""
        return {
            **self._health.loop(self.now(), self._started.get("counters", [])),
            "rows_lost": self._reader.lost,
            "events_lost": self._shared.events.lost,
            "clients": self.clients(),
            **self._recording.report(),
            "realtime": self._realtime(),
        }

    def close(self) -> None:
        """Take the last rows, end the recording, let go of the memory."""
        self.poll()
        for beside in self._beside.values():
            beside.close()
        self._reader.close()
        self._recording.close()
