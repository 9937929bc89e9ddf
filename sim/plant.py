"""The kernel as the real-time loop runs it: one plant, commanded and looked at as time goes on.

Importing this imports numba. The entry points take whole arrays: a call with those costs 1 us, with single
records 8 us.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from sim import kernel
from sim.compiled import Record, compiled
from sim.physics import rectified, spool_moves, swings
from sim.state import STATE, new_state

if TYPE_CHECKING:
    import numpy.typing as npt

_T, _ORIGIN, _TARGET, _SPOOL, _PRESSURE, _VELOCITY, _POSITION, _FOLLOWED = (
    (STATE.names or ()).index(name)
    for name in ("t", "origin", "target", "spool", "pressure", "velocity", "position", "followed")
)


@compiled
def arrive(p: Record, s: Record, t: float, volts: float) -> None:
    """Have a command [V] arrive at the valve at `t` [s]; the arrays have one element."""
    kernel.advance(p[0], s[0], t)
    kernel.command(p[0], s[0], volts)


@compiled
def look(p: Record, s: Record, t: float) -> float:
    """What the sensor sees at `t` [s], before noise and quantisation; the arrays have one element."""
    kernel.advance(p[0], s[0], t)
    return kernel.measured(p[0], s[0])


class Plant:
    """A plant on the time line that it is handed. Times before the latest known are taken as that one.

    Args:
        record: Its parameters, shape (1,) of `sim.parameters.PARAMETERS`.
        t: When it begins to exist [s], standing still.
        position: Where [unit].
    """

    __slots__ = ("_delay", "_record", "_state", "_under_way", "_values")

    def __init__(self, record: npt.NDArray[np.void], t: float = 0.0, position: float = 0.0) -> None:
        self._record = record.copy()
        self._state = new_state(self._record, t, position)
        self._values = self._state.view(np.float64).data
        self._delay = float(record["transport_delay_time"][0])
        self._under_way: deque[tuple[float, float]] = deque()
        _have_compiled(self._record, self._state, t)

    def command(self, t: float, volts: float) -> None:
        """A command [V] leaves for the valve at `t` [s]; it arrives after the transport delay."""
        if self._delay == 0.0 and not self._under_way:
            arrive(self._record, self._state, t, volts)
        else:
            self.advance(t)
            self._under_way.append((max(t, self.t) + self._delay, volts))

    def advance(self, t: float) -> None:
        """Bring the plant to `t` [s]."""
        self.measured(t)

    def measured(self, t: float) -> float:
        """What the sensor sees at `t` [s], before noise and quantisation [unit, or unit/s]."""
        if self._under_way:
            self._deliver(t)
        return look(self._record, self._state, t)

    def _deliver(self, t: float) -> None:
        while self._under_way and self._under_way[0][0] <= t:
            arrive(self._record, self._state, *self._under_way.popleft())

    def change(self, t: float, record: npt.NDArray[np.void]) -> None:
        """Have other parameters from `t` [s] on; the movement goes on from where it is.

        Commands that are under way keep their time of arrival. Drift and disturbance begin anew if they are
        not what they were.
        """
        seen, old, new, state = self.measured(t), self._record[0].copy(), record[0], self._state[0]
        self._record[0] = new
        self._delay = float(new["transport_delay_time"])
        if old["sensor_lag_time"] == 0.0:
            state["lagged"] = seen
        if old["load_resonance_inertia"] == 0.0:
            state["position2"], state["velocity2"] = state["position"], state["velocity"]
        if not swings(old):
            state["spool_speed"] = 0.0
        if old["lugre_friction_stiffness"] == 0.0:
            state["bristle"] = 0.0
        if _clocked(old) != _clocked(new):
            state["origin"] = self.t

    def condition(self, t: float, supply: float, warmth: float) -> None:
        """Have `supply` times the nominal pressure, and `warmth` [K] above nominal, from `t` [s] on."""
        self.advance(t)
        self._state["supply"], self._state["warmth"] = supply, warmth

    def place(self, t: float, position: float) -> None:
        """Move the load to a position [unit] at `t` [s], with all that hangs on it; its speed stays."""
        self.advance(t)
        state = self._state[0]
        by = position - state["position"]
        for name in ("position2", "followed"):
            state[name] += by
        if not self._record["measures_speed"][0]:
            state["lagged"] += rectified(self._record[0], position) - rectified(
                self._record[0], state["position"]
            )
        state["position"], state["stopped"] = position, 0.0

    @property
    def t(self) -> float:
        """How far it has come [s]."""
        return self._values[_T]

    @property
    def since(self) -> float:
        """How long it drifts already [s]."""
        return self._values[_T] - self._values[_ORIGIN]

    @property
    def spool(self) -> float:
        """Where the spool stands, in volts."""
        moves = spool_moves(self._record[0])
        return self._values[_SPOOL if moves else _TARGET]

    @property
    def pressure(self) -> float:
        """Load pressure as the acceleration of the free load [unit/s^2]."""
        return self._values[_PRESSURE]

    @property
    def velocity(self) -> float:
        """Speed of the load [unit/s]."""
        return self._values[_VELOCITY]

    @property
    def position(self) -> float:
        """Position of the load [unit]."""
        return self._values[_POSITION]

    @property
    def shaft(self) -> float:
        """Position behind the backlash, where the sensor sits [unit]."""
        return self._values[_FOLLOWED]


def _have_compiled(record: npt.NDArray[np.void], state: npt.NDArray[np.void], t: float) -> None:
    """Have the entry points now, and never compile one later: a whole number for a float would do that."""
    arrive(record, state, float(t), 0.0)
    look(record, state, float(t))
    for entry in (arrive, look):
        dispatcher: Any = entry
        dispatcher.disable_compile()  # such numbers are converted


def _clocked(record: Any) -> list[float]:
    """Parameters of what depends on time itself."""
    groups = ("parameter_drift_", "periodic_disturbance_", "load_bias_drift")
    return [float(record[name]) for name in record.dtype.names if name.startswith(groups)]
