"""A recording that no fit has seen: it scores, what does not carry over to it is told, and names stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from seod.data import Recording
from seod.diagnose.pipeline import Options, diagnose

pytestmark = pytest.mark.slow

RATE, OMEGA_N, ZETA, GAIN = 500.0, 60.0, 0.4, 3.0
ZERO = 0.1
"""Of the sensor, in the movement's standard deviation."""


def speeds(seed, zero, name, omega_n=OMEGA_N):
    """The speed of a linear plant under a multisine, with noise, read by a sensor with this zero."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / RATE
    lines = np.arange(1, 24) / 2.0
    u = (
        sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(lines, rng.uniform(0, 6, len(lines)), strict=True))
        / 4
    )
    plant = [GAIN * omega_n**2], [1.0, 2.0 * ZETA * omega_n, omega_n**2]
    y = lsim(plant, u, t, interp=False)[1]
    y = y + np.std(y) * (zero + 0.01 * rng.standard_normal(len(t)))
    rows = np.arange(1, len(t) + 1)
    return Recording((Path(name),), t, u, y, None, None, None, rows, {}, {}, ())


@pytest.fixture(scope="module")
def fitted():
    return speeds(1, ZERO, "fitted.csv")


def asked(fitted, other):
    return diagnose([fitted], [other], Options(output="velocity", effort="quick"))


def test_an_offset_that_both_recordings_have_is_named(fitted):
    d = asked(fitted, speeds(2, ZERO, "alike.csv"))
    assert d.verdict == "effects"
    assert [each.name for each in d.effects] == ["load_bias"]
    assert d.share(d.effects[0]) == pytest.approx(1.0, abs=0.01)
    assert d.grade == "down_to_noise"
    size, (again,) = d.effects[0].parameters["acceleration"], d.effects[0].holdout
    low, high = again["acceleration"].ci95
    assert low < size.ci95[1]
    assert size.ci95[0] < high
    assert not any("does not repeat" in told or "another rig" in told for told in d.remarks)


def test_an_offset_of_the_fitted_recording_alone_keeps_its_name_and_is_told_not_to_carry_over(fitted):
    d = asked(fitted, speeds(2, -ZERO, "other.csv"))
    alone = diagnose([fitted], (), Options(output="velocity", effort="quick"))
    assert [each.name for each in d.effects] == [each.name for each in alone.effects] == ["load_bias"]
    assert d.extended.effects == alone.extended.effects
    size, (again,) = d.effects[0].parameters["acceleration"].value, d.effects[0].holdout
    assert again["acceleration"].value == pytest.approx(-size, rel=0.05)
    assert d.as_json()["effects"][0]["holdout"][0]["acceleration"]["value"] == again["acceleration"].value
    assert any("load_bias.acceleration fitted to it is" in told for told in d.remarks)
    assert d.verdict == "unexplained"
    assert d.grade == "useless"
    assert "load_bias" in d.extended.effects
    assert any(told.startswith("load_bias does not carry over") for told in d.remarks)
    assert any("the zero of sensor or loop is another one" in told for told in d.remarks)


def test_another_state_of_the_rig_is_told_by_its_plant():
    """A heavier load had been called gusts: what it errs by is no noise."""
    d = asked(speeds(1, 0.0, "fitted.csv"), speeds(2, 0.0, "heavier.csv", 0.8 * OMEGA_N))
    (told,) = [each for each in d.remarks if "another rig, or another state" in each]
    there = float(told.removeprefix("held-out recording 1: fitted to it alone omega_n is ").split()[0])
    assert there == pytest.approx(0.8 * OMEGA_N, rel=0.002)
    assert "K_L" not in told
    assert "zeta" not in told
