"""The physical plant as the real-time loop runs it: the face of `sim.plant.Plant`. Imports numba."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.compiled import Record, compiled
from sim.hydraulics import motion
from sim.hydraulics.linear import rest_pressures
from sim.hydraulics.motion import STATE, new_state

if TYPE_CHECKING:
    import numpy.typing as npt

_T, _ORIGIN, _SPOOL, _A, _B, _VELOCITY, _POSITION = (
    (STATE.names or ()).index(name)
    for name in ("t", "origin", "spool", "pressure_a", "pressure_b", "velocity", "position")
)


@compiled
def feed(p: Record, s: Record, t: float, volts: float) -> None:
    """Have a command [V] arrive at the spool's motor at `t` [s]; the arrays have one element."""
    motion.advance(p[0], s[0], t)
    motion.command(p[0], s[0], volts)


@compiled
def sight(p: Record, s: Record, t: float) -> float:
    """What the sensor sees at `t` [s], before noise and counts; the arrays have one element."""
    motion.advance(p[0], s[0], t)
    return motion.measured(p[0], s[0])


class HydraulicPlant:
    """A physical plant on the time line that it is handed; earlier times are taken as the latest known.

    Args:
        record: Its parameters, shape (1,) of `sim.hydraulics.record.RECORD`.
        t: When it begins to exist [s], standing still, valve in its null.
        position: Where [unit].
    """

    def __init__(self, record: npt.NDArray[np.void], t: float = 0.0, position: float = 0.0) -> None:
        self._record = record.copy()
        self._state = new_state(self._record, rest_pressures(record, position), t, position)
        self._values = self._state.view(np.float64).data
        self._delay = float(record["valve_delay"][0])
        self._under_way: deque[tuple[float, float]] = deque()
        _have_compiled(self._record, self._state, t)

    def command(self, t: float, volts: float) -> None:
        """A command [V] leaves for the valve at `t` [s]; it arrives after the valve's delay."""
        if self._delay == 0.0 and not self._under_way:
            feed(self._record, self._state, t, volts)
        else:
            self.advance(t)
            self._under_way.append((max(t, self.t) + self._delay, volts))

    def advance(self, t: float) -> None:
        """Bring the plant to `t` [s]."""
        self.measured(t)

    def measured(self, t: float) -> float:
        """What the sensor sees at `t` [s], before noise and counts [unit, or unit/s]."""
        while self._under_way and self._under_way[0][0] <= t:
            feed(self._record, self._state, *self._under_way.popleft())
        return sight(self._record, self._state, t)

    def change(self, t: float, record: npt.NDArray[np.void]) -> None:
        """Have other parameters from `t` [s] on; the movement and the pressures go on from where they are."""
        seen, old, new, state = self.measured(t), self._record[0].copy(), record[0], self._state[0]
        self._record[0] = new
        self._delay = float(new["valve_delay"])
        if old["sensor_lag_time"] == 0.0:
            state["lagged"] = seen
        if old["load_second"] == 0.0:
            state["position2"], state["velocity2"] = state["position"], state["velocity"]
        motion.surroundings(self._record[0], state, float(state["supply"]), float(state["warmth"]))
        if state["velocity"] != 0.0:
            state["motion"] = np.sign(state["velocity"])

    def condition(self, t: float, supply: float, warmth: float) -> None:
        """Have `supply` times the rig file's pressure, `warmth` [K] above nominal, from `t` [s] on."""
        self.advance(t)
        motion.surroundings(self._record[0], self._state[0], float(supply), float(warmth))

    def place(self, t: float, position: float) -> None:
        """Move the load to a position [unit] at `t` [s]; its speed and the pressures stay."""
        self.advance(t)
        state = self._state[0]
        by = position - state["position"]
        state["position2"] += by
        if not self._record["measures_speed"][0]:
            state["lagged"] += by
        state["position"] = position
        if state["stopped"]:
            state["stopped"], state["motion"] = 0.0, 1.0

    @property
    def t(self) -> float:
        """How far it has come [s]."""
        return self._values[_T]

    @property
    def since(self) -> float:
        """How long its ripple has been running [s]."""
        return self._values[_T] - self._values[_ORIGIN]

    @property
    def spool(self) -> float:
        """Where the spool stands, in volts."""
        return self._values[_SPOOL]

    @property
    def pressure(self) -> float:
        """Difference of the chambers' pressures [Pa]."""
        return self._values[_A] - self._values[_B]

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
        """Where the sensor sits [unit]."""
        return self._values[_POSITION]


def _have_compiled(record: npt.NDArray[np.void], state: npt.NDArray[np.void], t: float) -> None:
    """Have the entry points now, and never compile one later: a whole number for a float would do that."""
    feed(record, state, float(t), 0.0)
    sight(record, state, float(t))
    for entry in (feed, sight):
        dispatcher: Any = entry
        dispatcher.disable_compile()  # such numbers are converted
