"""What a rig tells the fleet, made of what its gateway tells: no sockets, time is an argument."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from seod.config.model import RigConfig

    Message = dict[str, Any]
    Put = Callable[[str, Message], None]

ESTIMATE: Final = (
    "t", "age_s", "zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd", "delay_s", "frequency",
    "amplitude", "asymmetry", "ps", "temperature", "misfit", "method", "quality", "advice",
)  # fmt: skip
"""Fields of an estimate that are told on."""
HEALTH: Final = ("t", "ticks", "rate_hz", "overruns", "rows_lost", "events_lost", "realtime", "recorder")
STATES: Final = ("fault", "exciting", "holding", "armed", "idle")
"""The rig's state is the first of these that an axis is in."""


class Teller:
    """Knows the newest of the rig, and makes messages of what changes.

    Args:
        config: The rig file.
        put: Takes a topic's suffix and a body.
        store: Tells how the store does, for `health`.
    """

    def __init__(self, config: RigConfig, put: Put, store: Callable[[], Message]) -> None:
        self._put, self._store = put, store
        self._health_s = 10.0 if config.mqtt is None else config.mqtt.health
        self._health_at = float("-inf")
        self.axes: dict[str, Message] = {name: _axis() for name in config.axes}
        self._settings: dict[str, Message] = {name: {} for name in config.axes}
        self.gateway = False
        """Whether the gateway is there."""

    def state(self) -> Message:
        """The rig's state, and that of each axis."""
        states = {axis["state"] for axis in self.axes.values()}
        worst = next((state for state in STATES if state in states), "unknown")
        return {"state": worst, "gateway": self.gateway, "axes": self.axes}

    def began(self, status: Message, at: float) -> None:
        """The gateway was reached: its answer to `status`, at UTC `at` [s]."""
        self.gateway = True
        for name, told in status["axes"].items():
            axis = self.axes[name]
            axis["state"], axis["fault"] = told["state"], _fault(told["fault"])
            self._settings[name] = dict(told["settings"])
        self._tell_state(at)

    def lost(self, at: float) -> None:
        """The gateway is gone."""
        if self.gateway:
            self.gateway = False
            self._put("event", {"at": at, "event": "gateway", "axis": None, "why": "the gateway is gone"})
            self._tell_state(at)

    def heard(self, topic: str, params: Message, at: float) -> None:
        """A notification of the gateway, at UTC `at` [s]."""
        if topic == "estimate":
            self._estimate(params, at)
        elif topic == "event":
            self._event(params, at)
        elif topic == "model_error":
            self._model(params, at)
        elif topic == "health" and at - self._health_at >= self._health_s:
            self._health_at = at
            told = {key: params.get(key) for key in HEALTH}
            self._put("health", {"at": at, **told, "store": self._store()})

    def _estimate(self, params: Message, at: float) -> None:
        name = params["axis"]
        settings = {key: self._settings[name].get(key) for key in ("e_a", "reference")}
        body = {"at": at, "axis": name, **{key: params.get(key) for key in ESTIMATE}, **settings}
        axis = self.axes[name]
        model = {"left_model": axis["left_model"], "model_error": axis["model_error"]}
        self._put(f"estimate/{name}", body | model)

    def _event(self, params: Message, at: float) -> None:
        self._put("event", {"at": at, **params})
        before = repr(self.axes)
        kind, name = params["event"], params.get("axis")
        if kind == "fault":
            self._faulted(params.get("latched", self.axes), params)
        elif kind == "state" and name in self.axes:
            self.axes[name]["state"] = params["state"]
            if params["state"] != "fault":
                self.axes[name]["fault"] = None
        elif kind == "changed" and name in self.axes:
            self._settings[name] |= params["values"]
        elif kind == "started":
            for axis in self.axes.values():
                axis |= {"state": "idle", "fault": None}
        if repr(self.axes) != before:
            self._tell_state(at)

    def _faulted(self, names: Iterable[str], params: Message) -> None:
        for name in names:
            self.axes[name] |= {"state": "fault", "fault": _fault(params)}

    def _model(self, params: Message, at: float) -> None:
        axis = self.axes[params["axis"]]
        axis["model_error"] = params["nrmse"]
        if axis["left_model"] == params["left"]:
            return
        first = axis["left_model"] is None
        axis["left_model"] = params["left"]
        axis["left_since"] = at if params["left"] else None
        if params["left"] or not first:
            self._put("event", {"at": at, **params, "event": "model"})
        self._tell_state(at)

    def _tell_state(self, at: float) -> None:
        self._put("state", {"at": at, **self.state()})


def _axis() -> Message:
    told = ("fault", "left_model", "left_since", "model_error")
    return {"state": "unknown", **dict.fromkeys(told)}


def _fault(fault: Message | None) -> Message | None:
    return None if fault is None else {"code": fault["code"], "why": fault["why"]}
