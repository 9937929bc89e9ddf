"""Small signals of the physical plant: steady state, matrices, K_L, omega_n and zeta. Needs no numba.

The equations are those of `docs/hydraulics.md`, in plain numbers; the tests hold them to the simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.hydraulics.record import ATMOSPHERE, SLOTS

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    Matrix = npt.NDArray[np.float64]

SLOW = 1e-6
"""Part of the speed at 1 V that stands for standstill: the valve is then open by a trace, one way."""
MOST_STEPS = 100
CLOSE = 1e-8
TINY = 1e-300


@dataclass(frozen=True, slots=True, eq=False)
class Steady:
    """The plant in steady movement.

    Attributes:
        opening: Of the valve [V], null and overlap taken away.
        volts: Command for it.
        pressure_a: [Pa]
        pressure_b: [Pa]
        supply: Pressure at the servovalve [Pa].
        demand: Flow out of the supply [m^3/s].
        speed: [unit/s]
    """

    opening: float
    volts: float
    pressure_a: float
    pressure_b: float
    supply: float
    demand: float
    speed: float


@dataclass(frozen=True, slots=True, eq=False)
class SmallSignal:
    """The linearised plant without spool, delay and sensor: dx/dt = A x + B o, speed C x; o is the spool [V].

    Attributes:
        K_L: Gain from volts to speed [unit/s/V].
        omega_n: Undamped natural frequency of the dominant pair of poles [rad/s].
        zeta: Its damping ratio.
        A: Shape (n, n); states pressure_a, pressure_b, velocity, then twist and velocity2 of a flexible load,
            then the supply pressure where the supply has droop.
        B: Shape (n,).
        C: Shape (n,).
        steady: Where it was linearised.
    """

    K_L: float
    omega_n: float
    zeta: float
    A: Matrix
    B: Matrix
    C: Matrix
    steady: Steady


class Physics:
    """A record in given surroundings, as plain numbers, with the slopes of what is not linear.

    Args:
        record: Shape (1,) of `RECORD`.
        position: Of the load [unit].
        supply: Supply pressure over the rig file's.
        warmth: Temperature above nominal [K].

    Raises:
        ValueError: The supply's pressure is not above the tank's.
    """

    def __init__(
        self, record: npt.NDArray[np.void], position: float, supply: float = 1.0, warmth: float = 0.0
    ) -> None:
        p = dict(zip(SLOTS, (float(value) for value in record[0]), strict=True))
        self.p = p
        self.set = p["supply_pressure"] * supply
        self.tank = p["supply_tank"]
        if not self.set > self.tank:
            raise ValueError(f"the supply, {self.set:g} Pa, is not above the tank, {self.tank:g} Pa")
        self.lever, way = lever(p, position)
        self.area_a, self.area_b = p["area_a"] * self.lever, p["area_b"] * self.lever
        self.volume_a, self.volume_b = p["volume_a"] + p["area_a"] * way, p["volume_b"] - p["area_b"] * way
        thinner = math.exp(p["oil_thermal"] * warmth)
        self.cross, self.external = thinner * p["leakage_cross"], thinner * p["leakage_external"]
        self.conductance = self._conductance()
        self.load = p["load_force"] + p["load_spring"] * (position - p["load_spring_centre"])

    def _conductance(self) -> float:
        p = self.p
        if not p["valve_measured_0"]:
            return p["conductance"]
        at = min(max(self.set, p["valve_measured_low"]), p["valve_measured_high"])
        K_L = p["valve_measured_0"] + p["valve_measured_1"] * at + p["valve_measured_2"] * at**2
        return K_L * 0.5 * (p["area_a"] + p["area_b"]) / math.sqrt(0.5 * (self.set - self.tank))

    def root(self, drop: float) -> tuple[float, float]:
        """Signed square root of a pressure drop [Pa^0.5], laminar near zero, and its slope [Pa^-0.5]."""
        soft = self.p["valve_laminar"]
        if abs(drop) >= soft:
            return math.copysign(math.sqrt(abs(drop)), drop), 0.5 / math.sqrt(abs(drop))
        part = drop / soft
        return math.sqrt(soft) * part * (1.25 - 0.25 * part**2), (1.25 - 0.75 * part**2) / math.sqrt(soft)

    def stiffness(self, pressure: float) -> float:
        """Bulk modulus [Pa] of oil with air at a pressure [Pa]."""
        E, air, n = self.p["oil_bulk_modulus"], self.p["oil_air"], self.p["oil_polytropic"]
        absolute = max(pressure + ATMOSPHERE, 1000.0)
        part = air * (ATMOSPHERE / absolute) ** (1.0 / n)
        return float(E * (1.0 + part) / (1.0 + part * E / (n * absolute)))

    def friction(self, speed: float) -> tuple[float, float]:
        """Dry and viscous friction at a speed [unit/s]: [N unit], and its slope [N unit s/unit]."""
        p = self.p
        fallen = p["load_stribeck"] * math.exp(-((speed / p["load_stribeck_speed"]) ** 2))
        dry = math.copysign(p["load_coulomb"] + fallen, speed) if speed else 0.0
        slope = -2.0 * abs(speed) / p["load_stribeck_speed"] ** 2 * fallen
        return dry + p["load_viscous"] * speed, p["load_viscous"] + slope

    def ports(self, o: float, pa: float, pb: float, ps: float) -> tuple[Matrix, Matrix]:
        """Flows into a, into b and out of the supply [m^3/s], and their slopes.

        At opening 0 the slopes by it are those of a valve that opens forth.

        Args:
            o: Opening [V].
            pa: Of chamber a [Pa].
            pb: Of chamber b [Pa].
            ps: Supply pressure [Pa].

        Returns:
            Flows, shape (3,), and slopes by `o`, `pa`, `pb` and `ps`, shape (3, 4).
        """
        k, c = self.conductance, self.p["clearance"]
        forth, back = k * (max(o, 0.0) + c), k * (max(-o, 0.0) + c)
        to_a, by_a = self.root(ps - pa)
        to_b, by_b = self.root(ps - pb)
        out_a, off_a = self.root(pa - self.tank)
        out_b, off_b = self.root(pb - self.tank)
        flows = np.array(
            [forth * to_a - back * out_a, back * to_b - forth * out_b, forth * to_a + back * to_b]
        )
        opened = [k * to_a, -k * out_b, k * to_a] if o >= 0.0 else [k * out_a, -k * to_b, -k * to_b]
        slopes = np.array(
            [
                [opened[0], -forth * by_a - back * off_a, 0.0, forth * by_a],
                [opened[1], 0.0, -back * by_b - forth * off_b, back * by_b],
                [opened[2], -forth * by_a, -back * by_b, forth * by_a + back * by_b],
            ]
        )
        return flows, slopes

    def steady(self, speed: float) -> Steady:
        """At this speed [unit/s], by Newton's method.

        Leakage between unequal chambers moves a load too: it may go as fast with its chambers nearly empty,
        and is then slowed by a valve that opens. Of two such states this is the one under more pressure.

        Raises:
            ValueError: The supply cannot move the load so.
        """
        guesses = [guess for forth in (True, False) if (guess := self._guess(speed, forth)) is not None]
        if not guesses:
            raise ValueError(f"no steady state at {speed:g} unit/s: the load asks for more than the supply")
        states = [state for guess in guesses if (state := self._newton(guess, speed)) is not None]
        if not states:
            raise ValueError(f"no steady state at {speed:g} unit/s: the supply cannot move the load so")
        return max(states, key=lambda state: state.pressure_a + state.pressure_b)

    def _newton(self, x: Matrix, speed: float) -> Steady | None:
        """The steady state that is reached from opening, pa, pb and ps in `x`; None: none is."""
        droop = self.p["supply_droop"]
        crosses = self.p["clearance"] + self.cross + self.external > 0.0  # leakage moves the opening
        for _ in range(MOST_STEPS):
            o, pa, pb, ps = x
            flows, slopes = self.ports(o, pa, pb, ps)
            drag = self.friction(speed)[0] + self.load
            across, out = self.cross * (pa - pb), self.external
            wrong = np.array(
                [
                    flows[0] - self.area_a * speed - across - out * (pa - self.tank),
                    flows[1] + self.area_b * speed + across - out * (pb - self.tank),
                    self.area_a * pa - self.area_b * pb - drag,
                    ps + droop * flows[2] - self.set,
                ]
            )
            J = np.zeros((4, 4))
            J[:2] = slopes[:2]
            J[0, 1] -= self.cross + out
            J[0, 2] += self.cross
            J[1, 1] += self.cross
            J[1, 2] -= self.cross + out
            J[2, 1], J[2, 2] = self.area_a, -self.area_b
            J[3] = droop * slopes[2]
            J[3, 3] += 1.0
            scale = np.array([abs(o) + (1e-3 if crosses else 1e-9), self.set, self.set, self.set])
            try:
                change = np.linalg.solve(J * scale, -wrong)
            except np.linalg.LinAlgError:
                break
            part = min(1.0, 0.5 / max(float(np.max(np.abs(change))), TINY))
            x = x + part * change * scale
            if np.max(np.abs(change)) < CLOSE:
                return self._found(x, speed, float(self.ports(*x)[0][2]))
        return None

    def _guess(self, speed: float, forth: bool) -> Matrix | None:
        """Opening and pressures of a valve open one way, by crossing leakage alone; None: there are none."""
        pushes, yields = (self.area_a, self.area_b) if forth else (self.area_b, self.area_a)
        drag = self.friction(speed)[0] + self.load
        need = drag if forth else -drag
        # (ps - p1) / p2 = r, pushes p1 - yields p2 = need
        r, span = (pushes / yields) ** 2, self.set - self.tank
        p2 = (span - need / pushes) / (r + yields / pushes)
        if not 0.0 < p2 < span:
            return None
        p1 = (need + yields * p2) / pushes
        flow = abs(speed * yields + self.cross * (p1 - p2))
        o = flow / (self.conductance * math.sqrt(max(p2, 1.0)))
        p1, p2 = p1 + self.tank, p2 + self.tank
        pa, pb = (p1, p2) if forth else (p2, p1)
        return np.array([o if forth else -o, pa, pb, self.set])

    def _found(self, x: Matrix, speed: float, demand: float) -> Steady:
        o, pa, pb, ps = (float(value) for value in x)
        sign = 1.0 if o >= 0.0 else -1.0
        unequal = 1.0 + sign * self.p["valve_asymmetry"]
        volts = self.p["valve_null_bias"] + sign * self.p["valve_overlap"] + o / unequal
        if demand > self.p["supply_flow"] and self.p["supply_droop"] > 0.0:
            raise ValueError(f"no steady state at {speed:g} unit/s: it needs more flow than the pump gives")
        return Steady(o, volts, pa, pb, ps, demand, speed)


def lever(p: Mapping[str, float], position: float) -> tuple[float, float]:
    """Of a cylinder's crank [m/unit] at a position [unit], and its stroke there [m]; of a motor 1 and 0."""
    if p["rotary"]:
        return 1.0, 0.0
    if not p["cylinder_arm"]:
        return 1.0, position
    base, arm, length = p["cylinder_base"], p["cylinder_arm"], p["cylinder_length"]
    angle = math.acos((base**2 + arm**2 - length**2) / (2.0 * base * arm)) + position
    now = math.sqrt(base**2 + arm**2 - 2.0 * base * arm * math.cos(angle))
    return base * arm * math.sin(angle) / now, now - length


def rest_pressures(record: npt.NDArray[np.void], position: float) -> tuple[float, float]:
    """Of the chambers [Pa] in a plant that stands at `position` [unit], as after slow movement.

    Raises:
        ValueError: The supply's pressure is not above the tank's.
    """
    physics = Physics(record, position)
    try:
        steady = physics.steady(SLOW * physics.conductance * math.sqrt(physics.set) / physics.area_a)
    except ValueError:  # held up by a stop, or not at all
        return 0.5 * physics.set, 0.5 * physics.set
    return steady.pressure_a, steady.pressure_b


def small_signal(
    record: npt.NDArray[np.void],
    *,
    position: float = 0.0,
    speed: float = 0.0,
    supply: float = 1.0,
    warmth: float = 0.0,
) -> SmallSignal:
    """Linearise about a steady speed; about 0, the mean of creeping forth and back.

    Args:
        record: Shape (1,) of `RECORD`.
        position: Of the load [unit].
        speed: Of the load [unit/s].
        supply: Supply pressure over the rig file's.
        warmth: Temperature above nominal [K].

    Raises:
        ValueError: There is no such steady state.
    """
    physics = Physics(record, position, supply, warmth)
    if speed:
        return _about(physics, physics.steady(speed))
    slow = SLOW * physics.conductance * math.sqrt(physics.set) / physics.area_a
    forth, back = (_about(physics, physics.steady(v)) for v in (slow, -slow))
    return SmallSignal(
        0.5 * (forth.K_L + back.K_L),
        0.5 * (forth.omega_n + back.omega_n),
        0.5 * (forth.zeta + back.zeta),
        forth.A,
        forth.B,
        forth.C,
        forth.steady,
    )


def _about(physics: Physics, steady: Steady) -> SmallSignal:
    A, B = _matrices(physics, steady)
    C = np.zeros(len(A))
    C[2] = 1.0
    asymmetry = physics.p["valve_asymmetry"]
    worth = 1.0 + math.copysign(asymmetry, steady.opening) if asymmetry else 1.0
    K_L = -worth * float(C @ np.linalg.solve(A, B))
    omega_n, zeta = _dominant(A, B, C)
    return SmallSignal(K_L, omega_n, zeta, A, worth * B, C, steady)


def _matrices(physics: Physics, steady: Steady) -> tuple[Matrix, Matrix]:
    p = physics.p
    _, slopes = physics.ports(steady.opening, steady.pressure_a, steady.pressure_b, steady.supply)
    flexible, droops = p["load_second"] > 0.0, p["supply_droop"] > 0.0
    n = 3 + 2 * flexible + droops
    A, B = np.zeros((n, n)), np.zeros(n)
    ca = physics.stiffness(steady.pressure_a) / physics.volume_a
    cb = physics.stiffness(steady.pressure_b) / physics.volume_b
    cross, leak = physics.cross, physics.cross + physics.external
    A[0, :3] = ca * np.array([slopes[0, 1] - leak, slopes[0, 2] + cross, -physics.area_a])
    A[1, :3] = cb * np.array([slopes[1, 1] + cross, slopes[1, 2] - leak, physics.area_b])
    B[0], B[1] = ca * slopes[0, 0], cb * slopes[1, 0]
    ratio = p["load_second"]
    per_force = (1.0 + ratio) / p["load_inertia"]
    drag = physics.friction(steady.speed)[1]
    A[2, :3] = per_force * np.array([physics.area_a, -physics.area_b, -drag])
    if flexible:
        omega, damping = p["load_second_omega"], 2.0 * p["load_second_zeta"] * p["load_second_omega"]
        pull = np.zeros(n)
        pull[2], pull[3], pull[4] = damping, omega**2, -damping
        A[2] -= ratio * pull
        A[3, 2], A[3, 4] = 1.0, -1.0
        A[4] = pull
    if droops:
        cs = physics.stiffness(steady.supply) / p["supply_volume"]
        A[0, -1], A[1, -1] = ca * slopes[0, 3], cb * slopes[1, 3]
        A[-1, :2] = -cs * slopes[2, 1:3]
        A[-1, -1] = -cs * (slopes[2, 3] + 1.0 / p["supply_droop"])
        B[-1] = -cs * slopes[2, 0]
    return A, B


def _dominant(A: Matrix, B: Matrix, C: Matrix) -> tuple[float, float]:
    """omega_n [rad/s] and zeta of the two poles, a complex pair or real, that weigh most in the speed."""
    poles, right = np.linalg.eig(A)
    weights = np.abs((C @ right) * np.linalg.solve(right, B.astype(complex)))
    order = np.argsort(-weights)
    first = int(order[0])
    if abs(poles[first].imag) > 0.0:
        pair = [poles[first], poles[first].conj()]
    else:
        real = [int(k) for k in order if poles[k].imag == 0.0][:2]
        pair = [poles[k] for k in real]
    square = float(np.prod(pair).real)
    omega_n = math.sqrt(square)
    return omega_n, float(-np.sum(pair).real) / (2.0 * omega_n)
