"""The compiled kernel against the plant written apart (`plant_truth`): each effect, pairs, relays."""

from __future__ import annotations

import os
from itertools import product

import numpy as np
import pytest
from kernel_cases import (
    ALL_PAIRS,
    EFFECTS_ON,
    K_L,
    NONE,
    OMEGA_N,
    ZETA,
    apart,
    chosen,
    follow,
    record,
    steps,
    stops_of,
)
from plant_truth import Plant
from truth_runs import follow as true_follow
from truth_runs import ideal_relay as true_ideal_relay
from truth_runs import sampled_relay as true_sampled_relay

from sim import runs
from sim.parameters import parameters
from sim.state import new_state

T = np.arange(0.0, 0.1, 1e-3)
T_U, U = steps(0.1, hold=0.017)
SUPPLY = 1.0 + 0.2 * np.sin(30.0 * T)
WARMTH = 10.0 * np.sin(12.0 * T)
SINGLES = [*EFFECTS_ON, "end_stops"]
SEEN_OTHERWISE = [
    "coulomb_friction",
    "backlash",
    "position_ripple",
    "sensor_nonlinearity",
    "sensor_lag",
    "rectified_sensor",
    "end_stops",
]

PAIRS = [
    ("valve_lag", "valve_deadband"),
    ("spool_inertia", "valve_deadband"),
    ("spool_inertia", "asymmetric_gain"),
    ("spool_inertia", "valve_rate_limit"),
    ("valve_rate_limit", "valve_deadband"),
    ("valve_rate_limit", "valve_lag"),
    ("valve_rate_limit", "asymmetric_gain"),
    ("valve_hysteresis", "asymmetric_gain"),
    ("static_valve_map", "valve_saturation"),
    ("static_valve_map", "valve_hysteresis"),
    ("static_valve_map", "valve_lag"),
    ("valve_lag", "square_root_flow"),
    ("square_root_flow", "load_bias"),
    ("square_root_flow", "end_stops"),
    ("load_spring", "coulomb_friction"),
    ("stribeck_friction", "periodic_disturbance"),
    ("coulomb_friction", "load_resonance"),
    ("coulomb_friction", "backlash"),
    ("coulomb_friction", "end_stops"),
    ("lugre_friction", "end_stops"),
    ("load_resonance", "end_stops"),
    ("backlash", "end_stops"),
    ("backlash", "sensor_lag"),
    ("backlash", "position_ripple"),
    ("backlash", "sensor_nonlinearity"),
    ("position_ripple", "sensor_nonlinearity"),
    ("sensor_nonlinearity", "sensor_lag"),
    ("sensor_lag", "rectified_sensor"),
    ("rectified_sensor", "sensor_lag"),
    ("pressure_dependent_stiffness", "parameter_drift"),
    ("transport_delay", "parameter_drift"),
]
"""Those whose laws meet in one place."""

CASES = [(pair, bool(k % 2)) for k, pair in enumerate(PAIRS)]
if "SEOD_ALL_PAIRS" in os.environ:  # takes minutes
    CASES = list(product(ALL_PAIRS, (False, True)))


def truth(names, *, sees_speed=False, conditions=True):
    plant = Plant(K_L, OMEGA_N, ZETA, chosen(*names), stops=stops_of(*names), sees_speed=sees_speed)
    return true_follow(plant, T_U, U, T, *((SUPPLY, WARMTH) if conditions else ()))


def ours(names, *, sees_speed=False, conditions=True):
    extra = {"supply": SUPPLY, "warmth": WARMTH} if conditions else {}
    return follow(record(names, sees_speed=sees_speed), T_U, U, T, **extra)[0]


def test_without_effects_it_is_equation_1():
    assert apart(ours(()), truth((), conditions=False)) < 1e-6


@pytest.mark.parametrize(
    ("name", "sees_speed"),
    [(name, False) for name in SINGLES if name != "rectified_sensor"]  # the position stays above 0
    + [(name, True) for name in SEEN_OTHERWISE],
)
def test_each_effect_is_the_documented_one(name, sees_speed):
    moving = name in {"square_root_flow", "pressure_dependent_stiffness", "parameter_drift"}
    found = ours((name,), sees_speed=sees_speed, conditions=moving)
    assert apart(found, truth((name,), sees_speed=sees_speed, conditions=moving)) < 1e-5
    without = ours((), sees_speed=sees_speed, conditions=moving)
    assert apart(found, without) > 1e-3, "the effect does nothing here"


@pytest.mark.parametrize(("pair", "sees_speed"), CASES)
def test_effects_combine(pair, sees_speed):
    assert apart(ours(pair, sees_speed=sees_speed), truth(pair, sees_speed=sees_speed)) < 1e-5


AT_PORTS = [
    (),
    ("valve_saturation",),
    ("valve_hysteresis",),
    ("valve_lag",),
    ("valve_lag", "asymmetric_gain"),
    ("spool_inertia",),
    ("valve_rate_limit", "null_shift"),
    ("valve_lag", "valve_deadband"),
    ("valve_hysteresis", "valve_lag", "square_root_flow", "coulomb_friction"),
]


@pytest.mark.parametrize("names", AT_PORTS, ids="+".join)
def test_a_map_of_the_ports_acts_on_what_the_spool_opens(names):
    effects = chosen("static_valve_map", *names)
    effects["static_valve_map"] = effects["static_valve_map"] | {"at_ports": 1.0}
    found = follow(record(effects=effects), T_U, U, T, supply=SUPPLY, warmth=WARMTH)[0]
    true = true_follow(Plant(K_L, OMEGA_N, ZETA, effects), T_U, U, T, SUPPLY, WARMTH)
    assert apart(found, true) < 1e-5
    differs = apart(found, ours(("static_valve_map", *names)))
    assert differs > 1e-3 if set(names) - {"valve_saturation"} else differs < 1e-9


def test_everything_at_once():
    names = [name for name in SINGLES if name != "lugre_friction"]
    assert apart(ours(names), truth(names)) < 1e-5


def test_readings_are_whole_counts_of_reading_and_noise():
    effects = {"sensor_quantization": {"step": 0.003}}
    noise = np.random.default_rng(3).normal(0.0, 0.002, len(T))
    y = follow(record(effects=effects), T_U, U, T, noise=noise)[0]
    smooth = follow(record(), T_U, U, T)[0] + noise
    np.testing.assert_allclose(y / 0.003, np.floor(smooth / 0.003 + 0.5), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("latency", [0.0, 3e-4, 1.7e-3], ids=lambda each: f"{each * 1e3:g} ms")
@pytest.mark.parametrize(
    ("names", "sees_speed"),
    [((), False), (("valve_lag", "coulomb_friction"), False), (("transport_delay", "valve_deadband"), True)],
    ids=["Eq. 1", "lag and friction", "speed, delay and overlap"],
)
def test_a_sampled_relay_makes_the_same_decisions(names, sees_speed, latency):
    t = np.arange(0.0, 0.12, 1e-3)
    hysteresis, reference = (1e-4, 2.0) if sees_speed else (0.01, 0.05)
    r = np.zeros(1, runs.RELAY)
    r["e_a"], r["latency"], r["hysteresis"], r["reference"] = 0.5, latency, hysteresis, reference
    r["bias"], r["velocity_mode"] = 0.1, float(sees_speed)
    y, u, t_u = (np.empty(len(t)) for _ in range(3))
    p = record(names, sees_speed=sees_speed)
    runs.sampled_relay(p[0], new_state(p)[0], r[0], t, NONE, NONE, NONE, NONE, y, u, t_u)
    plant = Plant(K_L, OMEGA_N, ZETA, chosen(*names), sees_speed=sees_speed)
    true_y, true_u = true_sampled_relay(plant, 0.5, t, latency, hysteresis, reference, bias=0.1)
    assert np.count_nonzero(np.diff(u)) >= 2
    np.testing.assert_array_equal(u, true_u)
    assert apart(y, true_y) < 1e-5
    np.testing.assert_array_equal(t_u, t + latency)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "options"),
    [
        ((), {"hysteresis": 0.01}),
        ((), {"lag": 2e-3, "reference": 0.02}),
        (("transport_delay", "sensor_lag"), {"hysteresis": 0.005}),
        (("coulomb_friction", "backlash"), {"hysteresis": 0.01}),
        (("square_root_flow", "load_resonance"), {"bias": 0.05, "hysteresis": 0.01}),
        (("stribeck_friction",), {"speed": 2.0, "bias": 0.2, "hysteresis": 0.005}),
    ],
    ids=["hysteresis", "lag", "delay", "backlash", "orifice", "speed"],
)
def test_an_ideal_relay_switches_at_the_same_instants(names, options):
    p, r = record(names), np.zeros(1, runs.RELAY)
    r["e_a"], r["latency"] = 0.5, options.get("lag", 0.0)
    for name in ("hysteresis", "bias"):
        r[name] = options.get(name, 0.0)
    r["velocity_mode"] = float("speed" in options)
    r["reference"] = options.get("speed", options.get("reference", 0.0))
    t, y, switches = np.arange(1e-3, 0.15, 1e-3), np.empty(149), np.zeros(30)
    count = runs.ideal_relay(p[0], new_state(p)[0], r[0], t, y, switches)
    true = true_ideal_relay(Plant(K_L, OMEGA_N, ZETA, chosen(*names)), 0.5, t[-1], **options)
    assert count == len(true) >= 3
    np.testing.assert_allclose(switches[:count], true, atol=2e-5 / OMEGA_N)


@pytest.mark.parametrize(
    ("zeta", "ratio", "gamma"),
    [(0.2, 0.99872, 1.27573), (0.45, 0.99398, 1.28499), (1.0, 0.97801, 1.31663), (4.0, 0.93477, 1.41561)],
)
def test_an_ideal_relay_finds_the_exact_limit_cycle(zeta, ratio, gamma):
    """Frequency over omega_n and amplitude factor by the half-period map (matrix exponential)."""
    p, r = parameters(K_L, OMEGA_N, zeta), np.zeros(1, runs.RELAY)
    r["e_a"], switches = 0.5, np.zeros(1000)
    t = np.arange(1e-5, 60.0 / OMEGA_N * (1.0 + 6.0 * zeta), 1e-5)
    y = np.empty(len(t))
    s = new_state(p, position=-0.1)
    count = runs.ideal_relay(p[0], s[0], r[0], t, y, switches)
    half = switches[count - 1] - switches[count - 2]
    amplitude = np.max(y[t > switches[count - 3]])
    assert np.pi / half / OMEGA_N == pytest.approx(ratio, abs=6e-6)
    assert amplitude / (K_L * 0.5 / (2.0 * zeta * OMEGA_N)) == pytest.approx(gamma, abs=3e-5)


def two_phase(cycles, shift):
    t = np.arange(-1.0, 0.5, 5e-4)  # from before zero: times are only compared
    r = np.zeros(1, runs.RELAY)
    r["e_a"], r["cycles"], r["shift"] = 0.5, cycles, shift
    p, (y, u, t_u) = record(), (np.empty(len(t)) for _ in range(3))
    runs.sampled_relay(p[0], new_state(p, t=-1.0)[0], r[0], t, NONE, NONE, NONE, NONE, y, u, t_u)
    asked = np.flatnonzero(np.diff(np.sign(np.where(y == 0.0, -1.0, y)))) + 1
    made = np.flatnonzero(np.diff(u)) + 1
    n = min(len(asked), len(made)) - 1
    return asked[:n], made[:n] - asked[:n]


def test_two_phases_alternate():
    asked, late = two_phase(cycles=3, shift=0.25)
    starts = np.flatnonzero(np.diff((late > 0).astype(int))) + 1
    phases = np.split(late, starts)[1:-1]
    assert len(phases) >= 4
    for phase in phases:
        assert len(phase) == 6
        assert np.ptp(phase) == 0
    undisturbed = asked[starts[0] - 1] - asked[starts[0] - 3]
    assert phases[0][0] == pytest.approx(0.25 * undisturbed, abs=1.0)
    assert not phases[1].any()


@pytest.mark.parametrize("hold", [2.7e-3, 4e-3, 0.3e-3])
def test_held_readings_are_those_of_the_sensors_own_times(hold):
    """Each row shows the reading at the last multiple of `hold`, by the plant written apart."""
    at = np.unique(np.floor(T / hold + 1e-6) * hold)
    times = np.unique(np.concatenate([at, T]))
    every = true_follow(Plant(K_L, OMEGA_N, ZETA), T_U, U, times)
    expected = every[np.searchsorted(times, np.floor(T / hold + 1e-6) * hold - 1e-12)]
    found = follow(record(effects={"held_readings": {"time": hold}}), T_U, U, T)[0]
    assert apart(found, expected) < 1e-5
    assert apart(found, every[np.searchsorted(times, T)]) > 1e-3


def test_a_held_reading_keeps_its_noise_and_its_counts():
    effects = {"held_readings": {"time": 4e-3}, "sensor_quantization": {"step": 0.003}}
    noise = np.random.default_rng(3).normal(0.0, 0.002, len(T))
    y = follow(record(effects=effects), T_U, U, T, noise=noise)[0]
    plain = follow(record(effects={"sensor_quantization": {"step": 0.003}}), T_U, U, T, noise=noise)[0]
    np.testing.assert_array_equal(y, np.repeat(plain[::4], 4)[: len(T)])


@pytest.mark.parametrize("sees_speed", [False, True])
@pytest.mark.parametrize("names", [(), ("coulomb_friction",), ("load_resonance",)])
def test_a_measured_disturbance_pushes_the_load(names, sees_speed):
    force = 3.0 + np.sin(40.0 * T)
    effects = {name: EFFECTS_ON[name] for name in names} | {
        "measured_disturbance": {"gain": 30.0, "zero": -2.0}
    }
    y = follow(record(effects=effects, sees_speed=sees_speed), T_U, U, T, force=force)[0]
    plant = Plant(K_L, OMEGA_N, ZETA, effects, sees_speed=sees_speed)
    assert apart(y, true_follow(plant, T_U, U, T, force=force)) < 1e-5
    assert apart(y, follow(record(effects=effects, sees_speed=sees_speed), T_U, U, T)[0]) > 0.01
