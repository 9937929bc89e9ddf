"""What an experiment runs: the reduced kernel or the physical plant, behind one face. Imports numba."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from sim.hydraulics import closed_loop, motion
from sim.hydraulics.flow import set_pressure
from sim.hydraulics.linear import rest_pressures, small_signal
from sim.hydraulics.record import record_of
from sim.parameters import plant_parameters
from sim.physics import spool_forgets
from sim.runs import follow, sampled_relay
from sim.state import new_state

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.config import PlantConfig

    Array = NDArray[np.float64]
    Around = tuple[Array, Array, Array]
    """By rows: supply pressure over nominal, temperature above nominal [K], a measured disturbance."""

NONE = np.empty(0)
"""For the kernels: nothing of the kind."""
SETTLING = 20.0
"""A plant has settled after so many of its slowest time constant; what is left is exp(-20)."""


class Machine(Protocol):
    """One plant in time.

    Attributes:
        p: The kernel's parameters, shape (1,).
        state: The kernel's state, shape (1,): `state["t"]` tells how far it has come, also while it runs.
    """

    p: NDArray[np.void]
    state: NDArray[np.void]

    def surround(self, supply: Array, warmth: Array) -> None:
        """Begin in the surroundings of the first row of these, where they have rows.

        Args:
            supply: Supply pressure over nominal, shape (n,) or (0,).
            warmth: Temperature above nominal [K], likewise.
        """

    def settling(self, volts: float) -> float:
        """After which nothing is left of how it began, a command [V] held [s].

        Raises:
            ValueError: A physical plant has no steady state at rest.
        """

    def follow(self, t_u: Array, u: Array, t: Array, noise: Array, around: Around) -> Array:
        """What is measured under given commands.

        Args:
            t_u: When they leave [s], ascending, shape (m,).
            u: Commands [V], shape (m,).
            t: Times of samples [s], ascending, shape (n,).
            noise: Of the sensor [unit, or unit/s], shape (n,) or (0,).
            around: Surroundings, shape (n,) or (0,) each.

        Returns:
            Readings [unit, or unit/s], shape (n,).
        """

    def relay(
        self, relay: NDArray[np.void], t: Array, noise: Array, around: Around
    ) -> tuple[Array, Array, Array]:
        """In a relay's loop.

        Args:
            relay: Shape (1,) of `sim.runs.RELAY`.
            t: Ticks at which it looks [s], shape (n,).
            noise: Of the sensor [unit, or unit/s], shape (n,) or (0,).
            around: Surroundings, likewise.

        Returns:
            Readings [unit, or unit/s], commands [V] and when these leave [s]: shape (n,) each.
        """

    def forget_readings(self) -> None:
        """Of a sensor that holds them: the next reading is a new one."""


class ReducedMachine:
    """The kernel of `sim.kernel`; a `Machine`."""

    def __init__(self, plant: PlantConfig, t: float) -> None:
        self.p = plant_parameters(plant)
        self.state = new_state(self.p, t, plant.position)

    def surround(self, supply: Array, warmth: Array) -> None:
        """Begin in the surroundings of the first row."""
        if len(supply):
            self.state["supply"] = supply[0]
        if len(warmth):
            self.state["warmth"] = warmth[0]

    def settling(self, volts: float) -> float:  # noqa: ARG002 - the linear plant settles alike everywhere
        """By Eq. 1 and the lags [s]."""
        p = self.p[0]
        lags = spool_forgets(p) + float(p["sensor_lag_time"])
        slowest = _slowest(float(p["omega_n"]), float(p["zeta"]))
        return SETTLING * (1.0 / slowest + lags) + float(p["transport_delay_time"])

    def follow(self, t_u: Array, u: Array, t: Array, noise: Array, around: Around) -> Array:
        """`sim.runs.follow`."""
        y = np.empty(len(t))
        follow(self.p[0], self.state[0], t_u, u, t, noise, *around, y)
        return y

    def relay(
        self, relay: NDArray[np.void], t: Array, noise: Array, around: Around
    ) -> tuple[Array, Array, Array]:
        """`sim.runs.sampled_relay`."""
        y, u, t_u = np.empty((3, len(t)))
        sampled_relay(self.p[0], self.state[0], relay[0], t, noise, *around, y, u, t_u)
        return y, u, t_u

    def forget_readings(self) -> None:
        """The next is a new one."""
        self.state["taken"] = -np.inf


class HydraulicMachine:
    """The physical plant of `sim.hydraulics`; a `Machine`. No disturbance is measured there."""

    def __init__(self, plant: PlantConfig, t: float) -> None:
        self.p = record_of(plant)
        self.state = motion.new_state(self.p, rest_pressures(self.p, plant.position), t, plant.position)

    def surround(self, supply: Array, warmth: Array) -> None:
        """Begin in the surroundings of the first row."""
        now = float(supply[0]) if len(supply) else 1.0
        motion.surroundings(self.p[0], self.state[0], now, float(warmth[0]) if len(warmth) else 0.0)
        self.state["pressure_s"] = set_pressure(self.p[0], self.state[0], float(self.state["t"][0]))

    def settling(self, volts: float) -> float:
        """By its small signals about the speed that these volts make [s].

        Raises:
            ValueError: It has no steady state at rest.
        """
        still = small_signal(self.p)
        try:
            small = small_signal(self.p, speed=still.K_L * volts) if volts else still
        except ValueError:
            small = still
        p = self.p[0]
        lags = 1.0 / float(p["valve_omega"]) + float(p["sensor_lag_time"])
        slowest = min(_slowest(each.omega_n, each.zeta) for each in (still, small))
        return SETTLING * (1.0 / slowest + lags) + float(p["valve_delay"])

    def follow(self, t_u: Array, u: Array, t: Array, noise: Array, around: Around) -> Array:
        """`closed_loop.follow`."""
        y = np.empty(len(t))
        closed_loop.follow(
            self.p[0], self.state[0], t_u, u, t, noise, around[0], around[1], y, np.empty((0, 6))
        )
        return y

    def relay(
        self, relay: NDArray[np.void], t: Array, noise: Array, around: Around
    ) -> tuple[Array, Array, Array]:
        """`closed_loop.relay`."""
        y, u, t_u = np.empty((3, len(t)))
        none = np.empty((0, 6))
        p, s, supply, warmth = self.p[0], self.state[0], around[0], around[1]
        closed_loop.relay(p, s, relay[0], t, noise, supply, warmth, NONE, NONE, 0.0, y, u, t_u, none)
        return y, u, t_u

    def forget_readings(self) -> None:
        """It holds none."""


def _slowest(omega_n: float, zeta: float) -> float:
    """Rate of the slowest part of Eq. 1 [1/s]."""
    return zeta * omega_n if zeta <= 1.0 else omega_n / (zeta + float(np.sqrt(zeta * zeta - 1.0)))


def make_machine(plant: PlantConfig, t: float) -> Machine:
    """The plant of a rig file's section, standing still at `t` [s]."""
    return ReducedMachine(plant, t) if plant.hydraulic is None else HydraulicMachine(plant, t)
