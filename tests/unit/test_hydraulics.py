"""The physical plant: against a truth written apart, its balances, its limits, its small signals."""

import math
from pathlib import Path

import numpy as np
import pytest
from hydraulic_truth import motor, stiffness
from pydantic import ValidationError
from scipy.signal import detrend

from sim.config import PlantConfig
from sim.hydraulics import closed_loop, flow, motion
from sim.hydraulics.linear import Physics, lever, rest_pressures, small_signal
from sim.hydraulics.live import HydraulicPlant
from sim.hydraulics.parts import PARTS
from sim.hydraulics.record import record_of

NONE = np.empty(0)
LITRE = 1e-3 / 60.0
MOTOR = {
    "supply": {"pressure": 8e6},
    "valve": {"rated_flow": 30 * LITRE, "rated_drop": 21e6, "leakage": 0.7 * LITRE},
    "oil": {"air": 0.01},
    "motor": {"displacement": 1.75e-6, "volume": 5e-5},
    "leakage": {"cross": 1e-12},
    "load": {"inertia": 1.92e-2},
}
ROD = {
    "supply": {"pressure": 7e6},
    "valve": {"rated_flow": 30 * LITRE, "rated_drop": 21e6},
    "oil": {"air": 0.0},
    "cylinder": {"piston": 0.04, "rod": 0.025, "half_stroke": 0.14, "volume": 5e-5},
    "load": {"inertia": 300.0},
}
"""Straight, of unit m."""
DAMPED = {"load": {"inertia": 300.0, "viscous": 4e4}, "leakage": {"cross": 1e-12}}


def merged(base, more):
    return {group: {**base.get(group, {}), **more.get(group, {})} for group in {*base, *more}}


def plant(base=MOTOR, more=None, **fields):
    parts = merged(base, more or {})
    return PlantConfig.model_validate(
        {"plant": "hydraulic", "input": "u", "output": "y", "hydraulic": parts, **fields}
    )


def run(config, t, u):
    """Readings, and what is inside by name, under commands at the times."""
    p = record_of(config)
    state = motion.new_state(p, rest_pressures(p, config.position), float(t[0]), config.position)
    y, inside = np.empty(len(t)), np.empty((len(t), len(closed_loop.INSIDE)))
    closed_loop.follow(p[0], state[0], t, u, t, NONE, NONE, NONE, y, inside)
    return y, dict(zip(closed_loop.INSIDE, inside.T, strict=True))


def rows(s):
    """Opening, pressures and speed, row by row."""
    names = ("spool", "pressure_a", "pressure_b", "pressure_s", "velocity")
    return zip(*(s[name] for name in names), strict=True)


@pytest.mark.slow
def test_it_moves_as_a_truth_written_apart():
    p = {
        "rated_flow": 30 * LITRE, "rated_volts": 10.0, "rated_drop": 21e6, "gap": 0.7 / 30 * 10, "ps": 8e6,
        "cross": 1e-12, "D": 1.75e-6, "V": 5e-5, "J": 1.92e-2, "b": 0.0, "oil": 1.4e9, "air": 0.01,
        "omega": 700.0, "zeta": 0.8,
    }  # fmt: skip
    t = np.arange(201) * 5e-4
    _, inside = run(plant(), t, np.full(len(t), 1.5))
    true = motor(1.5, t, p)
    for column, name in enumerate(("pressure_a", "pressure_b", "velocity", "position")):
        scale = np.ptp(true[:, column])
        assert np.abs(inside[name] - true[:, column]).max() < 2e-4 * scale, name


def test_no_air_means_a_constant_bulk_modulus():
    without = Physics(record_of(plant(more={"oil": {"air": 0.0}})), 0.0)
    assert without.stiffness(0.0) == without.stiffness(2e7) == 1.4e9
    with_air = Physics(record_of(plant()), 0.0)
    for pressure in (0.0, 1e6, 4e6, 1e7):
        assert with_air.stiffness(pressure) == pytest.approx(stiffness(pressure), rel=1e-12)
    assert with_air.stiffness(1e6) < 0.8 * with_air.stiffness(1e7)


def test_oil_is_neither_made_nor_lost():
    """Flow into both chambers equals what compresses there and what the piston sweeps."""
    config = plant(ROD)
    t = np.arange(4001) * 1e-4
    u = 2.0 * np.sin(2 * math.pi * 5 * t)
    _, s = run(config, t, u)
    physics = Physics(record_of(config), 0.0)
    piston, ring = math.pi * 0.04**2 / 4, math.pi * (0.04**2 - 0.025**2) / 4
    for k, (side, area, sign) in enumerate((("pressure_a", piston, 1.0), ("pressure_b", ring, -1.0))):
        flows = np.array([physics.ports(o, pa, pb, ps)[0][k] for o, pa, pb, ps, _ in rows(s)])
        volume = 5e-5 + area * (0.14 + sign * s["position"])
        stored = (
            np.concatenate(([0.0], np.cumsum(0.5 * (volume[1:] + volume[:-1]) * np.diff(s[side])))) / 1.4e9
        )
        swept = sign * area * (s["position"] - s["position"][0])
        given = np.concatenate(([0.0], np.cumsum(0.5 * (flows[1:] + flows[:-1]) * np.diff(t))))
        assert np.abs(given - stored - swept).max() < 2e-4 * np.ptp(swept)


def test_energy_goes_into_movement_oil_orifices_and_friction():
    config = plant(more={"load": {"inertia": 1.92e-2, "viscous": 2e-3}, "oil": {"air": 0.0}})
    t = np.arange(8001) * 5e-5
    _, s = run(config, t, 1.5 * np.sin(2 * math.pi * 8 * t))
    physics = Physics(record_of(config), 0.0)
    spent = []
    for o, pa, pb, ps, w in rows(s):
        k, gap = physics.conductance, physics.p["clearance"]
        forth, back = k * (max(o, 0) + gap), k * (max(-o, 0) + gap)
        drops = ((forth, ps - pa), (back, pa), (back, ps - pb), (forth, pb))
        heat = sum(size * physics.root(drop)[0] * drop for size, drop in drops)
        supplied = ps * (forth * physics.root(ps - pa)[0] + back * physics.root(ps - pb)[0])
        spent.append(supplied - heat - 1e-12 * (pa - pb) ** 2 - 2e-3 * w * w)
    spent = np.array(spent)
    given = np.concatenate(([0.0], np.cumsum(0.5 * (spent[1:] + spent[:-1]) * np.diff(t))))
    oil = 5e-5 / 2.8e9 * (s["pressure_a"] ** 2 + s["pressure_b"] ** 2)
    kept = 0.5 * 1.92e-2 * s["velocity"] ** 2 + oil
    assert np.abs(given - (kept - kept[0])).max() < 2e-3 * np.ptp(kept)


@pytest.mark.parametrize("speed", [0.0, 32.5, 120.0])
def test_small_signals_of_a_motor_are_those_of_the_textbook(speed):
    """By hand, for a symmetrical motor: Merritt, Hydraulic Control Systems, chapter 6."""
    config = plant(more={"valve": {"leakage": 0.0}})
    found = small_signal(record_of(config), speed=speed)
    ps, D, V, J = 8e6, 1.75e-6, 5e-5, 1.92e-2
    k = 30 * LITRE / 10 / math.sqrt(21e6 / 2)
    leak_flow = 0.0 if speed == 0.0 else D * speed
    opening = leak_flow / (k * math.sqrt(ps / 2))
    K_c = k * opening / (4 * math.sqrt(ps / 2)) + 1e-12  # per load pressure
    E = stiffness(ps / 2)
    omega_n = math.sqrt(2 * E * D * D / (V * J))
    assert found.omega_n == pytest.approx(omega_n, rel=1e-5)
    assert found.zeta == pytest.approx(K_c * E / (V * omega_n), rel=1e-4)
    assert pytest.approx(k * math.sqrt(ps / 2) / D, rel=1e-5) == found.K_L


@pytest.mark.parametrize(
    ("base", "more", "speed"),
    [
        (MOTOR, {}, 32.5),
        (MOTOR, {"supply": {"droop": 5e8}, "load": {"viscous": 0.01}}, 32.5),
        (MOTOR, {"load": {"second": 0.3, "second_omega": 300.0}}, 20.0),
        (ROD, DAMPED, 0.02),
        (ROD, DAMPED, -0.02),
    ],
)
def test_small_signals_are_what_small_movements_do(base, more, speed):
    """A small sine on a steady movement: gain and phase of the matrices, spool taken away."""
    config = plant(base, merged(more, {"valve": {**base["valve"], "omega": 1e4, "zeta": 1.0}}))
    small = small_signal(record_of(config), speed=speed)
    omega = 0.8 * small.omega_n
    slow = small.omega_n * (small.zeta - math.sqrt(max(0.0, small.zeta**2 - 1.0)))
    tick = 2 * math.pi / omega / 400
    t = np.arange(round(10.0 / slow / tick) + 8000) * tick
    tiny = 1e-2 * abs(small.steady.opening)
    _, s = run(config, t, small.steady.volts + tiny * np.sin(omega * t))
    wave = np.exp(-1j * omega * t[-8000:])
    moved, opened = (detrend(s[name][-8000:]) for name in ("velocity", "spool"))
    seen = (moved * wave).mean() / (opened * wave).mean()
    if base is ROD:  # it has moved
        small = small_signal(record_of(config), speed=speed, position=s["position"][-4000])
    matrices = small.C @ np.linalg.solve(1j * omega * np.eye(len(small.A)) - small.A, small.B)
    assert abs(seen / matrices - 1) < 0.01


@pytest.mark.parametrize("leakage", [0.0, 0.7 * LITRE])
def test_about_rest_a_single_rod_moves_as_its_small_signals_say(leakage):
    """Leakage between its chambers would let it creep: the valve holds it, and the chambers stay full."""
    config = plant(ROD, merged(DAMPED, {"valve": {"leakage": leakage}}))
    small, step = small_signal(record_of(config)), 1e-2
    t = np.arange(3000) * 1e-3
    forth, back = (run(config, t, np.full(len(t), small.steady.volts + v))[1] for v in (step, -step))
    assert (forth["velocity"][-1] - back["velocity"][-1]) / (2.0 * step) == pytest.approx(small.K_L, rel=0.02)
    assert small.steady.pressure_a == pytest.approx(7e6 / (1.0 + 0.04**2 / (0.04**2 - 0.025**2)), rel=0.01)


def test_a_single_rod_extends_faster_than_it_retracts():
    """Without load, through a symmetrical valve: by the root of the areas' ratio."""
    t = np.arange(2000) * 5e-4
    forth = run(plant(ROD), t, np.full(len(t), 1.0))[1]["velocity"][-1]
    back = run(plant(ROD), t, np.full(len(t), -1.0))[1]["velocity"][-1]
    ratio = 0.04**2 / (0.04**2 - 0.025**2)
    assert -forth / back == pytest.approx(math.sqrt(ratio), rel=2e-3)


def test_friction_holds_and_lets_go():
    config = plant(more={"load": {"coulomb": 2.0}, "valve": {"leakage": 0.0}, "leakage": {"cross": 1e-11}})
    t = np.arange(4000) * 5e-4
    held = run(config, t, np.full(len(t), 0.05))[1]
    # leakage takes the flow of so small an opening before the pressure reaches the friction
    assert np.all(held["velocity"] == 0.0)
    assert abs(1.75e-6 * (held["pressure_a"] - held["pressure_b"])[-1]) < 2.0
    free = run(config, t, np.full(len(t), 0.5))[1]
    assert free["velocity"][-1] > 1.0


def test_a_stop_holds_the_load_and_lets_it_leave():
    config = plant(stops=[-0.1, 0.1])
    t = np.arange(2000) * 5e-4
    y = run(config, t, np.where(t < 0.5, 2.0, -2.0))[0]
    assert y.max() == 0.1
    assert y[-1] == -0.1


def test_droop_relief_and_ripple_of_the_supply():
    droop = plant(more={"supply": {"droop": 1e9, "flow": 1e-3, "volume": 2e-3, "ripple": 0.05}})
    t = np.arange(4000) * 5e-4
    still = run(droop, t, np.zeros(len(t)))[1]["pressure_s"][2000:]
    moving = run(droop, t, np.full(len(t), 5.0))[1]["pressure_s"][2000:]
    fed = small_signal(record_of(droop), speed=75.0).steady
    assert np.mean(still) == pytest.approx(8e6 - 1e9 * small_signal(record_of(droop)).steady.demand, rel=2e-3)
    assert np.mean(still) - np.mean(moving) == pytest.approx(8e6 - fed.supply, rel=0.4)
    assert 1e3 < np.ptp(still) < 2 * 0.05 * 1e-3 * 1e9


def test_no_chamber_falls_below_the_vapour_pressure():
    config = plant(more={"oil": {"air": 0.0}, "load": {"inertia": 0.2}})
    t = np.arange(2000) * 5e-4
    s = run(config, t, np.where(t < 0.5, 8.0, 0.0))[1]  # the load runs on, its valve shut
    assert min(s["pressure_a"].min(), s["pressure_b"].min()) == -9.5e4


CRANK = {"cylinder": {"base": 0.43, "length": 0.35, "arm": 0.25}, "load": {"inertia": 20.0}}


@pytest.mark.parametrize("parts", [MOTOR, ROD, merged(ROD, CRANK)])
def test_substeps_are_short_enough(parts):
    """Substeps an eighth as long change nothing that matters."""
    t = np.arange(1000) * 5e-4
    u = 3.0 * np.sign(np.sin(2 * math.pi * 12 * t))
    fine_t = np.arange(8000) * (5e-4 / 8)
    coarse = run(plant(parts), t, u)[1]["velocity"]
    fine = run(plant(parts), fine_t, np.repeat(u, 8))[1]["velocity"][::8]
    assert np.abs(coarse - fine).max() < 1e-3 * np.ptp(fine)


def test_what_is_expanded_about_a_state_is_the_physics():
    """Stiffness of oil and supply, stroke and lever near where they were computed, and far from it."""
    p = record_of(plant(merged(ROD, CRANK), {"oil": {"air": 0.02}, "supply": {"droop": 5e8}}))
    s = motion.new_state(p, (3e6, 4e6), position=0.2)[0]
    motion.begin(p[0], s)
    physics = Physics(p, 0.2)
    for base in ("a", "b", "s"):
        about = [s[f"{name}_{base}"] for name in ("absolute", "inverse", "air")]
        for off, exact in ((0.0, 1e-12), (0.09, 2e-8), (-0.09, 2e-8), (0.29, 1e-5), (2.0, 1e-12)):
            pressure = about[0] * (1.0 + off) - 101325.0
            over, under = flow.near(p[0], pressure, *about)
            assert over / under == pytest.approx(physics.stiffness(pressure), rel=exact)
    for off, exact in ((0.0, 1e-14), (1.9e-3, 2e-9), (-1.9e-3, 2e-9), (0.1, 1e-14)):
        way, slope = flow.stroke_near(p[0], s, 0.2 + off)
        assert (slope, way) == pytest.approx(lever(physics.p, 0.2 + off), rel=exact)


def test_oil_that_is_changed_under_way_acts_at_once():
    """What was expanded about a state is not kept from the oil before."""
    with_air, without = record_of(plant(more={"oil": {"air": 0.2}})), record_of(plant())
    speeds = []
    for first in (with_air, without):
        live = HydraulicPlant(first)
        live.command(0.0, 0.0)
        live.advance(1e-3)
        live.change(1e-3, with_air)
        live.command(1e-3, 1.5)
        live.advance(6e-3)
        speeds.append(live.velocity)
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-9)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"hydraulic": None}, "go together"),
        ({"plant": "reduced", "K_L": 1.0, "omega_n": 1.0, "zeta": 1.0}, "go together"),
        ({"hydraulic": {**MOTOR, "cylinder": ROD["cylinder"]}}, "a motor or a cylinder"),
        ({"hydraulic": merged(MOTOR, {"supply": {"tank": 9e6}})}, "below supply.pressure"),
        ({"hydraulic": merged(ROD, {"cylinder": {"rod": 0.05}})}, "thinner"),
        ({"hydraulic": merged(ROD, {"cylinder": {"arm": 0.2, "base": 0.1, "length": 2.0}})}, "no triangle"),
        ({"hydraulic": merged(MOTOR, {"valve": {"omega": -1.0}})}, "greater than or equal"),
        ({"hydraulic": merged(MOTOR, {"valve": {"omga": 1.0}})}, "omga"),
        ({"effects": {"square_root_flow": {"supply": 1.0}}}, "already"),
        ({"K_L": 3.0}, "follows from the parts"),
    ],
)
def test_what_does_not_fit_is_told(fields, says):
    whole = {"plant": "hydraulic", "input": "u", "output": "y", "hydraulic": MOTOR, **fields}
    with pytest.raises(ValidationError, match=says):
        PlantConfig.model_validate(whole)


def test_effects_act_in_their_own_units():
    plain = record_of(plant())[0]
    same = record_of(
        plant(
            effects={
                "coulomb_friction": {"level": 50.0},
                "valve_deadband": {"half_width": 0.1},
                "valve_lag": {"time": 0.004},
                "pressure_dependent_stiffness": {"air": 1.0},
            }
        )
    )[0]
    assert same["load_coulomb"] == pytest.approx(50.0 * 1.92e-2)
    assert same["valve_overlap"] == 0.1
    assert same["valve_omega"] == pytest.approx(2 * 0.8 / 0.004)
    assert plain["load_coulomb"] == 0.0
    airy = plant(effects={"pressure_dependent_stiffness": {"air": 1.0}})
    assert Physics(record_of(airy), 0.0).stiffness(4e6) == pytest.approx(
        0.7e9, rel=0.02
    )  # as soft as oil again


def test_a_reduced_plant_of_it_stands_for_small_movements():
    config = plant(effects={"coulomb_friction": {"level": 5.0}, "sensor_lag": {"time": 1e-3}})
    reduced = config.reduced
    assert (reduced.plant, reduced.hydraulic) == ("reduced", None)
    assert reduced.effects == {"sensor_lag": {"time": 1e-3}}
    assert reduced.omega_n == pytest.approx(small_signal(record_of(config)).omega_n)


def test_the_page_lists_every_part():
    page = (Path(__file__).parents[2] / "docs" / "hydraulics.md").read_text()
    for part in PARTS:
        assert f"| {part.name} | {part.unit} | " in page, part.slot
        assert part.source in page


def test_a_load_that_drifts_is_refused_and_none_is_taken():
    """Its load stays as it is: a rig file of Eq. 1 may say how fast it grows, this one only by how much."""
    still = {"load_bias": {"acceleration": 2.0, "drift": 0.0}}
    assert record_of(plant(effects=still))["load_force"][0] == pytest.approx(2.0 * 1.92e-2)
    with pytest.raises(ValueError, match=r"takes no load_bias\.drift"):
        record_of(plant(effects={"load_bias": {"drift": 1.0}}))
