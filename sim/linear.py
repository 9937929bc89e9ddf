"""What the plant is to small signals: its linearisation, and the K_L, omega_n and zeta nearest to Eq. 1.

What each effect does to them is in `docs/model.md`. Needs numpy alone: asking for the truth of a rig costs no
import of numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.jacobian import (
    POSITION,
    PRESSURE,
    READING,
    SPOOL,
    SPOOL_SPEED,
    STATES,
    VELOCITY,
    add_lags,
    dynamics,
    present,
    sensor,
)
from sim.parameters import SLOTS
from sim.steady import Conditions, Steady, at_speed, at_volts
from sim.valve_map import ValveMap

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    Matrix = npt.NDArray[np.float64]
    Complex = npt.NDArray[np.complex128]

TINY = 1e-300
"""Keeps the residues of two equal poles finite."""


@dataclass(frozen=True, slots=True, eq=False)
class SmallSignal:
    """The linearised plant: dx/dt = A x + B u(t - delay), measured C x; all are deviations from `steady`.

    Attributes:
        K_L: Gain from volts to speed as it is measured, lags left out [unit/s/V]; 0 where something blocks.
        omega_n: Undamped natural frequency of the dominant pair of poles [rad/s]; NaN where the load is held.
        zeta: Its damping ratio; likewise.
        delay: From the command to the valve [s].
        A: Shape (n, n), for the `states`.
        B: Shape (n,).
        C: Shape (n,).
        states: Names of the n states.
        steady: Where it was linearised; `steady.blocked` tells what keeps small changes from the measurement.
    """

    K_L: float
    omega_n: float
    zeta: float
    delay: float
    A: Matrix
    B: Matrix
    C: Matrix
    states: tuple[str, ...]
    steady: Steady

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """Eigenvalues of A [rad/s], those of lags and integrators among them."""
        return np.linalg.eigvals(self.A).astype(complex)

    def response(self, omega: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Measured change for each volt at frequencies above 0 [rad/s], any shape; the delay included."""
        s = 1j * np.asarray(omega, dtype=float)
        resolvent = s[..., None, None] * np.eye(len(self.B)) - self.A
        states = np.linalg.solve(resolvent, self.B[:, None].astype(complex))[..., 0]
        return np.asarray(states @ self.C * np.exp(-s * self.delay))


def small_signal(
    record: npt.NDArray[np.void],
    *,
    volts: float | None = None,
    speed: float = 0.0,
    direction: float = 1.0,
    position: float = 0.0,
    supply: float = 1.0,
    warmth: float = 0.0,
    since: float = 0.0,
) -> SmallSignal:
    """The plant about a steady state; without further arguments that of moving slowly in positive direction.

    Of a load that moves, position, drift and disturbance are taken as they are at that instant.

    Args:
        record: Shape (1,) of `sim.parameters.PARAMETERS`.
        volts: The held command [V]; speed and direction of the load then follow from it.
        speed: Of the load [unit/s].
        direction: -1, 1: where speed is 0 the load moves slowly this way, overlap, plays and friction passed;
            with `volts`, the side from which the spool came. 0: all is at rest, so that overlap, plays and
            friction block small signals.
        position: Of the load [unit].
        supply: Supply pressure over nominal.
        warmth: Temperature above nominal [K].
        since: Time since the start [s], for what drifts with it.

    Raises:
        ValueError: There is no such steady state, or no such plant; the message tells why.
    """
    p = dict(zip(SLOTS, (float(value) for value in record[0]), strict=True))
    c = Conditions(p, position, supply, warmth, since)
    _check(c, direction)
    steady = at_speed(c, speed, direction) if volts is None else at_volts(c, volts, direction)
    A, C = dynamics(c, steady), sensor(p, steady, position)
    K_L, omega_n, zeta = _equation_1(p, steady, A, C)
    B, C = add_lags(p, A, C)
    valve_map = ValveMap(p)
    worth = 1.0 if valve_map.at_ports else valve_map.slope(steady.volts, steady.direction or steady.side)
    keep = present(p)
    names = tuple(STATES[k] for k in keep)
    return SmallSignal(
        worth * K_L,
        omega_n,
        zeta,
        p["transport_delay_time"],
        A[np.ix_(keep, keep)],
        worth * B[keep],
        C[keep],
        names,
        steady,
    )


def _equation_1(p: Mapping[str, float], steady: Steady, A: Matrix, C: Matrix) -> tuple[float, float, float]:
    """K_L, omega_n and zeta of the plant that is left without lags, delay and integrator."""
    if steady.held:
        return 0.0, math.nan, math.nan
    core = [k for k in present(p) if k not in {SPOOL, SPOOL_SPEED, READING}]
    square, damping, others = _pair(A[np.ix_(core, core)])
    if not square > 0.0:
        return math.nan, math.nan, math.nan
    seen = C[VELOCITY if p["measures_speed"] else POSITION]
    K_L = seen * others * A[PRESSURE, SPOOL] * A[VELOCITY, PRESSURE] / square
    return float(K_L), math.sqrt(square), damping / (2.0 * math.sqrt(square))


def _check(c: Conditions, direction: float) -> None:
    if not (c.p["omega_n"] > 0.0 and c.p["zeta"] > 0.0 and math.isfinite(c.p["K_L"])):
        raise ValueError("omega_n and zeta must be above 0 and K_L a number")
    if direction not in {-1.0, 0.0, 1.0} or not c.supply > 0.0:
        raise ValueError(f"direction must be -1, 0 or 1 and supply above 0, got {direction:g}, {c.supply:g}")


def _pair(core: Matrix) -> tuple[float, float, float]:
    """omega_n^2 and 2 zeta omega_n of the poles that dominate the speed, and the others' part of its gain.

    They are the pair, complex or real, with the largest residues in the speed's answer to an impulse of flow.
    Of the others, what is slower than omega_n counts with its s alone, what is faster with its static value:
    the straight lines of a Bode plot.

    Args:
        core: The matrix of pressure, velocity and the states that hang on them, lags left out.
    """
    if not core[:2, 2:].any():  # none of the others acts back
        square = core[0, 0] * core[1, 1] - core[0, 1] * core[1, 0]
        return float(square), -float(core[0, 0] + core[1, 1]), 1.0
    poles = np.linalg.eigvals(core).astype(complex)
    zeros = np.linalg.eigvals(core[2:, 2:]).astype(complex)  # how the others move with the velocity held
    chosen = _heaviest(poles, zeros)
    square, others = float(np.prod(poles[chosen]).real), np.delete(poles, chosen)
    least = math.sqrt(abs(square))
    ratio = np.prod(np.maximum(abs(zeros), least)) / np.prod(np.maximum(abs(others), least))
    return square, -float(np.sum(poles[chosen]).real), float(ratio)


def _heaviest(poles: Complex, zeros: Complex) -> list[int]:
    """Which two of the poles have the largest residues; complex ones with their conjugates."""
    apart = poles[:, None] - poles + np.eye(len(poles))
    weights = abs(np.prod(poles[:, None] - zeros, axis=1)) / np.maximum(abs(np.prod(apart, axis=1)), TINY)
    order = [int(k) for k in np.argsort(-weights)]
    pairs = [[k, int(np.argmin(abs(poles - poles[k].conj())))] for k in order if poles[k].imag > 0.0]
    real = [k for k in order if poles[k].imag == 0.0][:2]
    return max([*pairs, *([real] if len(real) == 2 else [])], key=lambda pair: weights[pair].min())
