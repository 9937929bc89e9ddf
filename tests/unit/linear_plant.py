"""The linear plant of Eq. 1 with its integral, advanced exactly by its closed form: truth for the kernel."""

from __future__ import annotations

import math


class LinearPlant:
    """G_L(s) = K_L wn^2 / (s^2 + 2 zeta wn s + wn^2) from (volts - bias) to velocity (Eq. 1).

    Position, its integral, is in the rig's own unit (rad, m, counts), here called `unit`.

    End stops are simple: where a step ends beyond one, the load stands there with no velocity and no
    acceleration; it leaves when the voltage drives it away. What happens within a step is not seen.

    Args:
        K_L: Gain [unit/s/V].
        omega_n: Undamped natural frequency [rad/s].
        zeta: Damping ratio.
        bias: Voltage at which the load stands still [V].
        position: Where it stands at first [unit].

    Attributes:
        stops: Lower and upper end stop [unit]; none at first.
    """

    __slots__ = (
        "K_L",
        "_dt",
        "_matrix",
        "acceleration",
        "bias",
        "omega_n",
        "position",
        "stops",
        "velocity",
        "zeta",
    )

    def __init__(
        self,
        K_L: float,
        omega_n: float,
        zeta: float,
        *,
        bias: float = 0.0,
        position: float = 0.0,
    ) -> None:
        self.position = position
        self.velocity = 0.0
        self.acceleration = 0.0
        self.stops = (-math.inf, math.inf)
        self.change(K_L, omega_n, zeta, bias)

    def change(self, K_L: float, omega_n: float, zeta: float, bias: float) -> None:
        """Have other parameters from now on; the state goes on from where it is."""
        self.K_L = K_L
        self.omega_n = omega_n
        self.zeta = zeta
        self.bias = bias
        self._dt = math.nan  # equal to no step: the matrix is made anew

    def advance(self, dt: float, volts: float) -> None:
        """Go `dt` [s] on, the voltage held; exact for any step but for the end stops."""
        if dt != self._dt:
            self._dt = dt
            self._matrix = transition(self.omega_n, self.zeta, dt)
        pv, pa, vv, va, av, aa = self._matrix
        steady = self.K_L * (volts - self.bias)
        v = self.velocity - steady
        a = self.acceleration
        self.position = position = self.position + steady * dt + pv * v + pa * a
        self.velocity = steady + vv * v + va * a
        self.acceleration = av * v + aa * a
        low, high = self.stops
        if not low <= position <= high:
            self._rest_at(low if position < low else high)

    def _rest_at(self, stop: float) -> None:
        self.position = stop
        self.velocity = 0.0
        self.acceleration = 0.0


def transition(omega_n: float, zeta: float, dt: float) -> tuple[float, float, float, float, float, float]:
    """How a deviation of velocity v and acceleration a from the steady state moves the plant within `dt`.

    Returns:
        (pv, pa, vv, va, av, aa): position += pv v + pa a, v = vv v + va a, a = av v + aa a.
    """
    if zeta < 1.0:
        vv, va, aa = _underdamped(omega_n, zeta, dt)
    else:
        vv, va, aa = _overdamped(omega_n, zeta, dt)
    # The integral of v follows from the differential equation itself, integrated once.
    ratio = 2.0 * zeta / omega_n
    pv = va + ratio * (1.0 - vv)
    pa = (1.0 - aa) / (omega_n * omega_n) - ratio * va
    return pv, pa, vv, va, -omega_n * omega_n * va, aa


def _underdamped(omega_n: float, zeta: float, dt: float) -> tuple[float, float, float]:
    sigma = zeta * omega_n
    omega_d = omega_n * math.sqrt((1.0 - zeta) * (1.0 + zeta))  # 1 - zeta is exact near 1
    decay = math.exp(-sigma * dt)
    cosine = decay * math.cos(omega_d * dt)
    va = decay * math.sin(omega_d * dt) / omega_d
    return cosine + sigma * va, va, cosine - sigma * va


def _overdamped(omega_n: float, zeta: float, dt: float) -> tuple[float, float, float]:
    """Both real poles, -slow and -fast; written so that nothing cancels, near zeta = 1 or far above it."""
    beta = omega_n * math.sqrt((zeta - 1.0) * (zeta + 1.0))
    fast = zeta * omega_n + beta
    slow = omega_n * omega_n / fast
    slow_decay = math.exp(-slow * dt)
    spread = -math.expm1(-2.0 * beta * dt) / (2.0 * beta) if beta > 0.0 else dt
    va = slow_decay * spread
    return slow_decay + slow * va, va, math.exp(-fast * dt) - slow * va
