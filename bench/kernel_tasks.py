"""What the kernel's benchmarks simulate: a plant, an example of each effect, a command that meets them."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from sim.effects import EFFECTS
from sim.parameters import parameters

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

K_L, OMEGA_N, ZETA = 17.0, 117.0, 0.21
RATE = 2000.0
NOTHING = np.empty(0)

EXAMPLES = {
    "transport_delay": {"time": 1.3e-3},
    "valve_saturation": {"limit": 0.4},
    "static_valve_map": {"bend_1": 0.02, "bend_2": -0.01, "tilt_2": 0.01, "range": 0.5, "rounding": 0.5},
    "valve_hysteresis": {"half_width": 0.05},
    "valve_lag": {"time": 2e-3},
    "spool_inertia": {"omega": 700.0},
    "valve_rate_limit": {"rate": 120.0},
    "null_shift": {"voltage": 0.05},
    "valve_deadband": {"half_width": 0.05},
    "asymmetric_gain": {"ratio": 0.1},
    "square_root_flow": {"supply": 6000.0},
    "pressure_dependent_stiffness": {"air": 0.2},
    "load_bias": {"acceleration": 200.0},
    "load_spring": {"stiffness": 1000.0, "centre": 0.1},
    "coulomb_friction": {"level": 100.0},
    "stribeck_friction": {"level": 100.0, "speed": 2.0},
    "viscous_friction": {"share": 0.6},
    "lugre_friction": {"stiffness": 4e5, "damping": 100.0},
    "load_resonance": {"inertia": 0.2, "omega": 600.0, "zeta": 0.05},
    "periodic_disturbance": {"amplitude": 200.0, "omega": 300.0},
    "measured_disturbance": {"gain": 50.0},
    "backlash": {"gap": 0.02},
    "position_ripple": {"amplitude": 0.01, "wavenumber": 5.0},
    "sensor_nonlinearity": {"order_2": 0.01, "order_3": 0.003, "half": 0.2},
    "sensor_lag": {"time": 1e-3},
    "rectified_sensor": {"part": 1.0},
    "held_readings": {"time": 2.3e-3},
    "sensor_quantization": {"step": 1e-3},
    "parameter_drift": {"K_L": 1e-3, "omega_n": -1e-3, "zeta": 2e-3},
}
"""Values that make each effect work in the command below; the movement is 0.3 rad, 26 rad/s, 3000 rad/s^2."""

NEEDED = {"lugre_friction": "coulomb_friction", "spool_inertia": "valve_lag"}
"""Effects that act only beside another, and that one."""

STOPS = (-0.08, 0.08)
NAMES = (*EXAMPLES, "end_stops")

if missing := {name for name, effect in EFFECTS.items() if effect.enters != "record"} - set(EXAMPLES):
    raise ValueError(f"no example of {', '.join(sorted(missing))}")


def plant(*names: str) -> NDArray:
    """The record of the plant with these effects; those that act only beside another bring it."""
    wanted = {*names, *(NEEDED[name] for name in names if name in NEEDED)}
    low, high = STOPS if "end_stops" in wanted else (-np.inf, np.inf)
    chosen = {name: values for name, values in EXAMPLES.items() if name in wanted}
    return parameters(K_L, OMEGA_N, ZETA, chosen, stop_low=low, stop_high=high)


@cache
def command(seconds: float) -> tuple[NDArray, NDArray]:
    """Times [s] and volts: half a relay's square wave, half a slow sine in which the load comes to rest."""
    t = np.arange(round(seconds * RATE)) / RATE
    square = np.where(np.sin(OMEGA_N * t) < 0.0, -0.5, 0.5)
    return t, np.where(t < 0.5 * seconds, square, 0.1 * np.sin(2.0 * np.pi * t))


def pairs() -> Iterator[tuple[str, str]]:
    """All pairs of effects."""
    return combinations(NAMES, 2)
