"""The linearised plant against the simulated one's frequency response, for each effect and several at once.

A small sine is laid over the command that holds the steady state, once with either sign: half the difference
is free of all that the plant does by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from sim.effects import EFFECTS
from sim.linear import small_signal
from sim.parameters import parameters
from sim.runs import RELAY, follow, ideal_relay
from sim.state import new_state

NONE = np.zeros(0)
PLANT = {"K_L": 17.0, "omega_n": 117.0, "zeta": 0.21}
FREQUENCIES = (23.0, 110.0, 240.0)
COMMANDS = 64  # a period


@dataclass(frozen=True)
class Case:
    """A plant, where it is linearised, and how well the measurement can meet that."""

    effects: dict[str, dict[str, float]]
    at: dict[str, float] = field(default_factory=dict)
    base: dict[str, float] = field(default_factory=dict)
    amplitude: float = 1e-3  # [V]
    ramp: float = 0.0  # [V/s] on the command, so that it never turns round
    tolerance: float = 1e-5

    def record(self) -> np.ndarray:
        return parameters(**{**PLANT, **self.base}, effects=self.effects)


MOVING = {"speed": 2.0}
AT_REST = {"direction": 0.0}
VALVE_MAP = {"bend_1": -0.1, "bend_2": -0.05, "tilt_2": 0.07, "tilt_3": 0.1, "range": 1.1, "rounding": 0.5}
FRICTION = {"coulomb_friction": {"level": 40.0}, "stribeck_friction": {"level": 30.0, "speed": 2.5}}

CASES = {
    "base": Case({}),
    "overdamped": Case({}, base={"zeta": 1.6}),
    "speed": Case({}, base={"measures_speed": 1.0}),
    "transport_delay": Case({"transport_delay": {"time": 3.3e-3}}),
    "valve_saturation": Case({"valve_saturation": {"limit": 0.5}}, {"volts": 0.4}),
    "static_valve_map": Case({"static_valve_map": VALVE_MAP}, {"volts": -0.3}),
    "static_valve_map of a speed": Case({"static_valve_map": VALVE_MAP}, MOVING),
    "static_valve_map of ports": Case(
        {
            "static_valve_map": VALVE_MAP | {"at_ports": 1.0},
            "valve_lag": {"time": 4e-3},
            "null_shift": {"voltage": 0.1},
            "asymmetric_gain": {"ratio": 0.2},
        },
        MOVING,
    ),
    "static_valve_map of ports, held": Case(
        {"static_valve_map": VALVE_MAP | {"at_ports": 1.0}, "valve_deadband": {"half_width": 0.05}},
        {"volts": -0.3},
    ),
    "valve_hysteresis": Case({"valve_hysteresis": {"half_width": 0.1}}, MOVING, amplitude=2e-4, ramp=0.1),
    "valve_lag": Case({"valve_lag": {"time": 4e-3}}),
    "spool_inertia": Case({"valve_lag": {"time": 4e-3}, "spool_inertia": {"omega": 300.0}}),
    "spool_inertia that swings": Case({"valve_lag": {"time": 2e-3}, "spool_inertia": {"omega": 400.0}}),
    "null_shift": Case({"null_shift": {"voltage": 0.3}}, {"volts": 0.3}),
    "valve_deadband": Case({"valve_deadband": {"half_width": 0.2}}, {"volts": -0.3}),
    "asymmetric_gain": Case({"asymmetric_gain": {"ratio": 0.2}}, MOVING),
    "asymmetric_gain back": Case({"asymmetric_gain": {"ratio": 0.2}}, {"speed": -2.0}),
    "asymmetric_gain at rest": Case({"asymmetric_gain": {"ratio": 0.2}}, AT_REST),
    "square_root_flow": Case({"square_root_flow": {"supply": 400.0}}, {"volts": 0.2}),
    "valve_rate_limit": Case({"valve_rate_limit": {"rate": 1e4}}),  # far from it where the signal is small
    "square_root_flow loaded": Case(
        {"square_root_flow": {"supply": 400.0}, "load_bias": {"acceleration": -150.0}},
        {"speed": -4.0, "supply": 0.7},
    ),
    "pressure_dependent_stiffness": Case({"pressure_dependent_stiffness": {"air": 0.8}}, {"supply": 0.6}),
    "load_bias": Case({"load_bias": {"acceleration": 90.0}}),
    "load_spring": Case({"load_spring": {"stiffness": 3000.0, "centre": 0.02}}, AT_REST),
    "coulomb_friction": Case({"coulomb_friction": {"level": 40.0}}, MOVING),
    "stribeck_friction": Case(FRICTION, MOVING, tolerance=1e-4),
    "stribeck_friction back": Case(FRICTION, {"volts": -0.3}, tolerance=1e-4),
    "viscous_friction": Case(
        {"viscous_friction": {"share": 0.6}, "load_bias": {"acceleration": 90.0}}, MOVING
    ),
    "lugre_friction": Case(
        {**FRICTION, "lugre_friction": {"stiffness": 4e4, "damping": 30.0}}, MOVING, tolerance=1e-4
    ),
    "lugre_friction at rest": Case(
        {"coulomb_friction": {"level": 40.0}, "lugre_friction": {"stiffness": 4e3, "damping": 30.0}},
        AT_REST,
        amplitude=1e-5,
        tolerance=5e-4,
    ),
    "load_resonance": Case({"load_resonance": {"inertia": 0.4, "omega": 260.0, "zeta": 0.08}}),
    "load_resonance low": Case({"load_resonance": {"inertia": 1.5, "omega": 60.0, "zeta": 0.08}}),
    "measured_disturbance": Case({"measured_disturbance": {"gain": 50.0}}),
    "periodic_disturbance": Case({"periodic_disturbance": {"amplitude": 50.0, "omega": 70.0}}),
    "backlash": Case({"backlash": {"gap": 0.01}}, MOVING),
    "backlash of a speed": Case({"backlash": {"gap": 0.01}}, MOVING, {"measures_speed": 1.0}),
    "position_ripple": Case(
        {"position_ripple": {"amplitude": 0.1, "wavenumber": 3.0, "phase": 0.5}}, AT_REST, amplitude=1e-4
    ),
    "sensor_nonlinearity": Case(
        {"sensor_nonlinearity": {"order_2": 0.1, "order_3": 0.05, "centre": -0.3, "half": 0.9}},
        AT_REST,
        amplitude=1e-4,
    ),
    "sensor_lag": Case({"sensor_lag": {"time": 3e-3}}),
    "sensor_lag of a speed": Case({"sensor_lag": {"time": 3e-3}}, base={"measures_speed": 1.0}),
    "rectified_sensor": Case({"rectified_sensor": {"part": 0.8}}, {"speed": -3.0}, {"measures_speed": 1.0}),
    "rectified_sensor of another power": Case(
        {"rectified_sensor": {"part": 1.0, "power": 2.0, "range": 4.0}},
        {"speed": -3.0},
        {"measures_speed": 1.0},
    ),
    "held_readings": Case({"held_readings": {"time": 1e-9}}),
    "sensor_quantization": Case({"sensor_quantization": {"step": 1e-7}}, amplitude=0.1),
    "parameter_drift": Case(
        {"parameter_drift": {"K_L": -1e-4, "omega_n": 2e-4, "zeta": 5e-4, "K_L_thermal": 5e-3}},
        {"since": 900.0, "warmth": 20.0},
        tolerance=1e-3,
    ),
    "all lags": Case(
        {"transport_delay": {"time": 7e-4}, "valve_lag": {"time": 2e-3}, "sensor_lag": {"time": 2e-3}}
    ),
    "a valve as they are": Case(
        {
            "valve_lag": {"time": 2e-3},
            "valve_deadband": {"half_width": 0.1},
            "valve_hysteresis": {"half_width": 0.05},
            "null_shift": {"voltage": -0.2},
            "asymmetric_gain": {"ratio": -0.15},
            "square_root_flow": {"supply": 500.0},
        },
        {"speed": 3.0},
        amplitude=1e-6,
        ramp=3e-4,
        tolerance=2e-3,
    ),
    "a load as they are": Case(
        {
            **FRICTION,
            "load_bias": {"acceleration": -60.0},
            "load_resonance": {"inertia": 0.3, "omega": 300.0, "zeta": 0.1},
            "square_root_flow": {"supply": 500.0},
            "pressure_dependent_stiffness": {"air": 0.3},
            "sensor_lag": {"time": 1e-3},
        },
        {"speed": -3.0, "supply": 1.3},
    ),
}


def run(case: Case, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """What the kernel measures at `t`, the commands given at the same times."""
    record = case.record()
    state = new_state(record, position=case.at.get("position", 0.0))
    state["origin"] = -case.at.get("since", 0.0)
    conditions = [
        np.full(len(t), case.at.get(name, null)) for name, null in (("supply", 1.0), ("warmth", 0.0))
    ]
    y = np.empty(len(t))
    follow(record[0], state[0], t, u, t, NONE, *conditions, NONE, y)
    assert np.isfinite(y).all()
    return y


def measured_response(case: Case, omega: float, volts: float) -> complex:
    """Demodulated change of the measurement over that of the command, of the last ten periods."""
    period = 2.0 * np.pi / omega
    t = np.arange(int((1.2 + 10.0 * period) / period) * COMMANDS) * period / COMMANDS
    sine = case.amplitude * np.sin(omega * t)
    held = volts + case.ramp * t
    y = 0.5 * (run(case, t, held + sine) - run(case, t, held - sine))
    last = slice(-10 * COMMANDS, None)
    regressors = np.stack([np.sin(omega * t), np.cos(omega * t), np.ones(len(t)), t - t[-1]], axis=1)[last]
    real, imaginary = np.linalg.lstsq(regressors, y[last], rcond=None)[0][:2]
    return complex(real, imaginary) / case.amplitude


def expected_response(response: Any, omega: float) -> complex:
    """Of a command in steps, seen at their times: images of the sine about the steps' frequency fold back."""
    step = 2.0 * np.pi / omega / COMMANDS
    images = omega * (1.0 + COMMANDS * np.arange(-3, 4))
    hold = (1.0 - np.exp(-1j * images * step)) / (1j * images * step)
    folded = np.where(images > 0.0, response(abs(images)), response(abs(images)).conj())
    return complex(np.sum(folded * hold))


@pytest.mark.parametrize("name", CASES)
def test_the_linearised_plant_has_the_simulated_frequency_response(name: str) -> None:
    case = CASES[name]
    signal = small_signal(case.record(), **case.at)
    assert signal.steady.blocked == ()
    for omega in FREQUENCIES:
        expected = expected_response(signal.response, omega)
        found = measured_response(case, omega, signal.steady.volts)
        assert abs(found - expected) < case.tolerance * abs(expected), (omega, found, expected)


def test_every_effect_on_the_plant_has_a_case() -> None:
    seen = {name for case in CASES.values() for name in case.effects}
    assert seen == {name for name, effect in EFFECTS.items() if effect.enters != "record"}


BLOCKED = {
    "valve_saturation": Case({"valve_saturation": {"limit": 0.5}}, {"volts": 0.6}),
    "valve_hysteresis": Case({"valve_hysteresis": {"half_width": 0.1}}, {"direction": 0.0}),
    "valve_deadband": Case({"valve_deadband": {"half_width": 0.1}}, {"direction": 0.0}),
    "coulomb_friction": Case({"coulomb_friction": {"level": 40.0}}, {"volts": 0.005}),
    "stribeck_friction": Case({"stribeck_friction": {"level": 40.0}}, {"direction": 0.0}),
    "backlash": Case({"backlash": {"gap": 0.1}}, {"direction": 0.0}),
    "stops": Case({}, {"volts": 0.3, "position": 0.2}, {"stop_low": -0.2, "stop_high": 0.2}),
}


@pytest.mark.parametrize("name", BLOCKED)
def test_what_is_blocked_does_not_answer(name: str) -> None:
    case = BLOCKED[name]
    signal = small_signal(case.record(), **case.at)
    assert signal.steady.blocked == (name,)
    assert signal.K_L == 0.0
    assert not signal.response(FREQUENCIES).any()
    assert measured_response(case, 30.0, signal.steady.volts) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("effect", ["valve_deadband", "valve_hysteresis"])
def test_a_relay_meets_a_smaller_gain_behind_an_overlap_or_a_play(effect: str) -> None:
    relay = np.zeros(1, RELAY)
    relay["e_a"], relay["hysteresis"] = 0.5, 1e-3
    t = np.linspace(0.01, 1.0, 50)
    cycles = []
    for K_L, effects in ((17.0, {effect: {"half_width": 0.2}}), (17.0 * 0.3 / 0.5, {})):
        record, y = parameters(K_L, 117.0, 0.21, effects), np.empty(len(t))
        ideal_relay(record[0], new_state(record)[0], relay[0], t, y, NONE)
        cycles.append(y)
    assert cycles[0] == pytest.approx(cycles[1], abs=1e-9)
