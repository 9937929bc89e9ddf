"""The kernel on any plant under any commands: it comes to an end, and what has bounds stays within them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_laws import Laws

from sim import kernel, runs
from sim.effects import EFFECTS, LEAST, stiffest_bristles
from sim.parameters import parameters
from sim.state import new_state


def values_of(effect):
    """Of one effect: over the ranges that a rig can have, null and extreme ones included."""
    highest = {"unit/s^2": 5e3, "1/s^2": 2e4, "V": 5.0, "unit": 0.5, "s": 0.02, "1/s": 200.0, "1/K": 0.1}

    def number(each):
        high = min(each.high, highest.get(each.unit, each.high), 1e3)
        low = max(each.low, -high)
        if effect.name == "parameter_drift":
            # the temperature jumps by 20 K from row to row: more, and the oil's stiffness pumps the load up
            low, high = (-0.02, 0.02) if each.unit == "1/K" else (each.low, each.high)
        lowest = {
            "load_resonance.omega": 100.0,
            "stribeck_friction.speed": 0.1,
            "square_root_flow.supply": 1.0,
        }
        low = max(low, lowest.get(f"{effect.name}.{each.name}", low))
        if f"{effect.name}.{each.name}" in LEAST:
            return st.just(0.0) | st.floats(LEAST[f"{effect.name}.{each.name}"], high)
        return st.just(max(low, min(each.null, high))) | st.floats(low, high)

    return st.fixed_dictionaries({each.name: number(each) for each in effect.parameters})


BESIDE = {"lugre_friction", "spool_inertia"}
ACT_ON_THE_PLANT = [e for e in EFFECTS.values() if e.enters != "record" and e.name not in BESIDE]


@st.composite
def plants(draw):
    names = draw(st.lists(st.sampled_from(range(len(ACT_ON_THE_PLANT))), unique=True, max_size=6))
    effects = {ACT_ON_THE_PLANT[k].name: draw(values_of(ACT_ON_THE_PLANT[k])) for k in names}
    if draw(st.booleans()):
        effects["coulomb_friction"] = {"level": draw(st.floats(1.0, 1000.0))}
        values = {f"{name}.{of}": value for name, group in effects.items() for of, value in group.items()}
        stiffest = stiffest_bristles(values) * values["coulomb_friction.level"]
        effects["lugre_friction"] = {
            "stiffness": min(draw(st.floats(1e3, 1e5)), stiffest),
            "damping": draw(st.floats(0.0, 500.0)),
        }
    if valve_map := effects.get("static_valve_map"):
        first, second = sorted(valve_map[f"knot_{k}"] for k in (1, 2))
        valve_map |= {"knot_1": min(first, 0.97), "knot_2": max(second, min(first, 0.97) + 0.011)}
    lag = effects.get("valve_lag", {}).get("time", 0.0)
    if lag > 0.0 and draw(st.booleans()):
        effects["spool_inertia"] = {"omega": max(1.0, draw(st.floats(0.11, 10.0)) / lag)}
    low, high = draw(st.sampled_from([(-math.inf, math.inf), (-0.05, 0.05), (0.0, 0.3)]))
    return parameters(
        draw(st.floats(0.01, 100.0)),
        draw(st.floats(3.0, 400.0)),
        draw(st.floats(0.02, 5.0)),
        effects,
        stop_low=low,
        stop_high=high,
        measures_speed=float(draw(st.booleans())),
    )


def worth(p, volts):
    """What a command is worth behind saturation and map [V], by the laws written apart."""
    limit, name = float(p["valve_saturation_limit"][0]), "static_valve_map"
    values = {each.name: float(p[f"{name}_{each.name}"][0]) for each in EFFECTS[name].parameters}
    return Laws(1.0, 1.0, 1.0, {name: values}, 0.0).worth(min(max(volts, -limit), limit))


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    plants(),
    st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=8),
    st.lists(st.floats(0.0, 2.0), min_size=2, max_size=2),
    st.floats(-1e3, 1e3),
)
def test_any_plant_stays_finite_and_within_its_bounds(p, volts, supply, start):
    t = start + np.linspace(0.0, 0.05, 60)
    t_u = np.linspace(start, start + 0.05, len(volts))
    low, high, gap = (float(p[name][0]) for name in ("stop_low", "stop_high", "backlash_gap"))
    s, most = new_state(p, t=start, position=0.0), 0.0
    for k in range(1, len(t)):
        s["supply"], s["warmth"] = supply[k % 2], 20.0 * (k % 3 - 1)
        for arriving in np.array(volts)[(t_u > t[k - 1]) & (t_u <= t[k])]:
            kernel.command(p[0], s[0], arriving)
            most = max(most, abs(worth(p, arriving)))
        kernel.advance(p[0], s[0], t[k])
        assert s["t"][0] == t[k]
        assert all(np.isfinite(s[name]).all() for name in s.dtype.names if name != "taken")
        assert s["taken"][0] == -math.inf  # readings are held by what runs the kernel, which none does here
        assert math.isfinite(kernel.quantized(p[0], kernel.measured(p[0], s[0])))
        assert low <= s["position"][0] <= high
        assert abs(s["position"][0] - s["followed"][0]) <= gap / 2.0 + 1e-12
        assert abs(s["target"][0]) <= most * (1.0 + 1e-9)
        if s["motion"][0] == 0.0 or s["stopped"][0] != 0.0:
            assert s["velocity"][0] == 0.0


@settings(max_examples=40, deadline=None)
@given(plants(), st.floats(0.01, 10.0), st.floats(0.0, 0.01), st.floats(0.0, 0.5))
def test_any_plant_bears_a_relay(p, e_a, latency, shift):
    r, t = np.zeros(1, runs.RELAY), np.arange(-0.02, 0.1, 1e-3)
    r["e_a"], r["latency"], r["cycles"], r["shift"] = e_a, latency, 2.0, shift
    r["velocity_mode"] = p["measures_speed"]
    y, u, t_u, none = np.empty(len(t)), np.empty(len(t)), np.empty(len(t)), np.empty(0)
    runs.sampled_relay(p[0], new_state(p, t=t[0])[0], r[0], t, none, none, none, none, y, u, t_u)
    assert np.isfinite(y).all()
    assert set(np.abs(u)) == {e_a}
