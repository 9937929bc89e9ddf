"""One axis as the gateway sees it: its state, its settings, its estimator and the newest answer."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from seod.config.gain_in_force import gain_range, is_identified
from seod.config.known import known_to
from seod.config.settings import shown
from seod.estimate import levels
from seod.estimate.advice import of_estimate
from seod.estimate.base import Estimate, EstimatorSettings, Row, finite_or_none
from seod.observe.messages import message
from seod.observe.timing import Timing
from seod.processes.ring import (
    FLAG_EXCITING,
    FLAG_FOREIGN,
    FLAG_FRESH,
    FLAG_SATURATED,
    FLAG_SECOND_PHASE,
    AxisState,
    Column,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.config.axis import AxisConfig
    from seod.estimate.base import Estimator
    from seod.observe.messages import RowTuple

INCOMPARABLE = frozenset({"method", "K_L", "reference", "two_phase"})
"""Settings whose change makes answers at other amplitudes those of another question."""

_FOREIGN = "somebody else commands the rig too: stop that, and see the warning `foreign_command`"

_STATE_SETTLES_S = 0.1
"""A row this much newer than the last state event is believed where the two differ: an event was lost."""


class CycleMean:
    """Mean of a measurement over the last whole cycle of the relay."""

    def __init__(self) -> None:
        self._up = False
        self._halves: deque[tuple[float, int]] = deque([(0.0, 0)], maxlen=3)

    def add(self, row: Row, y: float) -> None:
        """Take the measurement `y` of a row."""
        up = row.u > row.bias
        if up is not self._up:
            self._up = up
            self._halves.append((0.0, 0))
        total, count = self._halves[-1]
        if row.fresh and math.isfinite(y):
            self._halves[-1] = total + y, count + 1

    def value(self) -> float | None:
        """The mean; None before a cycle is over."""
        whole = list(self._halves)[:-1]
        count = sum(n for _, n in whole)
        return sum(total for total, _ in whole) / count if len(whole) == 2 and count else None


@dataclass(slots=True)
class Axis:
    """Fed with rows and events; `estimate` is the newest answer, `fault` the reason of the present fault."""

    name: str
    config: AxisConfig
    period_s: float
    make: Callable[[EstimatorSettings], Estimator]
    lag_s: float = 0.0
    """Of the axis' sensor; likewise its `resolution` [axis unit]."""
    resolution: float = 0.0
    timing: Timing | None = None
    """How far the times in rows may be trusted; None: as of a driver that has said nothing."""
    settings: dict[str, Any] = field(init=False)
    state: str = "idle"
    fault: dict[str, Any] | None = None
    estimate: Estimate | None = None
    stale: bool = False
    second_phase: dict[str, float] | None = None
    """Of the relay, as the loop told it; None for none."""
    _timing: Timing = field(init=False)
    _state_t: float = -math.inf
    _running: tuple[bool, float, bool] = (False, 0.0, False)
    _mean: CycleMean = field(default_factory=CycleMean)
    _levels: levels.Levels = field(default_factory=levels.Levels)
    _velocity: bool = field(init=False)
    _identified: bool = field(init=False)
    _estimator: Estimator = field(init=False)

    def __post_init__(self) -> None:
        self._timing = self.timing or Timing.of(self.period_s)
        self._velocity = self.config.mode == "velocity"
        self._identified = is_identified(self.config.K_L)
        self.settings = {**shown(self.config), "method": self.config.estimator.method}
        self._estimator = self.make(self._estimator_settings())

    def _estimator_settings(self) -> EstimatorSettings:
        estimator, phases = self.config.estimator, self.config.excitation.two_phase
        two_phase = self.settings["two_phase"]
        free, delay_sd = two_phase or self._identified, known_to(self.config, "delay")
        return EstimatorSettings(
            method=self.settings["method"],
            K_L=self.settings["K_L"] or sum(gain_range(self.config.K_L)) / 2.0,
            hysteresis=self.settings["hysteresis"],
            delay_s=estimator.delay,
            period_s=self.period_s,
            cycles=max(estimator.cycles, 2 * phases.cycles) if two_phase else estimator.cycles,
            lowpass_hz=estimator.lowpass,
            lag_s=self.lag_s,
            K_L_sd=math.inf if free else known_to(self.config, "K_L") or 0.0,
            delay_sd=math.inf if two_phase else self._timing.delay_sd if delay_sd is None else delay_sd,
            resolution=self.resolution,
            integrated=self._velocity,
        )

    def change(self, values: dict[str, Any]) -> None:
        """New settings are in force: the estimator begins anew with them, unless they were so already."""
        changed = {key: value for key, value in values.items() if self.settings.get(key, value) != value}
        if not changed:
            return
        self.settings.update(changed)
        if changed.keys() == {"K_L"} and self._identified and self.settings["method"] == "wave":
            return  # it is the estimator's own
        if not INCOMPARABLE.isdisjoint(changed):
            self._levels = levels.Levels()
            self._estimator = self.make(self._estimator_settings())
        else:
            self._renew()

    def _renew(self) -> None:
        """An estimator of what is in force and known now; what it learnt of the rig's delay still holds."""
        before, self._estimator = self._estimator, self.make(self._estimator_settings())
        self._estimator.inherit(before)

    def interrupted(self) -> None:
        """Rows are missing: what the estimator holds does not go on."""
        self._estimator.reset()

    def feed(self, rows: Sequence[RowTuple]) -> list[Estimate]:
        """Take the newest rows; returns the answers they brought.

        Raises:
            ValueError, ArithmeticError: The estimator could not compute; it has been reset.
        """
        answers = []
        for values in rows:
            row, foreign = self._row(values), bool(values[Column.FLAGS] & FLAG_FOREIGN)
            if (row.exciting, row.e_a, foreign) != self._running:
                self._running = (row.exciting, row.e_a, foreign)
                self._renew()
            try:
                answer = self._estimator.update(row)
            except (ValueError, ArithmeticError):
                self._estimator.reset()
                raise
            self._mean.add(row, values[Column.Y])
            if answer is not None and self.fault is None:
                answer = self._timing.weigh(self._with_conditions(answer, values))
                if foreign:
                    answer = replace(answer, quality="fault", advice=_FOREIGN)
                self.estimate = self._at_its_level(row.e_a, answer)
                answers.append(self.estimate)
        self.stale = False
        return answers

    def _row(self, values: RowTuple) -> Row:
        """The row as estimators know it: in velocity mode the relay's input stands for the position."""
        t, y, reference, u, t_u, e_a, bias, signal, _, _, K_L, _, flags = values
        speed = math.nan
        if self._velocity:
            speed, y, reference = y, -signal, 0.0
        exciting, fresh = bool(flags & FLAG_EXCITING), bool(flags & FLAG_FRESH)
        saturated, second = bool(flags & FLAG_SATURATED), bool(flags & FLAG_SECOND_PHASE)
        K_L = math.nan if self._identified else K_L  # what is put in force is no change of the plant
        return Row(t, y, u, t_u, reference, e_a, bias, exciting, fresh, K_L, saturated, second, speed)

    def _with_conditions(self, answer: Estimate, values: RowTuple) -> Estimate:
        """The answer with what the loop measured beside it; in velocity mode with the speed itself."""
        ps, temperature, K_L = values[Column.PS], values[Column.TEMPERATURE], values[Column.K_L]
        if answer.mean_speed is not None and self._velocity:
            answer = replace(answer, mean_speed=self._mean.value())
        if answer.K_L is None and not self._identified:
            answer = replace(answer, K_L=finite_or_none(K_L))
        return replace(answer, ps=finite_or_none(ps), temperature=finite_or_none(temperature))

    def _at_its_level(self, e_a: float, answer: Estimate) -> Estimate:
        """The answer, with what others at other amplitudes say to it."""
        if answer.quality != "ok":
            return answer
        finding = self._levels.compare(e_a, answer)
        if finding is None or not finding.matters:
            return replace(answer, e_a_dependence=finding)
        return replace(
            answer, e_a_dependence=finding, quality="nonlinear", advice=levels.advise(e_a, finding)
        )

    def reconcile(self, t: float, state: int) -> None:
        """Believe the newest row, of time `t` [s], where a state event was lost."""
        name = AxisState(state).name.lower()
        if name != self.state and t > self._state_t + _STATE_SETTLES_S:
            self.enter(t, name)

    def enter(self, t: float, state: str) -> None:
        """The loop says that the axis is in this state since `t` [s]."""
        self._state_t = t
        if self.state == "fault" and state != "fault":
            self.fault = self.estimate = None  # which said that there is a fault
        self.state = state
        if state != "fault":
            return
        if self.fault is None:
            self.fail({"t": t, "code": "unknown", "why": "the reason was lost", "numbers": {}})

    def fail(self, event: dict[str, Any]) -> None:
        """The axis is in fault: what was known of the plant holds no longer."""
        self.state = "fault"
        self._state_t = event["t"]
        self.fault = {key: event.get(key) for key in ("code", "why", "numbers", "t")}
        self._estimator.reset()
        method = self.settings["method"]
        self.estimate = Estimate(event["t"], method, "fault", advice=f"{event['why']}; reset when it is safe")

    def restarted(self, t: float) -> None:
        """A new loop begins with the rig file's relay."""
        self.enter(t, "idle")
        self.change(shown(self.config))

    def newest(self, now: float) -> dict[str, Any] | None:
        """The `estimate` message of the newest answer, or None if there is none yet."""
        if self.estimate is None:
            return None
        if self.stale and self.fault is None:
            advice = "no rows come from the loop: is it running?"
            return message(self.name, replace(self.estimate, quality="stale", advice=advice), now)
        return message(self.name, self.estimate, now)

    def whole(self, now: float) -> dict[str, Any]:
        """The answer to `get`."""
        estimate = self.newest(now)
        return {
            "axis": self.name,
            "state": self.state,
            "fault": self.fault,
            "estimate": estimate,
            "controller": of_estimate(estimate),
            "second_phase": self.second_phase,
            "settings": dict(self.settings),
            "units": self.config.setting_units,
        }
