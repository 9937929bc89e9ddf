"""A motor and its valve as hydraulics' own equations, under scipy's solver: nothing of `sim` is in it.

    J dv/dt = D p                     torque turns the load
    C dp/dt = q (u - null) - D v - c p    what the valve lets in turns the motor, leaks, or is compressed

p is the load pressure. Eliminating p gives Eq. 1 with K_L = q / D, omega_n^2 = D^2 / (C J) and
2 zeta omega_n = c / C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import BaseModel
from scipy.integrate import ode

from drivers.base import Channel, Driver, Sample

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


@dataclass(frozen=True)
class Motor:
    """SI units: of a motor of 25 cm^3 a revolution, whose load is chosen to give omega_n."""

    K_L: float
    omega_n: float
    zeta: float
    null: float = 0.0

    D: ClassVar[float] = 4e-6
    """Displacement [m^3/rad]."""
    C: ClassVar[float] = 5e-14
    """Compliance of the oil [m^3/Pa]."""

    @property
    def J(self) -> float:
        return self.D**2 / (self.C * self.omega_n**2)

    @property
    def leakage(self) -> float:
        return 2.0 * self.zeta * self.omega_n * self.C

    @property
    def q(self) -> float:
        """Flow of the valve [m^3/s/V]."""
        return self.K_L * self.D

    def slope(self, _t: float, state: Sequence[float], u: float) -> list[float]:
        """Of the state: angle [rad], speed [rad/s], load pressure [MPa]."""
        _, v, p = state
        into = self.q * (u - self.null) - self.D * v - self.leakage * 1e6 * p
        return [v, self.D * 1e6 * p / self.J, into / (1e6 * self.C)]


class OdeDriver(Driver):
    """One input, the speed of the motor [rad/s], and one output, the valve [V]."""

    Options = BaseModel
    push = False
    counter_names: ClassVar[tuple[str, ...]] = ()

    def __init__(self, motor: Motor, clock: Callable[[], float], noise: float) -> None:
        super().__init__(None, clock)
        self.solver = ode(motor.slope).set_integrator("dopri5", rtol=1e-9, atol=1e-9)
        self.solver.set_initial_value([0.0, 0.0, 0.0], clock()).set_f_params(0.0)
        self.noise, self.random = noise, np.random.default_rng(5)
        self.angles: dict[float, float] = {}
        """Where the shaft stood at each reading."""

    @classmethod
    def channels(cls, options: Any) -> tuple[Channel, ...]:
        return ()

    def open(
        self, inputs: Sequence[str], outputs: Sequence[str], neutral: Sequence[float] | None = None
    ) -> None:
        assert (len(inputs), len(outputs)) == (1, 1)

    def start(self) -> None:
        """It has always been there."""

    def advance(self, t: float) -> None:
        if t > self.solver.t:
            self.solver.integrate(t)
            assert self.solver.successful()

    def read(self, t: float) -> list[Sample]:
        self.advance(t)
        angle, speed, _ = self.solver.y
        self.angles[t] = angle
        return [Sample(speed + self.noise * self.random.standard_normal(), t)]

    def write(self, t: float, values: Sequence[float]) -> float:
        self.advance(t)
        self.solver.set_initial_value(self.solver.y, self.solver.t).set_f_params(values[0])
        return t

    def neutral(self, t: float) -> float:
        return self.write(t, [0.0])

    def close(self) -> None:
        self.angles.clear()
