"""One axis as the gateway sees it: its state, its settings, its estimator and the newest answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from seod.estimate.base import Estimate, EstimatorSettings, Row
from seod.ring import FLAG_EXCITING, FLAG_FRESH, AxisState

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.config.model import AxisConfig
    from seod.estimate.base import Estimator

RowTuple = tuple[float, float, float, float, float, float, float, float, int, int]
"""One axis of a row in the order of `seod.ring.AXIS_FIELDS`, then state and flags."""

LOOP_SETTINGS = ("e_a", "hysteresis", "bias")
"""Settings that the loop keeps; the others are the estimator's."""

_STATE_SETTLES_S = 0.1
"""A row this much newer than the last state event is believed where the two differ: an event was lost."""


@dataclass(slots=True)
class Axis:
    """Fed with rows and events; `estimate` is the newest answer, `fault` the reason of the present fault."""

    name: str
    config: AxisConfig
    period_s: float
    make: Callable[[EstimatorSettings], Estimator]
    settings: dict[str, Any] = field(init=False)
    state: str = "idle"
    fault: dict[str, Any] | None = None
    estimate: Estimate | None = None
    stale: bool = False
    _state_t: float = -math.inf
    _running: tuple[bool, float, float] = (False, 0.0, 0.0)
    _estimator: Estimator = field(init=False)

    def __post_init__(self) -> None:
        self.settings = {**self._configured(), "K_L": self.config.K_L, "method": self.config.estimator.method}
        self._estimator = self.make(self._estimator_settings())

    def _configured(self) -> dict[str, float]:
        relay = self.config.relay
        return {"e_a": relay.e_a, "hysteresis": relay.hysteresis, "bias": relay.bias}

    def _estimator_settings(self) -> EstimatorSettings:
        estimator = self.config.estimator
        return EstimatorSettings(
            method=self.settings["method"],
            K_L=self.settings["K_L"],
            hysteresis=self.settings["hysteresis"],
            delay_s=estimator.delay,
            period_s=self.period_s,
            cycles=estimator.cycles,
            lowpass_hz=estimator.lowpass,
        )

    def change(self, values: dict[str, Any]) -> None:
        """New settings are in force: the estimator begins anew with them."""
        self.settings.update({key: values[key] for key in values if key in self.settings})
        self._estimator = self.make(self._estimator_settings())

    def interrupted(self) -> None:
        """Rows are missing: what the estimator holds does not go on."""
        self._estimator.reset()

    def feed(self, rows: Sequence[RowTuple]) -> list[Estimate]:
        """Take the newest rows; returns the answers they brought.

        Raises:
            ValueError, ArithmeticError: The estimator could not compute; it has been reset.
        """
        answers = []
        for t, y, reference, u, t_u, e_a, bias, _, _, flags in rows:
            exciting = bool(flags & FLAG_EXCITING)
            if (exciting, e_a, bias) != self._running:
                self._running = (exciting, e_a, bias)
                self._estimator.reset()
            row = Row(t, y, u, t_u, reference, e_a, bias, exciting, bool(flags & FLAG_FRESH))
            try:
                answer = self._estimator.update(row)
            except (ValueError, ArithmeticError):
                self._estimator.reset()
                raise
            if answer is not None and self.fault is None:
                self.estimate = answer
                answers.append(answer)
        self.stale = False
        return answers

    def reconcile(self, t: float, state: int) -> None:
        """Believe the newest row, of time `t` [s], where a state event was lost."""
        name = AxisState(state).name.lower()
        if name != self.state and t > self._state_t + _STATE_SETTLES_S:
            self.enter(t, name)

    def enter(self, t: float, state: str) -> None:
        """The loop says that the axis is in this state since `t` [s]."""
        self._state_t = t
        self.state = state
        if state != "fault":
            self.fault = None
        elif self.fault is None:
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
        self.change(self._configured())

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
        return {
            "axis": self.name,
            "state": self.state,
            "fault": self.fault,
            "estimate": self.newest(now),
            "settings": dict(self.settings),
        }


def message(axis: str, estimate: Estimate, now: float) -> dict[str, Any]:
    """The `estimate` notification; supply pressure and temperature are null: no sensor gives them yet."""
    return {
        "axis": axis,
        "t": estimate.t,
        "age_s": now - estimate.t,
        "zeta": estimate.zeta,
        "zeta_sd": estimate.zeta_sd,
        "omega_n": estimate.omega_n,
        "omega_n_sd": estimate.omega_n_sd,
        "K_L": estimate.K_L,
        "K_L_sd": estimate.K_L_sd,
        "delay_s": estimate.delay_s,
        "frequency": estimate.frequency,
        "amplitude": estimate.amplitude,
        "asymmetry": estimate.asymmetry,
        "mean_speed": estimate.mean_speed,
        "ps": None,
        "temperature": None,
        "fitness": estimate.fitness,
        "method": estimate.method,
        "quality": estimate.quality,
        "advice": estimate.advice,
    }


def sample_message(axis: str, tick: int, row: RowTuple) -> dict[str, Any]:
    """The `sample` notification of one row; `signal` is the relay's input e."""
    t, y, reference, u, t_u, e_a, _, signal, state, flags = row
    return {
        "axis": axis,
        "tick": tick,
        "t": t,
        "y": y,
        "u": u,
        "t_u": t_u,
        "reference": reference,
        "signal": signal,
        "e_a": e_a,
        "state": AxisState(state).name.lower(),
        "fresh": bool(flags & FLAG_FRESH),
    }
