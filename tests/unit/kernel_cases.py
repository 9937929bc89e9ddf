"""Effects at values that matter on one plant, and runs of the kernel with them."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from sim import runs
from sim.parameters import parameters
from sim.state import new_state

K_L, OMEGA_N, ZETA = 17.0, 117.0, 0.21
NONE = np.empty(0)

EFFECTS_ON = {
    "transport_delay": {"time": 2.3e-3},
    "valve_saturation": {"limit": 0.55},
    "static_valve_map": {
        "bend_1": 0.05,
        "bend_2": 0.12,
        "tilt_1": -0.04,
        "tilt_2": 0.03,
        "tilt_3": -0.05,
        "range": 0.9,
        "knot_1": 0.3,
        "knot_2": 0.8,
        "rounding": 0.6,
    },
    "valve_hysteresis": {"half_width": 0.1},
    "valve_lag": {"time": 2e-3},
    "spool_inertia": {"omega": 700.0},
    "valve_rate_limit": {"rate": 120.0},
    "null_shift": {"voltage": 0.1},
    "valve_deadband": {"half_width": 0.12},
    "asymmetric_gain": {"ratio": 0.2},
    "square_root_flow": {"supply": 2e3},
    "pressure_dependent_stiffness": {"air": 0.3},
    "load_bias": {"acceleration": 300.0, "drift": -400.0},
    "load_spring": {"stiffness": 2000.0, "centre": 0.1},
    "coulomb_friction": {"level": 400.0},
    "stribeck_friction": {"level": 300.0, "speed": 0.8},
    "viscous_friction": {"share": 0.4},
    "lugre_friction": {"stiffness": 3e5, "damping": 200.0},
    "load_resonance": {"inertia": 0.3, "omega": 600.0, "zeta": 0.05},
    "periodic_disturbance": {"amplitude": 300.0, "omega": 250.0, "phase": 0.4},
    "backlash": {"gap": 0.02},
    "position_ripple": {"amplitude": 0.01, "wavenumber": 9.0, "phase": 0.3},
    "sensor_nonlinearity": {
        "order_2": 4e-3,
        "order_3": -3e-3,
        "order_4": 2e-3,
        "order_5": 1e-3,
        "order_6": -1e-3,
        "centre": 0.05,
        "half": 0.12,
    },
    "sensor_lag": {"time": 3e-3},
    "rectified_sensor": {"part": 0.8, "power": 1.7, "range": 4.0},
    "parameter_drift": {
        "K_L": 0.4,
        "omega_n": -0.5,
        "zeta": 1.0,
        "K_L_thermal": 0.01,
        "omega_n_thermal": -0.02,
        "zeta_thermal": 0.01,
    },
}
STOPS = (-0.05, 0.08)
NEEDED = {"lugre_friction": "coulomb_friction", "spool_inertia": "valve_lag"}


def chosen(*names: str) -> dict[str, dict[str, float]]:
    """Effects by name; `end_stops` are none, what acts only beside another brings that."""
    wanted = [*names, *(NEEDED[name] for name in names if name in NEEDED)]
    return {name: EFFECTS_ON[name] for name in EFFECTS_ON if name in wanted}


def stops_of(*names: str) -> tuple[float, float]:
    return STOPS if "end_stops" in names else (-math.inf, math.inf)


ALL_PAIRS = list(combinations([*EFFECTS_ON, "end_stops"], 2))


def record(names=(), *, sees_speed=False, plant=(K_L, OMEGA_N, ZETA), **options):
    low, high = stops_of(*names)
    effects = options.pop("effects", chosen(*names))
    return parameters(
        *plant, effects, measures_speed=float(sees_speed), stop_low=low, stop_high=high, **options
    )


def follow(p, t_u, u, t, *, supply=NONE, warmth=NONE, force=NONE, noise=NONE, state=None):
    """Readings of the kernel at `t`, and its state at the end."""
    s = new_state(p, t=min(t[0], t_u[0])) if state is None else state
    y = np.empty(len(t))
    runs.follow(p[0], s[0], t_u, u, t, noise, supply, warmth, force, y)
    return y, s[0]


def steps(duration: float, hold: float = 0.02, seed: int = 1, start: float = 1.3e-4):
    """Commands of several levels in both directions: times [s] and volts."""
    t_u = np.arange(0.0, duration, hold) + start
    return t_u, np.random.default_rng(seed).choice([-1.0, -0.5, 0.3, 0.6, 1.0], len(t_u))


def apart(a, b) -> float:
    """Largest difference over the range of `b`."""
    return float(np.max(np.abs(a - b)) / np.ptp(b))
