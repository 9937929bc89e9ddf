"""The linearised plant against the derivatives of the kernel's equations, and against itself."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from sim import physics
from sim.effects import stiffest_bristles
from sim.linear import SmallSignal, small_signal
from sim.parameters import parameters
from sim.state import new_state

if TYPE_CHECKING:
    from collections.abc import Mapping

    Effects = dict[str, dict[str, float]]

RANGES = {
    "transport_delay": {"time": (0.0, 0.01)},
    "valve_saturation": {"limit": (1.0, 10.0)},
    "static_valve_map": {
        **{f"bend_{k}": (-0.03, 0.03) for k in range(1, 3)},
        **{f"tilt_{k}": (-0.03, 0.03) for k in range(1, 4)},
        "range": (0.8, 1.6),
        "knot_1": (0.2, 0.5),
        "knot_2": (0.55, 0.8),
        "rounding": (0.0, 1.0),
    },
    "valve_hysteresis": {"half_width": (0.0, 0.2)},
    "valve_lag": {"time": (1e-4, 0.01)},
    "spool_inertia": {"omega": (2e3, 1e4)},
    "null_shift": {"voltage": (-0.5, 0.5)},
    "valve_deadband": {"half_width": (0.0, 0.2)},
    "asymmetric_gain": {"ratio": (-0.5, 0.5)},
    "square_root_flow": {"supply": (300.0, 3000.0)},
    "pressure_dependent_stiffness": {"air": (0.0, 2.0)},
    "load_bias": {"acceleration": (-100.0, 100.0)},
    "load_spring": {"stiffness": (0.0, 5000.0), "centre": (-0.01, 0.01)},
    "coulomb_friction": {"level": (1.0, 50.0)},
    "stribeck_friction": {"level": (0.0, 20.0), "speed": (2.0, 10.0)},
    "lugre_friction": {"stiffness": (1e3, 1e5), "damping": (0.0, 50.0)},
    "load_resonance": {"inertia": (0.1, 3.0), "omega": (20.0, 2000.0), "zeta": (0.01, 0.5)},
    "backlash": {"gap": (1e-3, 0.1)},
    "position_ripple": {"amplitude": (0.0, 0.05), "wavenumber": (0.1, 10.0), "phase": (-3.0, 3.0)},
    "sensor_nonlinearity": {
        **{f"order_{n}": (-0.02, 0.02) for n in range(2, 7)},
        "centre": (-0.03, 0.03),
        "half": (0.1, 0.2),
    },
    "sensor_lag": {"time": (1e-4, 0.01)},
    "parameter_drift": {"K_L": (-0.1, 0.1), "omega_n_thermal": (-0.01, 0.01), "zeta": (-0.1, 0.1)},
}
LUGRE = "lugre_friction"
NEEDED = {LUGRE: "coulomb_friction", "spool_inertia": "valve_lag"}


@st.composite
def effects_of(draw: st.DrawFn, names: tuple[str, ...] = tuple(RANGES)) -> Effects:
    chosen = draw(st.sets(st.sampled_from(names)))
    chosen.update(NEEDED[name] for name in sorted(chosen) if name in NEEDED)
    drawn = {
        name: {of: draw(st.floats(*limits)) for of, limits in RANGES[name].items()} for name in sorted(chosen)
    }
    if LUGRE in chosen:
        values = {f"{name}.{of}": value for name, group in drawn.items() for of, value in group.items()}
        stiffest = stiffest_bristles(values) * values["coulomb_friction.level"]
        drawn[LUGRE]["stiffness"] = min(drawn[LUGRE]["stiffness"], stiffest)
    return drawn


plants = st.fixed_dictionaries(
    {"K_L": st.floats(0.1, 100.0), "omega_n": st.floats(5.0, 500.0), "zeta": st.floats(0.05, 3.0)}
)
conditions = st.fixed_dictionaries(
    {
        "position": st.floats(-0.05, 0.05),
        "supply": st.floats(0.5, 1.5),
        "warmth": st.floats(-20.0, 20.0),
        "since": st.floats(0.0, 3.0),
    }
)
speeds = st.one_of(st.floats(0.05, 5.0), st.floats(-5.0, -0.05))


def in_the_kernel(
    record: np.ndarray, signal: SmallSignal, at: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, float]:
    """State of the kernel in the steady state of `signal`, its part that is integrated, and the spool."""
    s, p = signal.steady, record[0]
    state = new_state(record, position=at["position"])
    state["supply"], state["warmth"], state["motion"] = at["supply"], at["warmth"], s.direction
    stiffness = p["lugre_friction_stiffness"]
    surplus = physics.drive(p, state[0], 0.0, s.pressure, at["position"], 0.0)
    bristle = surplus / stiffness if stiffness > 0.0 else 0.0
    spool = s.volts - s.direction * p["valve_hysteresis_half_width"]
    return (
        state,
        np.array([s.pressure, s.speed, at["position"], s.speed, at["position"], bristle, 0.0]),
        spool,
    )


INTEGRATED = ("pressure", "velocity", "position", "velocity2", "position2", "bristle", "reading")


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    plant=plants,
    effects=effects_of(
        tuple(RANGES.keys() - {"backlash", "valve_saturation", "static_valve_map"})
    ),  # which have kinks
    at=conditions,
    speed=speeds,
    measures_speed=st.sampled_from([0.0, 1.0]),
)
def test_the_matrices_are_the_derivatives_of_the_kernels_equations(
    plant: dict[str, float], effects: Effects, at: dict[str, float], speed: float, measures_speed: float
) -> None:
    record = parameters(**plant, measures_speed=measures_speed, effects=effects)
    signal = linearised(record, speed=speed, **at)
    state, z, spool = in_the_kernel(record, signal, at)
    p, s = record[0], state[0]
    assume(abs(spool - p["null_shift_voltage"]) > p["valve_deadband_half_width"] + 1e-4)

    def rates(x: np.ndarray) -> np.ndarray:
        return np.array(physics.rates(p, s, tuple(x[1:]), at["since"], physics.opening(p, x[0])))

    x = np.array([spool, *z])
    still = rates(x)[:2] / plant["omega_n"] ** 2
    assert still == pytest.approx([0.0, 0.0], abs=1e-10 * (1.0 + np.abs(z).max()))

    steps = np.diag([1e-6, 1e-3, *[1e-6] * 4, 1e-6 * abs(z[5]) + 1e-12, 1e-6])
    slopes = np.array([(rates(x + step) - rates(x - step)) / (2.0 * step.max()) for step in steps]).T
    there = [k for k, name in enumerate(INTEGRATED) if name in signal.states]
    rows = [signal.states.index(INTEGRATED[k]) for k in there]
    column = signal.A[:, signal.states.index("spool")] if "spool" in signal.states else signal.B
    expected = np.column_stack([column[rows], signal.A[np.ix_(rows, rows)]])
    found = slopes[np.ix_(there, [0, *(k + 1 for k in there)])]
    assert (np.abs(found - expected) <= 1e-5 * np.abs(expected).max(axis=1, keepdims=True)).all()


@given(
    plant=plants,
    effects=effects_of(("position_ripple", "sensor_nonlinearity", "backlash")),
    at=conditions,
    speed=speeds,
    measures_speed=st.sampled_from([0.0, 1.0]),
)
def test_the_output_is_the_derivative_of_what_the_kernel_sees(
    plant: dict[str, float], effects: Effects, at: dict[str, float], speed: float, measures_speed: float
) -> None:
    record = parameters(**plant, measures_speed=measures_speed, effects=effects)
    signal = linearised(record, speed=speed, **at)
    state = new_state(record, position=at["position"])
    step = math.copysign(1e-7, speed)

    def seen(position: float, speed: float) -> float:
        # The load takes along what is behind the backlash.
        state["followed"] = position - 0.5 * math.copysign(float(record["backlash_gap"][0]), speed)
        state["position"], state["motion"] = position, math.copysign(1.0, speed)
        return physics.seen(record[0], state[0], position, speed)

    still, position = seen(at["position"], speed), at["position"]
    slopes = {
        "position": (seen(position + step, speed) - still) / step,
        "velocity": (seen(position, speed + step) - still) / step,
    }
    for name, slope in slopes.items():
        assert signal.C[signal.states.index(name)] == pytest.approx(slope, abs=1e-4 * (1.0 + abs(slope)))


def linearised(record: np.ndarray, **at: float) -> SmallSignal:
    """Where the supply can hold the load."""
    try:
        return small_signal(record, **at)
    except ValueError:
        assume(False)
        raise


@pytest.mark.slow
@given(plant=plants, effects=effects_of(), at=conditions, speed=speeds)
def test_a_speed_and_the_command_that_makes_it_are_one_state(
    plant: dict[str, float], effects: Effects, at: dict[str, float], speed: float
) -> None:
    effects.pop("stribeck_friction", None)  # with which one command can have two speeds
    effects.pop("valve_saturation", None)
    by_speed = linearised(parameters(**plant, effects=effects), speed=speed, **at)
    s = by_speed.steady
    by_volts = small_signal(parameters(**plant, effects=effects), volts=s.volts, direction=s.direction, **at)
    assert by_volts.steady.speed == pytest.approx(speed, rel=1e-7, abs=1e-9)
    assert pytest.approx(by_speed.A, rel=1e-5, abs=1e-5) == by_volts.A


@given(plant=plants, effects=effects_of(), at=conditions, direction=st.sampled_from([-1.0, 0.0, 1.0]))
def test_the_mirrored_plant_is_the_same_mirrored(
    plant: dict[str, float], effects: Effects, at: dict[str, float], direction: float
) -> None:
    odd = {"null_shift", "asymmetric_gain", "load_bias"}
    turned = {"centre", "phase", "order_2", "order_4", "order_6", *(f"tilt_{k}" for k in range(1, 4))}
    mirrored = {
        name: {of: -value if name in odd or of in turned else value for of, value in values.items()}
        for name, values in effects.items()
    }
    one = linearised(parameters(**plant, effects=effects), direction=direction, **at)
    at = {**at, "position": -at["position"]}
    other = small_signal(parameters(**plant, effects=mirrored), direction=-direction, **at)
    assert other.steady.blocked == one.steady.blocked
    assert other.steady.volts == pytest.approx(-one.steady.volts)
    assert [other.K_L, other.omega_n, other.zeta] == pytest.approx(
        [one.K_L, one.omega_n, one.zeta], nan_ok=True
    )


@given(plant=plants, effects=effects_of(), at=conditions, direction=st.sampled_from([-1.0, 0.0, 1.0]))
def test_any_plant_has_its_three_numbers(
    plant: dict[str, float], effects: Effects, at: dict[str, float], direction: float
) -> None:
    signal = linearised(parameters(**plant, effects=effects), direction=direction, **at)
    assert (signal.K_L == 0.0) == bool(signal.steady.blocked)
    assert math.isfinite(signal.K_L)
    assert math.isnan(signal.omega_n) == math.isnan(signal.zeta) == signal.steady.held
    assert np.isfinite(signal.response([0.1, 10.0, 1e4])).all()
