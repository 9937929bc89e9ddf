"""One record per cause: whole, in agreement with the plant, and known by name nowhere else."""

from __future__ import annotations

import ast
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from kernel_cases import EFFECTS_ON, K_L, OMEGA_N, ZETA, apart, chosen, follow, record, steps

import seod.diagnose
from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import (
    CAUSES,
    SHAKES,
    answered_as,
    commuting,
    further_causes,
    group,
    searched_causes,
    sentence,
)
from seod.diagnose.fitting.model import baseline_model, grouped
from sim.effects import EFFECTS
from sim.windows import START

ROOMS = ("search", "starts", "verdict", "fitting", "report", "show")
NAMES = re.compile(rf"(?<![a-z0-9_])({'|'.join(EFFECTS)})(?![a-z0-9_])")
SIZES = Scales(
    volts=2.0,
    speed=1.5,
    pressure=300.0,
    centre=0.2,
    travel=1.2,
    peak_to_peak=0.3,
    omega_n=60.0,
    span_s=30.0,
    tick_s=1e-3,
    pressed=True,
    force=40.0,
)
CONDITIONS = [
    SIZES,
    Scales(
        0.01, 1e-3, 0.1, 0.0, 1e-3, 1e-4, 3.0, 600.0, 0.01, step=1e-5, warmer=True, pressed=True, force=1e-3
    ),
]
SEARCHED = ("lugre_friction", "spool_inertia", "null_shift", *searched_causes(SIZES))


def strings(source: str) -> list[str]:
    """String literals, but for docstrings and the texts beside constants."""
    tree = ast.parse(source)
    told = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    return [
        each.value
        for each in ast.walk(tree)
        if isinstance(each, ast.Constant) and isinstance(each.value, str) and id(each) not in told
    ]


def rooms() -> list[Path]:
    root = Path(seod.diagnose.__path__[0])
    inside = {path for room in ROOMS for path in (root / room).rglob("*.py")}
    return sorted({*inside, root / "pipeline.py", root / "one_search.py"})


@pytest.mark.parametrize("path", rooms(), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_the_search_knows_no_cause_by_name(path):
    source = path.read_text(encoding="utf-8")
    assert [found for each in strings(source) for found in NAMES.findall(each)] == []
    imported = {
        name.name.lower()
        for each in ast.walk(ast.parse(source))
        if isinstance(each, ast.ImportFrom) and (each.module or "").startswith("seod.diagnose.causes")
        for name in each.names
    }
    assert not [name for name in imported if any(name in of or of in name for of in EFFECTS)]


def test_the_names_are_found_where_there_are_some():
    assert NAMES.findall("backlash.gap, and backlash_gap of coulomb_friction") == [
        "backlash",
        "coulomb_friction",
    ]
    assert strings('"""told"""\nx = f"{y}.backlash"\n"text beside"') == [".backlash"]


def test_every_effect_of_the_plant_has_a_record():
    assert list(CAUSES) == [name for name, each in EFFECTS.items() if each.enters != "record"]
    for name, cause in CAUSES.items():
        assert cause.name == name
        assert re.fullmatch(r"[A-Z].*\.", cause.says), name
    by_samples = {"sensor_quantization", "held_readings"}
    named = {name for name, each in EFFECTS.items() if each.cause and each.enters != "record"}
    grown = {"null_shift"}
    assert named - by_samples - grown == set(searched_causes(SIZES))


def test_answers_have_the_names_of_the_contract():
    assert {answered_as(name) for name, each in EFFECTS.items() if each.cause} == {
        "transport_delay", "valve_lag", "valve_deadband", "valve_hysteresis", "valve_saturation",
        "asymmetric_gain", "square_root_flow", "coulomb_friction", "stribeck_friction", "load_spring",
        "load_bias", "backlash", "sensor_lag", "sensor_quantization", "periodic_disturbance",
        "position_ripple", "parameter_drift", "pressure_dependent_stiffness", "load_resonance",
        "valve_rate_limit", "static_valve_map", "sensor_nonlinearity", "held_readings",
        "rectified_sensor", "measured_disturbance", "outliers", "missing_samples", "timing_jitter",
    }  # fmt: skip


@pytest.mark.parametrize(("name", "sizes"), list(product(SEARCHED, CONDITIONS)))
def test_each_is_searched_within_its_limits_from_somewhere(name, sizes):
    searched, cause = group(name, sizes), CAUSES[name]
    parts = {"cosine", "sine"} if cause.wave is not None else set()
    own = {each.name: each for each in EFFECTS[name].parameters}
    for each in searched.coordinates:
        of = each.place.removeprefix(f"{name}.")
        assert of in own or of in parts
        assert each.low < each.high
        if of in own:
            assert own[of].low <= each.low
            assert each.high <= own[of].high
    assert bool(searched.starts) == (cause.wave is None)
    for start in searched.starts:
        for each in searched.coordinates:
            assert each.low <= start[each.place] <= each.high
            assert each.value(each.searched(start[each.place])) == pytest.approx(start[each.place])


@pytest.mark.parametrize("name", SEARCHED)
def test_each_has_a_model_that_can_be_simulated(name):
    model = baseline_model(SIZES, 1.0, sees_speed=True, fixed={})
    values = {"K_L": 1.0, "omega_n": 60.0, "zeta": 0.4}
    for each in filter(None, (CAUSES[name].needs, name)):
        model = model.with_effect(each)
        begin = next(
            iter(group(each, SIZES).starts), {c.place: c.low for c in group(each, SIZES).coordinates}
        )
        values |= begin
    model.kernel_parameters(model.searched(values))
    assert [START[column] for column in model.states] == [
        each
        for each in START
        if each in {"pressure", "velocity", *CAUSES[name].states, *CAUSES[CAUSES[name].needs or name].states}
    ]
    assert list(model.without(CAUSES[name].needs or name).names) == []


@pytest.mark.parametrize("name", [name for name in SEARCHED if CAUSES[name].elsewhere])
def test_one_that_acts_elsewhere_too_is_simulated_there(name):
    place = CAUSES[name].elsewhere
    assert place.distinguished_by <= CAUSES.keys()
    model = baseline_model(SIZES, 1.0, sees_speed=True, fixed={}).with_effect(name)
    start = {"K_L": 1.0, "omega_n": 60.0, "zeta": 0.4} | group(name, SIZES).starts[0]
    x = model.searched(start)
    assert place.parameter not in model.effects(x)[name]
    moved = model.at_other_place(name)
    assert moved.effects(x)[name][place.parameter] == 1.0
    assert moved.kernel_parameters(x)[f"{name}_{place.parameter}"] == 1.0
    assert moved.at_other_place(name) == model
    assert moved.without(name).moved == frozenset()


def test_what_is_alike_is_alike_both_ways():
    for name, cause in CAUSES.items():
        for other in cause.alike:
            values = {"K_L": 0.7, "omega_n": 50.0, "zeta": 0.3}
            values |= {c.place: 0.02 for c in group(name, SIZES).coordinates}
            there = other.same(values, SIZES)
            assert set(there) == {c.place for c in group(other.name, SIZES).coordinates}
            if other.name in {each.name for plain in cause.plain for each in CAUSES[plain.name].alike}:
                continue  # it stands for its plain form: a spring, for the constant load that it has
            (back,) = [each for each in CAUSES[other.name].alike if each.name == name]
            assert back.two_commands_only == other.two_commands_only
            again = back.same(values | there, SIZES)
            assert again == pytest.approx({place: values[place] for place in again})


def test_a_null_is_asked_for_where_the_flow_bends_at_it():
    """Where it is straight a constant load is the same, and no fit can tell."""
    for name in ("load_bias", "load_spring"):
        (null,) = [each for each in CAUSES[name].alike if each.name == "null_shift"]
        assert null.distinguished_by == {"valve_deadband", "asymmetric_gain", "square_root_flow"}
    assert "null_shift" not in searched_causes(SIZES)


def test_plain_forms_are_causes_and_their_parameters():
    for name, plain in ((name, each) for name, cause in CAUSES.items() for each in cause.plain):
        simple = {c.place for c in group(plain.name, SIZES).coordinates}
        values = {"K_L": 0.7, "omega_n": 50.0, "zeta": 0.3} | dict.fromkeys(simple, 3.0)
        values |= {c.place: 0.5 * min(c.high, 4.0) for c in group(name, SIZES).coordinates}
        values |= {"static_valve_map.knot_1": 0.3}
        if plain.becomes is not None:
            assert set(plain.becomes(values, SIZES)) - {"K_L"} == simple
        if plain.grows is not None:
            own = {c.place for c in group(name, SIZES).coordinates}
            assert set(plain.grows(values, SIZES)) - {"K_L"} == own
        assert plain.becomes is not None or name in further_causes(SIZES, [plain.name])


def test_none_is_tried_beside_one_that_contains_it():
    contained = {"asymmetric_gain", "valve_deadband", "valve_saturation"}
    assert contained.isdisjoint(further_causes(SIZES, ["static_valve_map"]))
    for name in contained:
        further = further_causes(SIZES, [name])
        assert "static_valve_map" not in further
        assert contained - {name} <= set(further)
    assert "stribeck_friction" in further_causes(SIZES, ["coulomb_friction"])


def turns(name: str, of: str) -> bool:
    """Whether a plant does the same with command, gain and this parameter of the other sign."""
    t_u, u = steps(0.3)
    t, value = np.linspace(0.0, 0.3, 301), {f.name: f.null for f in EFFECTS[name].parameters} | {of: 0.4}
    value |= {"stiffness": 2e3} if (name, of) == ("load_spring", "centre") else {}
    value |= {"range": 1.0} if name == "static_valve_map" else {}
    value |= {"gain": 30.0} if name == "measured_disturbance" else {}
    value |= {"order_2": 0.4} if name == "sensor_nonlinearity" else {}
    value |= {of: 0.4}
    runs = []
    for sign in (1.0, -1.0):
        effects = {name: value | {of: sign * 0.4}}
        plant = record(effects=effects, plant=(sign * K_L, OMEGA_N, ZETA))
        surroundings = {"warmth": np.full(len(t), 5.0), "force": np.full(len(t), 50.0)}
        runs.append(follow(plant, t_u, sign * u, t, **surroundings)[0])
    return bool(apart(*runs) < 1e-6)


def test_mirrored_parameters_are_those_that_turn_with_the_command():
    """By the plant itself: it is wired the other way round, and the command and the parameter are turned."""
    for name, cause in CAUSES.items():
        for of in EFFECTS[name].parameters:
            if of.low < 0.0 and of.name != "phase":
                assert turns(name, of.name) == (of.name in cause.mirrored), f"{name}.{of.name}"


def test_a_sentence_tells_its_figure():
    effects = {"coulomb_friction": {"level": 3.0}, "lugre_friction": {"stiffness": 1500.0, "damping": 1.0}}
    assert sentence("lugre_friction", effects).startswith("The friction gives way by 0.002 ")
    curve = {f"order_{n}": 0.0 for n in range(3, 7)} | {"order_2": 0.02, "order_4": 0.01}
    effects["sensor_nonlinearity"] = curve | {"centre": 0.0, "half": 1.0}
    effects |= {"valve_lag": {"time": 4e-3}, "spool_inertia": {"omega": 400.0}}
    assert "a damping ratio of 0.8." in sentence("spool_inertia", effects)
    assert "a curve over the position, 0.03 (unit of position) off a straight line" in sentence(
        "sensor_nonlinearity", effects
    )
    parts = {"bend_1": 0.2, "bend_2": 0.0, "tilt_1": -0.1, "tilt_2": 0.1, "tilt_3": 0.0}
    parts |= {"knot_1": 1.0 / 3.0, "knot_2": 2.0 / 3.0}
    effects["static_valve_map"] = parts | {"range": 2.0}
    assert "up to 0.3 V more or less" in sentence("static_valve_map", effects)
    effects["viscous_friction"] = {"share": 0.7}
    assert "is 70 % of the damping" in sentence("viscous_friction", effects)
    assert "{" not in "".join(sentence(name, effects) for name in CAUSES)


def test_waves_are_searched_in_parts():
    made = grouped(
        {"position_ripple.cosine": 3.0, "position_ripple.sine": 4.0, "position_ripple.wavenumber": 2.0}
    )
    assert made == {
        "position_ripple": pytest.approx(
            {"wavenumber": 2.0, "amplitude": 5.0, "phase": float(np.arctan2(3.0, 4.0))}
        )
    }


BETWEEN = [name for name in EFFECTS_ON if name not in {"valve_lag", "sensor_lag", "spool_inertia"}]


@pytest.mark.parametrize("name", BETWEEN)
def test_beside_what_tells_no_lags_apart_both_read_alike(name):
    """But for how the plant begins, what shakes it, and a place that a constant load leaves behind."""
    lag = {"time": 4e-3}
    t_u = np.arange(3000) * 1e-3
    u = 0.6 * np.cos(250.0 * t_u + 1.0) + 0.4 * np.cos(410.0 * t_u)  # stays in the curve's range
    t = np.arange(1, 6000) * 5e-4
    supply = 1.0 + 0.2 * np.sin(40.0 * t)
    plants = [record(effects=chosen(name) | {of: lag}) for of in ("valve_lag", "sensor_lag")]
    valve, sensor = (follow(plant, t_u, u, t, supply=supply)[0] for plant in plants)
    difference, t = (sensor - valve)[4000:], t[4000:]
    omega = EFFECTS_ON[name]["omega"] if name == SHAKES else 0.0
    begun = np.stack([np.sin(omega * t), np.cos(omega * t), t, np.ones(len(t))], axis=1)
    left = difference - begun @ np.linalg.lstsq(begun, difference, rcond=None)[0]
    differs = float(np.max(np.abs(left)) / np.ptp(valve)) > 1e-6
    assert differs == CAUSES[name].tells_lags_apart
    assert commuting("valve_lag", [name]) == ([] if differs else ["sensor_lag"])
