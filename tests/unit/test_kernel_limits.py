"""What must hold of the kernel whatever its equations: limits, symmetries, equivalences."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from kernel_cases import (
    EFFECTS_ON,
    K_L,
    NEEDED,
    OMEGA_N,
    STOPS,
    ZETA,
    apart,
    chosen,
    follow,
    record,
    steps,
)
from plant_truth import Plant
from truth_runs import follow as true_follow

from sim import kernel
from sim.effects import EFFECTS, parameter
from sim.parameters import nulls, parameters
from sim.state import new_state
from sim.substep import longest_substep, next_substep

T = np.arange(0.0, 0.4, 1e-3)
T_U, U = steps(0.4)
BASE = follow(record(), T_U, U, T)[0]


def of(effects, **options):
    return follow(record(effects=effects, **options), T_U, U, T)[0]


def test_null_values_are_the_plant_without_effects():
    groups = {e.name: {each.name: each.null for each in e.parameters} for e in EFFECTS.values()}
    assert len(groups) == len(EFFECTS)
    assert len(nulls()) == sum(map(len, groups.values()))
    np.testing.assert_array_equal(of(groups), BASE)


GONE = {
    "valve_saturation": {"limit": 2.0},
    "valve_rate_limit": {"rate": 1e6},
    "static_valve_map": {"bend_1": 5e-4, "bend_2": 1e-3, "tilt_1": -4e-4, "tilt_3": -5e-4, "range": 0.9},
    "square_root_flow": {"supply": 1e9},
    "rectified_sensor": {"part": 8e-3, "power": 1.007, "range": 4.0},
}
"""Where the effect goes with something large, or with 1; all others go with small numbers."""


@pytest.mark.parametrize("name", [n for n in EFFECTS_ON if n not in {"load_resonance", *NEEDED}])
def test_an_effect_goes_with_its_parameters(name):
    small = {key: 0.01 * value for key, value in EFFECTS_ON[name].items()}
    kept = {
        key: small[key]
        for key in ("omega", "phase", "wavenumber", "speed", "centre", "half", "range")
        if key in small
    }
    gone = GONE.get(name, {**small, **{key: 100.0 * value for key, value in kept.items()}})
    assert apart(of({name: gone}), BASE) < max(0.03 * apart(of(chosen(name)), BASE), 1e-6)


def test_stiffer_bristles_are_dry_friction():
    dry = of({"coulomb_friction": {"level": 400.0}})

    def bristles(stiffness):
        group = {"stiffness": stiffness, "damping": 0.5 * math.sqrt(stiffness)}
        return apart(of({"coulomb_friction": {"level": 400.0}, "lugre_friction": group}), dry)

    assert bristles(1e5) > 4.0 * bristles(1.6e6) > 16.0 * bristles(2.5e7)
    assert bristles(2.5e7) < 5e-4


def test_bristles_that_have_settled_slow_nothing_down_until_the_load_turns_round():
    group = {"coulomb_friction": {"level": 400.0}, "lugre_friction": {"stiffness": 1e7, "damping": 1e3}}
    p, s = record(effects=group)[0], new_state(record(effects=group))[0]
    s["velocity"], s["motion"], s["bristle"] = 5.0, 1.0, 400.0 / 1e7
    longest = longest_substep(p, s, 1.0)
    assert next_substep(p, s, longest, longest) == (longest, True)
    s["motion"] = -1.0  # bent the other way
    assert next_substep(p, s, longest, longest)[0] < 0.3 * longest
    s["motion"], s["bristle"] = 1.0, 0.999 * 400.0 / 1e7
    assert next_substep(p, s, longest, longest)[0] < 0.3 * longest


@pytest.mark.parametrize("by", [-7.3, 1000.0])
@pytest.mark.parametrize(
    "names", [(), tuple(n for n in EFFECTS_ON if n != "lugre_friction")], ids=["none", "all"]
)
def test_it_is_the_same_at_another_time(names, by):
    here = follow(record(names), T_U, U, T)[0]
    assert apart(follow(record(names), T_U + by, U, T + by)[0], here) < 1e-7


SYMMETRIC = [
    n
    for n in EFFECTS_ON
    if n
    not in {
        "null_shift",
        "static_valve_map",
        "asymmetric_gain",
        "load_bias",
        "load_spring",
        "periodic_disturbance",
        "position_ripple",
        "sensor_nonlinearity",
        "rectified_sensor",
    }
]


def test_left_is_right_with_the_sign_turned_round():
    names = (*(n for n in SYMMETRIC if n != "lugre_friction"),)
    np.testing.assert_array_equal(follow(record(names), T_U, -U, T)[0], -follow(record(names), T_U, U, T)[0])


def test_stops_are_symmetric():
    p = parameters(K_L, OMEGA_N, ZETA, stop_low=-0.06, stop_high=0.06)
    np.testing.assert_array_equal(follow(p, T_U, -U, T)[0], -follow(p, T_U, U, T)[0])


def power_of_unit(unit: str) -> int:
    """How a number of this unit goes with the length that stands for `unit`."""
    unit = unit.split(" (", maxsplit=1)[0]
    return 1 if unit.startswith("unit") else -1 if re.search("/unit", unit) else 0


@pytest.mark.parametrize("sees_speed", [False, True], ids=["position", "speed"])
def test_units_are_a_matter_of_taste(sees_speed):
    degrees = 180.0 / math.pi
    names = tuple(n for n in EFFECTS_ON if n != "lugre_friction")
    scaled = {
        name: {
            key: value * degrees ** power_of_unit(parameter(f"{name}.{key}")[1].unit)
            for key, value in group.items()
        }
        for name, group in chosen(*names).items()
    }
    low, high = STOPS
    p = parameters(
        K_L * degrees, OMEGA_N, ZETA, scaled, stop_low=low * degrees, stop_high=high * degrees,
        measures_speed=float(sees_speed),
    )  # fmt: skip
    y = follow(record((*names, "end_stops"), sees_speed=sees_speed), T_U, U, T)[0]
    assert apart(follow(p, T_U, U, T)[0] / degrees, y) < 1e-8


def test_a_linear_plant_is_linear():
    names = ("transport_delay", "valve_lag", "load_resonance", "sensor_lag")
    y = follow(record(names), T_U, U, T)[0]
    assert apart(follow(record(names), T_U, 3.0 * U, T)[0] / 3.0, y) < 1e-12


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"valve_lag": {"time": 2e-3}}, {"sensor_lag": {"time": 2e-3}}),
        (
            {"null_shift": {"voltage": 0.1}},
            {"load_bias": {"acceleration": OMEGA_N * K_L * 0.1 / 2.0 / ZETA}},
        ),
        ({"pressure_dependent_stiffness": {"air": 0.7}}, {}),
        (
            {"load_resonance": {"inertia": 0.3, "omega": 2e4, "zeta": 0.5}},
            {},
        ),
        (
            {"valve_lag": {"time": 2e-3}, "spool_inertia": {"omega": 1e6}},
            {"valve_lag": {"time": 2e-3}},
        ),
        (
            {"valve_lag": {"time": 4e-3}, "spool_inertia": {"omega": 500.0}},
            {"valve_lag": {"time": 2e-3}, "sensor_lag": {"time": 2e-3}},
        ),
    ],
    ids=[
        "lags commute",
        "null shift is a bias",
        "air at nominal pressure",
        "a stiff shaft",
        "a light spool",
        "two lags are a spool",
    ],
)
def test_the_table_of_effects_tells_what_is_equivalent(one, other):
    assert apart(of(one), of(other)) < 1e-5


def test_sticking_is_no_movement_at_all():
    p = record(("stribeck_friction", "coulomb_friction"))
    s = new_state(p)
    kernel.command(p[0], s[0], 1.0)
    kernel.advance(p[0], s[0], 0.05)
    kernel.command(p[0], s[0], 0.0)
    kernel.advance(p[0], s[0], 0.5)
    assert s["motion"][0] == 0.0
    place, pressure = s["position"][0], s["pressure"][0]
    kernel.command(p[0], s[0], 0.05)
    kernel.advance(p[0], s[0], 0.6)
    assert s["velocity"][0] == 0.0
    assert s["position"][0] == place
    assert s["pressure"][0] != pressure


class Counted(Plant):
    rests = 0

    def arrest(self):
        super().arrest()
        self.rests += self.held


def test_it_sticks_as_often_as_the_truth():
    effects = {**chosen("stribeck_friction", "load_spring"), "coulomb_friction": {"level": 1000.0}}
    plant = Counted(K_L, OMEGA_N, ZETA, effects)
    true_follow(plant, T_U, U, T)
    fine = np.arange(0.0, T[-1], 2e-5)
    speed = follow(record(effects=effects, sees_speed=True), T_U, U, fine)[0]
    rests = np.count_nonzero((speed[1:] == 0.0) & (speed[:-1] != 0.0))
    assert rests == plant.rests >= 5


def test_friction_may_be_switched_on_in_any_movement():
    """As a rig's back door does: nothing had asked for the direction before."""
    p, s = record(), new_state(record())
    kernel.command(p[0], s[0], -1.0)
    kernel.advance(p[0], s[0], 0.05)
    speed = s["velocity"][0]
    rubbing = record(("coulomb_friction",))
    kernel.advance(rubbing[0], s[0], 0.05 + 1e-6)
    assert speed < -1.0
    assert s["velocity"][0] == pytest.approx(speed, rel=0.01)
    assert s["motion"][0] == -1.0


@pytest.mark.parametrize("supply", [0.0, 1e-6, -0.1])
def test_without_supply_pressure_it_still_is_a_plant(supply):
    names = ("square_root_flow", "pressure_dependent_stiffness")
    y, s = follow(record(names), T_U, U, T, supply=np.full(len(T), supply))
    assert np.isfinite(y).all()
    assert abs(s["velocity"]) < 0.1 * K_L


@pytest.mark.parametrize(
    ("effects", "told"),
    [
        ({"valve_lag": {"time": 1e-7}}, "valve_lag.time must be 0 or at least 1e-05"),
        ({"backlash": {"gap": 1e-18}}, "backlash.gap must be 0 or at least 1e-15"),
        ({"spool_inertia": {"omega": 700.0}}, "needs valve_lag.time > 0"),
        (
            {"valve_lag": {"time": 1e-4}, "spool_inertia": {"omega": 900.0}},
            "spool_inertia.omega must be at least 0.1 / valve_lag.time",
        ),
        ({"lugre_friction": {"stiffness": 1e5}}, "needs coulomb_friction.level > 0"),
        (
            {"coulomb_friction": {"level": 1e-3}, "lugre_friction": {"stiffness": 1e8}},
            "lugre_friction.stiffness must be at most 1e+09 coulomb_friction.level",
        ),
        (
            {
                "coulomb_friction": {"level": 1.0},
                "stribeck_friction": {"level": 5.0, "speed": 0.1},
                "lugre_friction": {"stiffness": 1e8},
            },
            "lugre_friction.stiffness must be at most 100000 coulomb_friction.level",
        ),
        (
            {"stribeck_friction": {"level": 500.0, "speed": 1e-6}},
            "stribeck_friction.speed must be at least 0.005",
        ),
    ],
)
def test_what_would_take_for_ever_is_refused(effects, told):
    with pytest.raises(ValueError, match=re.escape(told)):
        parameters(K_L, OMEGA_N, ZETA, effects)
