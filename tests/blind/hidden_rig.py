"""A plant with hidden effects, in the terms of a diagnosis, run as the actuator of `hidden_plant`."""

from __future__ import annotations

from dataclasses import dataclass, field

import hidden_plant
import numpy as np
from hidden_plant import DEFAULTS, ENTRIES, GIVEN, LAGGED, MODES, PHYSICAL, PRESSURE, RELAY, SERVO

LONGEST = 4e-5
"""Step [s]; that of bristles, which are quick, is a quarter of it."""

RELIEF = 30.0
"""Of a relief valve, what leaves beyond its pressure over the leakage: nearly all."""

VALVE = {
    "transport_delay": {"time": "delay"},
    "valve_saturation": {"limit": "limit"},
    "valve_hysteresis": {"half_width": "play"},
    "valve_lag": {"time": "spool_lag"},
    "spool_inertia": {"omega": "spool_omega"},
    "valve_rate_limit": {"rate": "slew"},
    "null_shift": {"voltage": "null"},
    "valve_deadband": {"half_width": "overlap"},
    "asymmetric_gain": {"ratio": "unequal"},
    "pressure_dependent_stiffness": {"air": "air"},
    "backlash": {"gap": "gap"},
    "position_ripple": {
        "amplitude": "eccentric",
        "wavenumber": "eccentric_waves",
        "phase": "eccentric_phase",
    },
    "sensor_nonlinearity": {
        "amplitude": "crank",
        "wavenumber": "crank_waves",
        "phase": "crank_phase",
        "lever": "lever",
        "lever_at": "lever_at",
        "parabola": "curved",
        "centre": "table_at",
        "half": "table_half",
        **{f"order_{n}": f"table_{n}" for n in range(2, 7)},
    },
    "sensor_lag": {"time": "sensor_lag"},
    "sensor_quantization": {"step": "count"},
    "rectified_sensor": {"part": "folded", "power": "law", "range": "law_at"},
    "held_readings": {"time": "keeps"},
    "parameter_drift": {"K_L": "drift_gain", "omega_n": "drift_omega", "zeta": "drift_zeta"},
}
"""Same number in both worlds."""

TORQUES = {
    "load_bias": {"acceleration": "weight", "drift": "heavier"},
    "load_spring": {"stiffness": "spring"},
    "coulomb_friction": {"level": "coulomb"},
    "stribeck_friction": {"level": "stribeck"},
    "lugre_friction": {"stiffness": "bristle_stiffness", "damping": "bristle_damping"},
    "periodic_disturbance": {"amplitude": "ripple"},
    "drag": {"strength": "drag"},
    "hardening": {"strength": "hardening"},
    "gusts": {"strength": "gusts"},
}
"""Accelerations of the free load here, torques there."""

ANGLES = {
    "load_spring": {"centre": "centre"},
    "stribeck_friction": {"speed": "stribeck_speed"},
    "periodic_disturbance": {"omega": "ripple_omega", "phase": "ripple_phase"},
    "static_valve_map": {"progress": "progressive"},
    "progressive": {"strength": "progressive"},
    "volume": {"strength": "volume"},
    "curved": {"strength": "curved"},
}


FARTHEST = 4.0
"""Of a valve's list of volts, over its last knot."""


def by_gains(told):
    """Volts given and worth of a valve with gains by level and direction: three to each side."""
    knots = np.array([0.0, told["at_1"], told["at_2"], FARTHEST * told["at_2"]])
    given = np.linspace(-knots[-1], knots[-1], ENTRIES)
    up, down = (
        np.concatenate([[0.0], np.cumsum([told[f"{way}_{k}"] for k in (1, 2, 3)] * np.diff(knots))])
        for way in ("up", "down")
    )
    return given, np.where(given > 0.0, np.interp(given, knots, up), -np.interp(-given, knots, down))


def by_knots(told):
    """The same of a map as the model has it: lines between knots, averaged over each corner's width."""
    places = np.array([0.0, told["knot_1"], told["knot_2"], 1.0])
    part = np.linspace(-1.0, 1.0, ENTRIES)
    bends = [0.0, told["bend_1"], told["bend_2"], 0.0]
    tilts = [0.0, *(told[f"tilt_{k}"] for k in (1, 2, 3))]
    bend, tilt = (rounded(np.abs(part), places, each, told["rounding"]) for each in (bends, tilts))
    given = told["range"] * part
    return given, given + np.sign(given) * bend + tilt


def rounded(part, places, knots, rounding):
    """Straight lines through knots, each corner averaged over as much as `rounding` is of its room."""
    slopes = np.diff(knots) / np.diff(places)
    spread = np.linspace(-1.0, 1.0, 401)
    out = slopes[0] * part
    for at, turn in zip(places[1:3], np.diff(slopes), strict=True):
        beyond = part[:, None] - at + rounding * min(at, 1.0 - at) * spread
        out = out + turn * np.mean(np.maximum(beyond, 0.0), axis=1)
    return out


@dataclass(frozen=True)
class Rig:
    """What is to be found, and the hardware that nobody sees.

    Attributes:
        K_L, omega_n, zeta: Of Eq. 1 [unit/s/V, rad/s, 1].
        effects: Values by cause (names of `sim.effects`, or of `hidden_plant.OFF_LIST`) and parameter.
        sees_speed: The sensor measures speed.
        displacement: Of the actuator [m^3/rad].
        inertia: Of the load [kg m^2].
        rubs: Part of the damping that is friction in proportion to the speed; the rest leaks.
    """

    K_L: float
    omega_n: float
    zeta: float
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    sees_speed: bool = False
    displacement: float = 2e-5
    inertia: float = 0.03
    rubs: float = 0.0

    def physical(self) -> np.ndarray:
        values = dict(DEFAULTS)
        d, j = self.displacement, self.inertia
        values["displacement"], values["inertia"] = d, j
        values["compliance"] = d * d / (j * self.omega_n**2)
        damping = 2.0 * self.zeta * self.omega_n
        values["leakage"] = (1.0 - self.rubs) * damping * values["compliance"]
        values["rubbing"] = self.rubs * damping * j
        values["valve"] = self.K_L * d
        values["sees_speed"] = float(self.sees_speed)
        for table, scale in ((VALVE, 1.0), (TORQUES, j), (ANGLES, 1.0)):
            for name, slots in table.items():
                for parameter, slot in slots.items():
                    if parameter in self.effects.get(name, {}):
                        values[slot] = scale * self.effects[name][parameter]
        values.update(self._coupled(values))
        record = np.zeros(1, PHYSICAL)
        for name, value in values.items():
            record[name] = value
        return record

    def _coupled(self, values: dict[str, float]) -> dict[str, float]:
        """Those that are made of several numbers."""
        out, of = {}, self.effects.get
        if (told := of("static_valve_map")) and "progress" not in told:
            out["given_volts"], out["worth_volts"] = by_gains(told) if "up_1" in told else by_knots(told)
            out["stamped"] = 1.0
        if root := of("square_root_flow"):
            out["supply"] = root["supply"] * self.inertia / self.displacement
        if second := of("load_resonance"):
            out["inertia2"] = self.inertia * second["inertia"] / (1.0 + second["inertia"])
            out["shaft"] = out["inertia2"] * second["omega"] ** 2
            out["shaft_damping"] = 2.0 * second["zeta"] * second["omega"] * out["inertia2"]
        if of("measured_disturbance"):  # what pushes is given as an acceleration
            out["gusts"] = self.inertia
        if relief := of("relief"):
            out["relief"], out["opens"] = RELIEF, relief["strength"] * self.inertia / self.displacement
        return out


@dataclass(frozen=True)
class Drive:
    """How the rig is driven.

    Attributes:
        kind: `GIVEN`, `RELAY` or `SERVO`.
        u: Volts, or the servo's references; shape (n,).
        settings: Of the controller, see `hidden_plant.run`.
    """

    kind: int
    u: np.ndarray
    settings: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)


def simulate(rig: Rig, t, drive: Drive, noise=None, supply=None, gusts=None, latency=0.0, seen_at=None):
    """Readings and commands, each of shape (n,); `seen_at`: when the samples are really taken.

    `gusts` is a torque of unit size, where a disturbance is measured all that pushes, as an acceleration.
    """
    p, m, w = rig.physical(), np.zeros(1, MODES), np.zeros(9)
    n, s = len(t), p[0]
    noise = np.zeros(n) if noise is None else noise
    supply = np.ones(n) if supply is None else supply
    gusts = np.zeros(n) if gusts is None else gusts
    m["t"], m["stuck"] = t[0], 1.0
    w[PRESSURE] = (s["weight"] - s["spring"] * s["centre"]) / s["displacement"]
    w[LAGGED] = 0.0 if rig.sees_speed else hidden_plant.encoder(s, 0.0)
    y, u = np.empty(n), np.array(drive.u, float)
    times = t if seen_at is None else seen_at
    settings = np.array(drive.settings)
    longest = LONGEST / 4.0 if s["bristle_stiffness"] > 0.0 else LONGEST
    hidden_plant.run(
        s, m[0], w, t, times, u, drive.kind, settings, noise, supply, gusts, latency, longest, y
    )  # fmt: skip
    return y, u


__all__ = ["GIVEN", "RELAY", "SERVO", "Drive", "Rig", "simulate"]
