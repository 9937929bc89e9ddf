"""A valve's gain by level and direction: named with its map, from closed forms; simpler causes stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from seod.data import Recording
from seod.diagnose.causes.valve_map import STATIC_VALVE_MAP
from seod.diagnose.pipeline import Options, diagnose
from sim.parameters import parameters
from sim.physics import mapped
from sim.valve_map import ValveMap

K_L, OMEGA_N, ZETA = 3.0, 30.0, 0.4
TICK, N, NOISE, LARGEST = 2e-3, 5000, 0.03, 2.0
T = np.arange(N) * TICK
AT, WORTH = (
    np.array([-2.0, -1.3, -0.5, 0.0, 0.6, 1.2, 2.0]),
    np.array([-1.7, -1.25, -0.6, 0.0, 0.4, 1.0, 2.2]),
)


def told_of(valve, seed=3, effort="normal"):
    random = np.random.default_rng(seed)
    u = np.repeat(random.uniform(-LARGEST, LARGEST, N // 25), 25)
    u[:25] = LARGEST
    eq_1 = ([K_L * OMEGA_N**2], [1.0, 2.0 * ZETA * OMEGA_N, OMEGA_N**2])
    y = lsim(eq_1, valve(u), T, interp=False)[1] + random.normal(0.0, NOISE, N)
    one = Recording((Path("valve.csv"),), T, u, y, None, None, None, np.arange(N), {}, {}, ())
    return diagnose([one], (), Options("velocity", effort=effort)).as_json()


def map_of(told):
    """The found map as the plant's own."""
    (effect,) = told["effects"]
    return ValveMap({f"static_valve_map_{name}": of["value"] for name, of in effect["parameters"].items()})


@pytest.mark.slow
def test_a_gain_by_level_and_direction_is_named_with_its_map():
    told = told_of(lambda u: np.interp(u, AT, WORTH), effort="quick")
    assert (told["verdict"], [one["name"] for one in told["effects"]]) == ("effects", ["static_valve_map"])
    found, volts = map_of(told), np.linspace(-LARGEST, LARGEST, 81)
    flow = told["extended"]["K_L"] * np.array([found.worth(x) for x in volts])
    true = K_L * np.interp(volts, AT, WORTH)
    straight = np.polyval(np.polyfit(volts, true, 1), volts)
    assert np.max(np.abs(flow - true)) < 0.2 * np.max(np.abs(straight - true))


def played(u, half_width):
    """What a play lets through: it moves only when pushed."""
    out, at = np.empty(len(u)), 0.0
    for k, volts in enumerate(u):
        at = out[k] = min(max(at, volts - half_width), volts + half_width)
    return out


def widening(u):
    """Ports that open the wider the further they are open, as a parabola to either side."""
    return u * (0.3 + 0.35 * np.abs(u))


@pytest.mark.slow
@pytest.mark.parametrize("at_ports", [True, False])
def test_beside_a_hysteresis_it_is_told_whether_ports_or_commands_have_the_map(at_ports):
    valve = (lambda u: widening(played(u, 0.3))) if at_ports else (lambda u: played(widening(u), 0.3))
    told = told_of(valve, effort="quick")
    effects = {one["name"]: one["parameters"] for one in told["effects"]}
    assert (told["verdict"], set(effects)) == ("effects", {"static_valve_map", "valve_hysteresis"}), told
    assert ("at_ports" in effects["static_valve_map"]) == at_ports
    low, high = effects["valve_hysteresis"]["half_width"]["ci95"]
    assert low < 0.3 < high
    assert told["account"]["systematic"] == 0.0


AT_THIRDS = {"knot_1": 1.0 / 3.0, "knot_2": 2.0 / 3.0, "rounding": 0.0}
PARTS = ("bend_1", "bend_2", "tilt_1", "tilt_2", "tilt_3")
SIMPLER = {
    "valve_deadband": lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.15, 0.0),
    "asymmetric_gain": lambda u: np.where(u > 0.0, 1.1 * u, 0.9 * u),
    "valve_saturation": lambda u: np.clip(u, -1.5, 1.5),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SIMPLER)
def test_where_a_simpler_one_explains_as_much_it_is_named(name):
    told = told_of(SIMPLER[name])
    assert (told["verdict"], [one["name"] for one in told["effects"]]) == ("effects", [name])


def test_a_searched_map_does_not_fall():
    parts = {"bend_1": 0.9, "bend_2": 0.0, "tilt_1": 0.2, "tilt_2": 0.0, "tilt_3": -0.3} | AT_THIRDS
    effects = {"static_valve_map": dict(parts)}
    sizes = type("Sizes", (), {"volts": LARGEST})()
    STATIC_VALVE_MAP.within(effects, sizes)
    values = {f"static_valve_map_{name}": value for name, value in effects["static_valve_map"].items()}
    worth = [ValveMap(values).worth(x) for x in LARGEST * np.arange(-3, 4) / 3.0]
    assert np.min(np.diff(worth)) >= -1e-12
    assert worth[-1] == pytest.approx(1.7)
    assert worth[-2] == pytest.approx(LARGEST * 2.0 / 3.0)


SIZES_OF_PLAIN = {
    "valve_deadband": {"valve_deadband.half_width": 0.15},
    "asymmetric_gain": {"asymmetric_gain.ratio": 0.1},
    "valve_saturation": {"valve_saturation.limit": 1.5},
}


@pytest.mark.parametrize("name", SIMPLER)
def test_a_map_that_grew_from_a_simpler_cause_does_what_that_does(name):
    plain, sizes = SIZES_OF_PLAIN[name], type("Sizes", (), {"volts": LARGEST})()
    (form,) = [each for each in STATIC_VALVE_MAP.plain if each.name == name]
    grown = form.grows({"K_L": K_L} | plain, sizes)
    back = form.becomes(grown, sizes)
    assert back == pytest.approx({place: ({"K_L": K_L} | plain)[place] for place in back})
    values = {of.replace(".", "_"): value for of, value in grown.items()}
    one = ValveMap(values | {"static_valve_map_range": LARGEST, "static_valve_map_rounding": 0.0})
    for volts in LARGEST * np.linspace(-1.0, 1.0, 41):
        assert grown["K_L"] * one.worth(volts) == pytest.approx(K_L * SIMPLER[name](volts), abs=1e-9)


@pytest.mark.parametrize("second", [0.3, 0.2, 0.99])
def test_plain_forms_of_a_map_whose_corners_meet_or_have_crossed_are_numbers(second):
    """As simulated: corners in order, and apart."""
    corners = {"knot_1": 0.3 if second < 0.9 else 0.98, "knot_2": second}
    values = {f"static_valve_map.{of}": v for of, v in (dict.fromkeys(PARTS, 0.0) | corners).items()}
    for form in STATIC_VALVE_MAP.plain:
        back = form.becomes(values | {"K_L": K_L}, type("Sizes", (), {"volts": LARGEST})())
        assert back.get("K_L", K_L) == pytest.approx(K_L)
        assert back.get("valve_deadband.half_width", 0.0) == pytest.approx(0.0, abs=1e-9)


def test_a_map_of_one_sign_is_a_null_elsewhere():
    (form,) = [each for each in STATIC_VALVE_MAP.plain if each.name == "null_shift"]
    parts = dict.fromkeys(PARTS, 0.0) | {"tilt_1": -0.2, "tilt_2": -0.2, "tilt_3": -0.2} | AT_THIRDS
    values = {f"static_valve_map.{of}": value for of, value in parts.items()}
    shifted = form.becomes(values, type("Sizes", (), {"volts": LARGEST})())
    assert shifted == pytest.approx({"null_shift.voltage": 0.2})
    record = parameters(1.0, 50.0, 0.5, {"null_shift": {"voltage": 0.2}})
    one = ValveMap({f"static_valve_map_{of}": value for of, value in (parts | {"range": LARGEST}).items()})
    for volts in (-1.5, -0.9, 0.9, 1.5):
        assert one.worth(volts) == pytest.approx(volts - record["null_shift_voltage"][0])


def test_the_map_in_plain_numbers_is_the_kernels():
    random = np.random.default_rng(2)
    for _ in range(20):
        parts = dict(zip(PARTS, random.uniform(-0.2, 0.2, len(PARTS)), strict=True)) | {"range": 1.3}
        parts |= {
            "knot_1": random.uniform(0.05, 0.5),
            "knot_2": random.uniform(0.55, 0.9),
            "rounding": random.uniform(),
        }
        record = parameters(1.0, 50.0, 0.5, {"static_valve_map": parts})[0]
        plain = ValveMap({f"static_valve_map_{name}": value for name, value in parts.items()})
        for volts in (-2.0, -1.2, -0.7, -0.1, 0.0, 0.2, 0.5, 1.0, 1.4):
            assert plain.worth(volts) == pytest.approx(mapped(record, volts), abs=1e-12)


@pytest.mark.parametrize("worth", [-2.5, -1.1, 0.3, 2.6])
def test_the_command_of_a_map_is_its_inverse(worth):
    parts = {"bend_1": 0.1, "bend_2": 0.1, "tilt_1": 0.1, "tilt_2": -0.1, "tilt_3": 0.2, "range": 2.0}
    parts |= AT_THIRDS | {"rounding": 0.3}
    one = ValveMap({f"static_valve_map_{name}": value for name, value in parts.items()})
    assert one.worth(one.command(worth)) == pytest.approx(worth)


def test_a_map_whose_corners_meet_becomes_the_deadband_that_it_is_like():
    """From 0.3 V on a gain of 1: corners at and beyond twice that, which leave it rounded."""
    (form,) = [each for each in STATIC_VALVE_MAP.plain if each.name == "valve_deadband"]
    corners = {"knot_1": 0.6 / LARGEST, "knot_2": 0.6 / LARGEST, "bend_1": -0.3, "bend_2": -0.29}
    values = {f"static_valve_map.{of}": v for of, v in (dict.fromkeys(PARTS, 0.0) | corners).items()}
    back = form.becomes(values | {"K_L": K_L}, type("Sizes", (), {"volts": LARGEST})())
    assert back["valve_deadband.half_width"] == pytest.approx(0.23, abs=0.08)
    assert back["K_L"] == pytest.approx(K_L * LARGEST / (LARGEST - 0.3), rel=0.1)
