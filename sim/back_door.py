"""What can be asked of a simulated rig behind the daemon's back: its truth, and faults."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import ConfigDict, TypeAdapter

from sim.faults import KINDS, Fault
from sim.sensor_config import Finite

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from sim.actuator import Actuator
    from sim.faults import FaultLine
    from sim.rig import SimulatedRig


_NUMBER: TypeAdapter[float] = TypeAdapter(Finite, config=ConfigDict(strict=True))


class BackDoor:
    """The methods of the control port.

    Args:
        rig: What is simulated.
        faults: What its sensor frames pass.
        messages: Names of these messages.
        report: State of the connection.
        clock: The rig's time [s].

    Attributes:
        methods: Name -> function of `params`. Each raises ValueError about params that are not right.
    """

    def __init__(
        self,
        rig: SimulatedRig,
        faults: FaultLine,
        messages: Collection[str],
        report: Callable[[], dict[str, object]],
        clock: Callable[[], float],
    ) -> None:
        self._rig = rig
        self._faults = faults
        self._messages = messages
        self._report = report
        self._clock = clock
        self.methods: dict[str, Callable[[dict[str, Any]], object]] = {
            "truth": self.truth,
            "state": self.state,
            "history": self.history,
            "set": self.set,
            "constant": self.constant,
            "fault": self.fault,
            "clear": self.clear,
            **{kind: self._fault_of(kind) for kind in KINDS},
        }

    def truth(self, _params: dict[str, Any]) -> object:
        """K_L, omega_n and zeta of each plant for small movements."""
        return self._rig.truth()

    def state(self, _params: dict[str, Any]) -> object:
        """All that can be known now: the connection, the plants, the faults and how often they struck."""
        now = self._clock()
        faults = {kind: fault.model_dump(exclude_none=True) for kind, fault in self._faults.active.items()}
        return {
            "t": now,
            **self._report(),
            "faults": faults,
            "struck": self._faults.counts,
            "constants": self._rig.constants,
            "plants": self._rig.state(now),
        }

    def history(self, params: dict[str, Any]) -> object:
        """`plant` -> its last commands as [time, volts]."""
        return list(self._plant(params).history)

    def set(self, params: dict[str, Any]) -> object:
        """`plant` and new values of its parameters, effects by name -> the truth."""
        plant = self._plant(params)
        plant.change(self._clock(), {name: value for name, value in params.items() if name != "plant"})
        return self._rig.truth()

    def constant(self, params: dict[str, Any]) -> object:
        """`channel`, `value`: what a constant input says from now on, such as an e-stop line or pressure."""
        channel, value = params.get("channel"), params.get("value")
        self._rig.set_constant(self._clock(), str(channel), _NUMBER.validate_python(value))
        return self._rig.constants

    def fault(self, params: dict[str, Any]) -> object:
        """A `sim.faults.Fault` -> all that are active."""
        fault = Fault.model_validate(params)
        if fault.message is not None and fault.message not in self._messages:
            raise ValueError(f"no message {fault.message!r}; the rig sends {', '.join(self._messages)}")
        self._faults.set(self._clock(), fault)
        return list(self._faults.active)

    def _fault_of(self, kind: str) -> Callable[[dict[str, Any]], object]:
        return lambda params: self.fault({**params, "kind": kind})

    def clear(self, _params: dict[str, Any]) -> object:
        """No faults any more."""
        self._faults.clear()
        return []

    def _plant(self, params: dict[str, Any]) -> Actuator:
        actuators = self._rig.actuators
        name = params.get("plant", next(iter(actuators)) if len(actuators) == 1 else None)
        if not isinstance(name, str) or name not in actuators:
            raise ValueError(f"no plant {name!r}; there are {', '.join(actuators)}")
        return actuators[name]
