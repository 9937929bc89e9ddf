"""The diagnosis finds what records hide; it sees their files alone. `bench/blind.py` is the large set."""

from dataclasses import replace

import pytest
from hidden_cases import draw
from hidden_records import make_record, write
from hidden_score import outcome, parameters, wilson

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose

pytestmark = [pytest.mark.blind, pytest.mark.timeout(1200)]  # a busy machine; a quiet one needs some seconds

SINGLE = [
    ("transport_delay", "steps", False),
    ("valve_lag", "multisine", True),
    ("valve_deadband", "operation", False),
    ("valve_hysteresis", "multisine", False),
    ("static_valve_map", "multisine", False),
    ("valve_saturation", "steps", True),
    ("asymmetric_gain", "operation", True),
    ("square_root_flow", "multisine", False),
    ("coulomb_friction", "steps", False),
    ("stribeck_friction", "steps", True),
    ("load_spring", "operation", False),
    ("load_bias", "steps", False),
    ("backlash", "operation", False),
    ("sensor_lag", "steps", False),
    ("sensor_quantization", "multisine", False),
    ("periodic_disturbance", "two-phase", False),
    ("position_ripple", "multisine", False),
    ("sensor_nonlinearity", "operation", False),
    ("parameter_drift", "steps", False),
    ("pressure_dependent_stiffness", "multisine", True),
    ("load_resonance", "multisine", False),
    ("outliers", "operation", False),
    ("missing_samples", "steps", True),
    ("timing_jitter", "relay", True),
    ("lugre_friction", "steps", False),
    ("lugre_friction", "two-phase", True),
    ("backlash", "relay", True),
    ("spool_inertia", "multisine", False),
    ("spool_inertia", "steps", True),
    ("valve_rate_limit", "multisine", False),
    ("valve_rate_limit", "relay", True),
]
PAIRS = [
    (("coulomb_friction", "transport_delay"), "steps", False),
    (("periodic_disturbance", "position_ripple"), "multisine", False),
    (("backlash", "sensor_quantization"), "multisine", False),
]
UNLISTED = [("volume", "steps", False), ("relief", "multisine", False)]
SECONDS = 6.0
LONG_S = 12.0
"""Of records that need so many to show what they hide, and that it is on no list."""
LONG = {"sensor_nonlinearity", "volume"}
SHORT_S = 3.0
"""Of multisines that hide the cause in the same plant, 6 to 14 times the noise too: told as well."""
SHORT = {
    "valve_lag",
    "valve_hysteresis",
    "static_valve_map",
    "square_root_flow",
    "sensor_quantization",
    "position_ripple",
    "pressure_dependent_stiffness",
    "spool_inertia",
}


def seconds_of(cause, excitation):
    if excitation == "multisine" and cause in SHORT:
        return SHORT_S
    return LONG_S if cause in LONG else SECONDS


def told_of(case, folder, effort="normal"):
    path = folder / "run.csv"
    write(make_record(case), path)
    output = "velocity" if case.rig.sees_speed else "position"
    return diagnose([read(path)], (), Options(output, effort=effort)).as_json()


@pytest.mark.parametrize(
    ("cause", "excitation", "sees_speed"), SINGLE, ids=[f"{one[0]}-{one[1]}" for one in SINGLE]
)
def test_a_hidden_cause_is_named(tmp_path, cause, excitation, sees_speed):
    case = draw(3, "one", (cause,), excitation, sees_speed, duration=seconds_of(cause, excitation))
    told = told_of(case, tmp_path)
    assert outcome(case.kind, case.causes, told) != "wrong", (case, told)


@pytest.mark.parametrize(("causes", "excitation", "sees_speed"), PAIRS, ids=["+".join(p[0]) for p in PAIRS])
def test_two_hidden_causes_are_named(tmp_path, causes, excitation, sees_speed):
    case = draw(4, "two", causes, excitation, sees_speed, duration=SECONDS)
    told = told_of(case, tmp_path)
    assert outcome(case.kind, case.causes, told) != "wrong", (case, told)


@pytest.mark.parametrize(
    ("number", "causes", "excitation"),
    [
        (7000, ("coulomb_friction", "valve_deadband"), "multisine"),
        (7001, ("coulomb_friction", "transport_delay"), "steps"),
    ],
)
def test_a_recording_of_four_minutes_names_what_one_of_twelve_seconds_does(
    number, causes, excitation, tmp_path
):
    """Its position drifts, which is no movement of the plant. `bench/long_recordings.py` is the large set."""
    case = draw(number, "two", causes, excitation, False, duration=12.0)
    told = told_of(replace(case, tick=0.001, duration=240.0), tmp_path)
    assert outcome("two", causes, told) == "exact"


@pytest.mark.parametrize("excitation", ["relay", "multisine", "operation"])
def test_nothing_is_found_where_nothing_is_hidden(tmp_path, excitation):
    case = draw(5, "clean", (), excitation, duration=SECONDS)
    told = told_of(case, tmp_path)
    assert (told["verdict"], told["effects"]) == ("clean", [])


@pytest.mark.parametrize(("cause", "excitation", "sees_speed"), UNLISTED, ids=[each[0] for each in UNLISTED])
def test_what_is_on_no_list_is_not_given_the_nearest_name(tmp_path, cause, excitation, sees_speed):
    seconds = LONG_S if cause in LONG else SECONDS
    case = draw(6, "unlisted", (cause,), excitation, sees_speed, duration=seconds)
    told = told_of(case, tmp_path, effort="quick")
    assert told["verdict"] == "unexplained", (case, told)
    assert told["unexplained"]["fraction"] > 0.0


@pytest.mark.parametrize("excitation", ["multisine", "relay"])
def test_what_comes_from_outside_is_told_not_to_repeat(tmp_path, excitation):
    case = draw(6, "unlisted", ("gusts",), excitation, duration=SECONDS)
    told = told_of(case, tmp_path, effort="quick")
    assert outcome(case.kind, case.causes, told) == "exact", (case, told)
    assert told["account"]["not_repeatable"] > 0.5
    assert told["account"]["systematic"] == 0.0


@pytest.mark.parametrize(
    ("number", "excitation"),
    [(99736, "steps"), (101066, "relay"), (101385, "two-phase")],
)
def test_gusts_that_remember_for_longer_than_a_period_are_gusts(tmp_path, number, excitation):
    """A loop answers to them. Without one they move the numbers of a plant fitted to its simulation."""
    case = draw(number, duration=12.0)
    assert (case.causes, case.excitation) == (("gusts",), excitation)
    told = told_of(case, tmp_path, effort="quick")
    assert (told["verdict"], told["effects"]) == ("clean", []), told
    assert told["extended"]["K_L"] == pytest.approx(case.rig.K_L, rel=0.08)


def test_a_line_is_no_noise_that_remembers(tmp_path):
    """A long memory foretells a wave."""
    case = draw(99721, duration=12.0)
    assert case.causes == ("periodic_disturbance",)
    assert outcome(case.kind, case.causes, told_of(case, tmp_path)) == "exact"


def test_a_line_that_makes_most_of_what_is_left_does_not_hide_in_its_past(tmp_path):
    """An autoregression of all that a relay leaves foretells the line, of whatever length."""
    case = draw(100470, duration=12.0)
    assert (case.causes, case.excitation) == (("periodic_disturbance",), "relay")
    assert outcome(case.kind, case.causes, told_of(case, tmp_path, effort="quick")) == "exact"


def test_a_drift_of_one_number_alone_does_not_hide_in_the_past_of_a_multisine(tmp_path):
    """An autoregression foretells a multisine that changes slowly: each of three numbers is asked alone."""
    case = draw(100847, duration=12.0)
    assert (case.causes, case.excitation) == (("parameter_drift",), "multisine")
    assert outcome(case.kind, case.causes, told_of(case, tmp_path, effort="quick")) == "exact"


def test_what_repeats_with_a_relay_is_no_noise_that_remembers(tmp_path):
    """Its harmonics are foretold by what was before."""
    case = draw(99788, duration=12.0)
    assert (case.causes, case.excitation) == (("sensor_nonlinearity",), "relay")
    assert outcome(case.kind, case.causes, told_of(case, tmp_path)) == "exact"


def effect(name, *others, value=1.0, ci95=(0.5, 1.5), of="level"):
    numbers = {of: {"value": value, "unit": "", "ci95": list(ci95)}}
    return {"name": name, "parameters": numbers, "indistinguishable_from": list(others)}


@pytest.mark.parametrize(
    ("kind", "causes", "verdict", "effects", "expected"),
    [
        ("clean", (), "clean", [], "exact"),
        ("clean", (), "effects", [effect("backlash")], "wrong"),
        ("one", ("backlash",), "effects", [effect("backlash")], "exact"),
        ("one", ("backlash",), "unexplained", [effect("backlash")], "wrong"),
        ("one", ("backlash",), "effects", [effect("valve_lag", "backlash")], "within"),
        ("one", ("backlash",), "effects", [effect("valve_lag")], "wrong"),
        ("one", ("backlash",), "effects", [effect("backlash"), effect("valve_lag")], "wrong"),
        ("one", ("spool_inertia",), "effects", [effect("valve_lag")], "exact"),
        ("one", ("lugre_friction",), "effects", [effect("coulomb_friction")], "exact"),
        ("one", ("lugre_friction",), "unexplained", [effect("coulomb_friction")], "exact"),
        ("two", ("a", "b"), "effects", [effect("c", "a", "b"), effect("d", "a")], "wrong"),
        ("two", ("a", "b"), "effects", [effect("b"), effect("d", "a")], "within"),
        ("two", ("a", "b"), "effects", [effect("a")], "wrong"),
        ("unlisted", ("drag",), "unexplained", [effect("a")], "exact"),
        ("unlisted", ("drag",), "effects", [effect("a")], "wrong"),
        ("unlisted", ("gusts",), "clean", [], "exact"),
        ("unlisted", ("gusts",), "effects", [effect("a")], "wrong"),
    ],
)
def test_answers_are_scored(kind, causes, verdict, effects, expected):
    assert outcome(kind, causes, {"verdict": verdict, "effects": effects}) == expected


def test_a_phase_counts_modulo_a_turn():
    told = {"effects": [effect("position_ripple", value=-3.0, ci95=(-3.1, -2.9), of="phase")]}
    ((place, truth, value, low, high),) = parameters({"position_ripple": {"phase": 3.25}}, told)
    assert place == "position_ripple.phase"
    assert (truth, value) == (3.25, pytest.approx(3.283, abs=1e-3))
    assert low < 3.25 < high


def test_wilsons_interval_holds_what_is_known():
    assert wilson(50, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)
    assert wilson(100, 100)[0] == pytest.approx(0.963, abs=1e-3)
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(16811, id="the valve reaches its end in one window alone"),
        pytest.param(18324, id="a play of a hundredth of the swing"),
        pytest.param(18359, id="outliers in windows that were fitted are not what a model lacks"),
        pytest.param(18970, id="a ripple of less than three steps of a coarse sensor"),
        pytest.param(16847, id="a limited rate is told from two lags by how the limit cycle grows"),
    ],
)
def test_what_hardly_shows_is_told(tmp_path, number):
    case = draw(number, duration=SECONDS)
    told = told_of(case, tmp_path)
    assert outcome(case.kind, case.causes, told) == "exact", (case, told)


def test_what_is_larger_as_the_load_moves_is_no_noise(tmp_path):
    """Oil of another stiffness where the load is: no two moves are alike, so that it passes for gusts."""
    case = draw(101834, duration=SECONDS)
    assert (case.causes, case.excitation) == (("volume",), "operation")
    told = told_of(case, tmp_path)
    assert (told["verdict"], told["account"]["shown_by"]) == ("unexplained", "movement")
