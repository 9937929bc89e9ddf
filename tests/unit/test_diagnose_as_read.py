"""What people are told is in the unit in which y was read; the answer itself is in SI."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_example import K_L, LEVEL, NOISE, OMEGA_N, ZETA, command, example, simulate

import seod.diagnose.command as command_module
from seod.cli import app
from seod.data import read
from seod.diagnose.report.as_read import as_read, scaled
from seod.diagnose.report.text import as_text
from seod.diagnose.report.units import OF_READINGS, Units
from seod.diagnose.result import Common, FreeRun
from seod.diagnose.show.acting import acting
from seod.diagnose.show.residual import residual
from seod.diagnose.verdict.remarks import DRIFTS, OTHER_SIZE
from sim.effects import power_of_y
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state
from tests.command_line import CliRunner

ACTING = (
    {"coulomb_friction": {"level": 250.0}, "lugre_friction": {"stiffness": 1e5, "damping": 150.0}},
    {"stribeck_friction": {"level": 100.0, "speed": 0.5}, "coulomb_friction": {"level": 100.0}},
    {"backlash": {"gap": 0.01}, "load_bias": {"acceleration": 40.0, "drift": 9.0}},
    {"position_ripple": {"amplitude": 0.01, "wavenumber": 60.0, "phase": 0.3}},
    {"square_root_flow": {"supply": 2000.0}, "sensor_quantization": {"step": 0.003}},
    {"load_spring": {"stiffness": 300.0, "centre": 0.05}, "valve_rate_limit": {"rate": 20.0}},
    {"sensor_nonlinearity": {"order_2": 0.02, "centre": 0.1, "half": 0.5}},
)
NONE = np.empty(0)


@pytest.fixture(scope="module")
def found():
    return example()


def readings(u, gain, effects):
    """Of the kernel."""
    p = parameters(gain, OMEGA_N, ZETA, effects)
    t, y = np.arange(len(u)) / 1000.0, np.empty(len(u))
    s = new_state(p, 0.0, 0.0)
    follow(p[0], s[0], t, u, t, NONE, NONE, NONE, NONE, y)
    return y


@pytest.mark.parametrize("effects", ACTING, ids=lambda each: next(iter(each)))
def test_the_model_in_another_unit_moves_as_it_did(found, effects):
    """By the kernel, which knows of no unit."""
    in_mm = scaled(replace(found, extended=replace(found.extended, effects=effects)), 1e3).extended
    u = command(1500)
    there, here = readings(u, in_mm.K_L, in_mm.effects), readings(u, K_L, effects)
    np.testing.assert_allclose(there, 1e3 * here, rtol=1e-6, atol=1e-6 * np.ptp(there))
    assert np.ptp(readings(u, K_L, {}) - here) > 1e-3 * np.ptp(here)


def test_what_acts_on_the_load_is_drawn_in_that_unit(found):
    window, in_mm = found.windows[0], scaled(found, 1e3)
    there = in_mm.windows[0]
    np.testing.assert_allclose(acting(in_mm, there), 1e3 * acting(found, window), rtol=1e-9)
    here = residual(window, window.y_baseline, found.baseline, "position")
    left = residual(there, there.y_baseline, in_mm.baseline, "position")
    np.testing.assert_allclose(left.force, 1e3 * here.force, rtol=1e-9)
    np.testing.assert_allclose(left.volts, here.volts, rtol=1e-9)
    for name in ("y", "y_baseline", "y_extended", "velocity", "position", "pressure"):
        np.testing.assert_array_equal(getattr(there, name), 1e3 * getattr(window, name))
    for name in ("y", "y_baseline", "y_extended"):
        np.testing.assert_array_equal(getattr(in_mm.whole[0], name), 1e3 * getattr(found.whole[0], name))
    assert in_mm.noise_sd == (1e3 * NOISE,)


def test_all_numbers_of_tables_are_in_that_unit(found):
    common, run = Common(17.0, 60.0, 0.4, 0.1, 2e-3, 0.2), FreeRun(2e-3, 1e-3)
    (effect,) = found.effects
    baseline = replace(found.baseline, common=common, free_runs=(run,), sd={"K_L": 0.2, "zeta": 0.01})
    more = replace(found, baseline=baseline, effects=(replace(effect, holdout=(effect.parameters,)),))
    in_mm = scaled(more, 1e3)
    assert in_mm.baseline.common == replace(common, K_L=17e3)
    assert in_mm.baseline.free_runs == (FreeRun(2.0, 1.0),)
    assert in_mm.baseline.sd == {"K_L": 200.0, "zeta": 0.01}
    level = in_mm.effects[0].parameters["level"]
    assert (level.value, level.ci95) == (1e3 * LEVEL, (245e3, 255e3))
    assert in_mm.effects[0].holdout == ({"level": level},)
    assert (in_mm.baseline.omega_n, in_mm.baseline.zeta) == (OMEGA_N, 1.5 * ZETA)
    assert in_mm.effects[0].gain == effect.gain


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("unit", 1),
        ("unit/s^3", 1),
        ("unit (unit/s for a speed)", 1),
        ("rad/unit", -1),
        ("rad/s", 0),
        ("V", 0),
    ],
)
def test_the_power_of_a_length_in_a_unit(unit, expected):
    assert power_of_y(unit) == expected
    assert power_of_y(OF_READINGS) == 1


@pytest.mark.parametrize(
    ("remark", "told"),
    [
        (DRIFTS.format(rate="0.2", without="9", with_it="3"), "grows by 200 mm/s^3 from"),
        (DRIFTS.format(rate="-2e-05", without="9", with_it="3"), "grows by -0.02 mm/s^3 from"),
        (
            OTHER_SIZE.format(k=1, place="backlash.gap", there="0.0021 ± 2e-4 unit", here="1e-3 ± 1e-5 unit"),
            "backlash.gap fitted to it is 2.10 ± 0.20 mm, and was 1.000 ± 0.010 mm:",
        ),
        (
            OTHER_SIZE.format(k=1, place="r.k", there="4000.0 ± 10.0 rad/unit", here="5 ± 1 rad/unit"),
            "it is 4.000 ± 0.010 rad/mm, and was 0.0050 ± 0.0010 rad/mm:",
        ),
        (
            OTHER_SIZE.format(k=1, place="q.s", there="2 ± 1 unit (unit/s for a speed)", here="0.5 V"),
            "it is 2000 ± 1000 mm, and was 0.5 V:",
        ),
        ("a.csv: y stands at -0.3 and 0.4 (unit of y) in 9 rows", "stands at -300 and 400 mm in 9 rows"),
        ("thousandths for the unit itself, 3 units", "thousandths for the unit itself, 3 units"),
    ],
)
def test_sentences_tell_their_numbers_in_that_unit(found, remark, told):
    in_mm = scaled(replace(found, remarks=(remark,)), 1e3)
    assert told in Units.of("mm", "position").told(in_mm.remarks[0])


def test_without_a_known_unit_nothing_is_changed(found, tmp_path):
    for header, unit in (("y", "unit"), ("y [counts]", "counts"), ("y [degC]", "K"), ("y [m]", "m")):
        path = tmp_path / "run.csv"
        path.write_text(f"t,u,{header}\n0,0,1\n1,0,2\n")
        assert as_read(found, read(path), unit) == (found, unit)


@pytest.mark.parametrize(("spelled", "unit", "factor"), [("mm", "mm", 1e3), ("°", "deg", math.degrees(1.0))])
def test_the_unit_is_the_one_that_was_read(found, tmp_path, spelled, unit, factor):
    path, other = tmp_path / "run.csv", tmp_path / "more.csv"
    path.write_text(f"t,u,y [{spelled}]\n0,0,1\n1,0,2\n", "utf-8")
    other.write_text(f"t,u,y [{spelled}]\n2,0,1\n3,0,2\n", "utf-8")
    for recording in (read(path), read([path, other])):
        assert recording.read_in["y"] == unit
        told, own = as_read(found, recording, recording.units["y"])
        assert own == unit
        assert pytest.approx(factor * K_L, rel=1e-12) == told.baseline.K_L


@pytest.mark.slow
def test_terminal_page_and_picture_are_in_mm_and_the_answer_in_m(found, monkeypatch, tmp_path):
    monkeypatch.setattr(command_module, "diagnose", lambda *_: found)
    u = command(600)
    t, y, _, _ = simulate(u, {})
    path, out = tmp_path / "run.csv", tmp_path / "found"
    np.savetxt(path, np.c_[t, u, 1e3 * y], delimiter=",", header="t,u,y [mm]", comments="", fmt="%.9g")
    result = CliRunner().invoke(app, ["diagnose", str(path), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert re.search(r"level +250000 ± 5000 mm/s\^2", result.stdout)
    assert re.search(r"K_L\n.*\[mm/s/V\]", result.stdout)
    html = (out / "report.html").read_text("utf-8")
    assert "level = 250000 ± 5000 mm/s^2" in html
    assert not re.search(r"\bm/s|\[m\]", re.sub("<style>.*?</style>", "", html))
    answer = json.loads((out / "diagnosis.json").read_text())
    assert answer["units"] == {"y": "m", "K_L": "m/s/V", "omega_n": "rad/s", "zeta": "1"}
    assert answer["effects"][0]["parameters"]["level"]["value"] == LEVEL
    assert answer["baseline"]["K_L"] == K_L


def test_the_terminal_says_the_same_in_either_unit(found):
    """The same words; other numbers only with a length in their unit."""
    in_mm = as_text(scaled(found, 1e3), "mm")
    lines = [line.split() for line in as_text(found, "m").splitlines() if "m/s" not in line]
    for line in lines:
        if line and line[0] not in {"baseline", "extended"} and "─" not in line[0]:
            assert line in [each.split() for each in in_mm.splitlines()]
