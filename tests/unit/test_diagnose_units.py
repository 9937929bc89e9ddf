"""The same record in other units is the same record: causes, and numbers after conversion."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim
from units_truth import RATE, record

from seod.cli import app
from seod.data import Recording
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.result import DiagnoseError
from seod.diagnose.search.budget import EFFORTS
from tests.command_line import CliRunner

CASES = {
    "clean": {},
    "coulomb_friction": {"friction": 0.4},
    "backlash": {"gap": 1e-3},
    "load_spring": {"stiffness": 60.0},
}
SECONDS = 5.0
TOLERANCE = 1e-6
LEAST_SHARE = 1e-8
"""Of shares, which add up to 1: of one that is nearly none no six digits can be told."""
LEAST_DELAY = 1e-8 / RATE
"""[s] Of delays likewise: one of a few millionths of a row is none."""
SPENT = "the search ended before"
"""Rounding may take a fit one step more, and so much work is left that it is told or not."""
OF_Y = {"K_L", "rms_from_measured", "rms_from_fitted"}
"""Numbers in the unit of y, beside those of effects that say so."""


@pytest.fixture(autouse=True)
def little(monkeypatch):
    """Less than a quick search: the units are asked for, not the causes."""
    monkeypatch.setitem(EFFORTS, "quick", 0.05)


def told(u, y, per_metre, output="position", pace=1.0):
    """The answer for y in a unit of which so many are a metre, or a metre a second; at a pace the faster."""
    rows = np.arange(len(u))
    none = {"t_u": None, "ps": None, "temperature": None, "names": {}, "units": {}, "problems": ()}
    recording = Recording((Path("run.csv"),), rows / RATE / pace, u, per_metre * y, rows=rows, **none)
    answer = diagnose([recording], (), Options(output, effort="quick")).as_json()
    return answer | {"remarks": [each for each in answer["remarks"] if not each.startswith(SPENT)]}


def numbers(answer, per_metre):
    """By place, numbers in m; sentences without theirs."""
    out = {}
    for place, value, unit in leaves(answer):
        power = {"unit": 1, "rad/unit": -1}.get(re.sub(r"(?<=unit).*", "", unit), 0)
        if place.split(".")[-1] in OF_Y:
            power = 1
        number = isinstance(value, float) and not isinstance(value, bool)
        out[place] = value / per_metre**power if number else re.sub(r"-?\d[\d.e+-]*", "#", str(value))
    return out


def leaves(answer, place="", unit=""):
    if isinstance(answer, dict):
        for name, value in answer.items():
            yield from leaves(value, f"{place}.{name}", str(answer.get("unit", "")))
    elif isinstance(answer, list):
        for k, value in enumerate(answer):
            yield from leaves(value, f"{place}[{k}]", unit)
    else:
        yield place, answer, unit


def apart(a, b):
    """Places at which two answers differ, and by how much."""
    assert a.keys() == b.keys()
    return {
        place: (a[place], b[place])
        for place in a
        if not (a[place] == b[place] or (isinstance(a[place], float) and close(a[place], b[place], place)))
    }


def close(a, b, place):
    if place.endswith(".p_value"):  # of 1e-12 it changes by 27 times as much as its logarithm
        a, b = (math.log(max(each, 1e-300)) for each in (a, b))
    if ".on_load." in place:  # spectra much alike take each other's place for next to nothing
        return math.isclose(a, b, abs_tol=1e-4)
    least = LEAST_SHARE if place.startswith(".account") else LEAST_DELAY if place.endswith(".delay") else 0.0
    return math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=least)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("clean", [1e3]),
        ("coulomb_friction", [1e-3]),
        ("backlash", [1e6]),
        ("load_spring", [1e3]),
    ],
)
def test_a_position_in_another_unit(name, units):
    rows = record(SECONDS, **CASES[name])
    in_metres = numbers(told(*rows, 1.0), 1.0)
    named = [in_metres[each] for each in in_metres if re.fullmatch(r"\.effects\[\d\]\.name", each)]
    assert named == ([] if name == "clean" else [name])
    for per_metre in units:
        assert not apart(in_metres, numbers(told(*rows, per_metre), per_metre))


@pytest.mark.slow
def test_a_speed_in_another_unit():
    u, y = record(3.0, friction=0.4, speeds=True)
    in_metres = numbers(told(u, y, 1.0, "velocity"), 1.0)
    assert in_metres[".effects[0].name"] == "coulomb_friction"
    assert in_metres[".effects[0].parameters.level.value"] == pytest.approx(0.4, rel=0.05)
    assert not apart(in_metres, numbers(told(u, y, 1e6, "velocity"), 1e6))


@pytest.mark.slow
def test_a_rig_that_does_all_of_it_slowly():
    rows = record(SECONDS, **CASES["backlash"])
    once, slowly = (told(*rows, 1.0, pace=pace) for pace in (1.0, 0.01))
    assert [each["name"] for each in once["effects"]] == ["backlash"]
    assert [each["name"] for each in slowly["effects"]] == ["backlash"]
    assert slowly["extended"]["omega_n"] == pytest.approx(0.01 * once["extended"]["omega_n"], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("per_volt", [10.0, 3276.8], ids=["percent", "counts"])
def test_commands_in_another_unit(per_volt):
    """A deadband of 0.3 V is 983 counts of a converter, and was 10 at most."""
    u, y = record(SECONDS, through=lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.3, 0.0))
    (effect,) = told(per_volt * u, y, 1.0)["effects"]
    assert effect["name"] == "valve_deadband"
    assert effect["parameters"]["half_width"]["value"] == pytest.approx(0.3 * per_volt, rel=0.02)


@pytest.mark.slow
def test_a_deadband_about_half_of_the_command(monkeypatch):
    """Of a valve that is closed at 50 %: about 0 no command ever comes, so that a friction was named."""
    monkeypatch.setitem(EFFORTS, "quick", 0.25)
    u, y = record(SECONDS, through=lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.4, 0.0))
    answer = told(50.0 + 10.0 * u, y, 1.0)
    found = {each["name"]: each["parameters"] for each in answer["effects"]}
    assert set(found) == {"load_bias", "valve_deadband"}
    assert found["valve_deadband"]["half_width"]["value"] == pytest.approx(4.0, rel=0.03)
    assert found["load_bias"]["voltage"]["value"] == pytest.approx(50.0, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(("lag", "delay"), [(0.5, 0.0), (0.0, 0.8)], ids=["lag", "delay"])
def test_a_slow_plant_that_is_recorded_quickly(lag, delay):
    """At 2 rad/s and 100 Hz no delay longer than 50 rows was looked for, and two lags stood for the rest."""
    rate, n = 100.0, 6000
    u = np.repeat(np.random.default_rng(7).uniform(-2.0, 2.0, n // 150), 150)
    late = np.r_[np.zeros(round(delay * rate)), u][:n]
    below = np.polymul([1.0, 2.0 * 0.3 * 2.0, 4.0], [lag, 1.0] if lag else [1.0])
    y = lsim(([4.0], below), late, np.arange(n) / rate, interp=False)[1]
    y += np.random.default_rng(8).normal(0.0, 0.006 * np.std(y), n)
    answer = told(u, y, 1.0, "velocity", pace=rate / RATE)
    (effect,) = answer["effects"]
    assert effect["name"] in ({"transport_delay"} if delay else {"sensor_lag", "valve_lag"})
    assert effect["parameters"]["time"]["value"] == pytest.approx(lag or delay, rel=0.02)
    assert [answer["extended"][of] for of in ("omega_n", "zeta")] == pytest.approx([2.0, 0.3], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coulomb_friction", "backlash"])
def test_an_actuator_wired_the_other_way_round(name):
    u, y = record(SECONDS, **CASES[name])
    forth, back = (numbers(told(sign * u, y, 1.0), 1.0) for sign in (1.0, -1.0))
    assert forth[".effects[0].name"] == name
    assert back[".baseline.K_L"] == pytest.approx(-forth[".baseline.K_L"], rel=TOLERANCE)
    assert "the fitted K_L is negative" in back.pop(".remarks[0]")
    sizes = [{at: abs(x) if isinstance(x, float) else x for at, x in one.items()} for one in (forth, back)]
    assert not apart(*sizes)


def test_a_command_in_other_units_than_the_first_is_refused():
    rows = np.arange(1000)
    none = {"t_u": None, "ps": None, "temperature": None, "names": {}, "problems": ()}
    y = np.sin(rows)
    first, second = (
        Recording((Path(name),), rows / RATE, y, y, rows=rows, units={"u": unit}, **none)
        for name, unit in (("a.csv", "V"), ("b.csv", "m"))
    )
    with pytest.raises(DiagnoseError, match=r"b\.csv: u is in m, in a\.csv in V: give --units u="):
        diagnose([first], [second])


@pytest.mark.slow
def test_files_that_tell_their_units(tmp_path):
    u, y = record(SECONDS, **CASES["backlash"])
    t = np.arange(len(u)) / RATE
    units = {"s": (1.0, "m", 1.0), "ms": (1e3, "mm", 1e3), "us": (1e6, "um", 1e6)}
    answers = []
    for time, (per_second, length, per_metre) in units.items():
        path = tmp_path / f"run-{time}.csv"
        rows = zip((per_second * t).tolist(), u.tolist(), (per_metre * y).tolist(), strict=True)
        lines = [f"t [{time}],u [V],y [{length}]", *(",".join(map(repr, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n", "utf-8")
        options = ["diagnose", str(path), "--output", "position", "--effort", "quick", "--json"]
        result = CliRunner().invoke(app, options)
        assert result.exit_code == 0, result.output
        answers.append(numbers(json.loads(result.stdout), 1.0))
    assert answers[0][".effects[0].name"] == "backlash"
    assert not apart(answers[0], answers[1])
    assert not apart(answers[0], answers[2])
