"""Whether y follows u or its integral, where nobody says so and Eq. 1 alone leaves it open."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from seod.data import Recording
from seod.diagnose import pipeline
from seod.diagnose.one_search import search_once
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.closed_form import ClosedForm, Types, output_types, taken_for
from seod.diagnose.result import DiagnoseError
from seod.diagnose.search.budget import EFFORTS

TICK, N = 0.02, 3000


@pytest.mark.parametrize(
    ("position", "speed", "likelier"),
    [
        (0.10, 0.90, "position"),
        (0.90, 0.10, "velocity"),
        (0.75, 0.53, "position"),
        (0.75, 0.40, "velocity"),
        (np.inf, 0.53, "velocity"),
        (np.inf, np.inf, "position"),
    ],
)
def test_by_eq_1_the_usual_type_is_likelier_unless_the_other_is_clearly_nearer(position, speed, likelier):
    closed = {"position": ClosedForm({}, position), "velocity": ClosedForm({}, speed)}
    types = output_types(closed, "position")
    assert types.likelier == likelier
    said = "speed" if likelier == "velocity" else "position"
    assert types.said[0].startswith(f"y is taken for a {said} ")


def test_the_usual_type_is_asked_first():
    closed = {"position": ClosedForm({}, 0.6), "velocity": ClosedForm({}, 0.6)}
    assert output_types(closed, "velocity").likelier == "velocity"


def recorded(y, u):
    t = np.arange(len(u)) * TICK
    return Recording((Path("run.csv"),), t, u, y, None, None, None, np.arange(len(u)), {}, {}, ())


def steps(seed=1):
    """Of random size, half a second to two seconds long."""
    random = np.random.default_rng(seed)
    lengths = random.integers(25, 100, N)
    return np.repeat(random.uniform(-1.0, 1.0, N), lengths)[:N]


def stepped(A, B, u):
    """States of a linear plant by its exact discrete form, its command held; shape (n, states)."""
    A, B, *_ = cont2discrete((A, B, np.eye(len(A)), np.zeros((len(A), 1))), TICK)
    x, out = np.zeros(len(A)), []
    for volts in u:
        out.append(x)
        x = A @ x + B[:, 0] * volts
    return np.array(out)


SPEED = np.array([[0.0, 1.0], [-36.0, -4.8]]), np.array([[0.0], [72.0]])
"""K_L = 2, omega_n = 6 rad/s, zeta = 0.4."""


@pytest.mark.slow
@pytest.mark.computes
def test_a_speed_without_sign_is_taken_for_one():
    """Of both signs of u it goes up: neither Eq. 1 of a speed nor of a position says much of it."""
    u = steps()
    speed = stepped(*SPEED, u)[:, 0]
    y = np.abs(speed) + 0.01 * np.std(speed) * np.random.default_rng(2).normal(size=N)
    found = diagnose([recorded(y, u)], (), Options(None, effort="quick"))
    assert found.output == "velocity"
    assert [each.name for each in found.effects] == ["rectified_sensor"]
    assert any("taken for a speed" in each and "held out" in each for each in found.remarks)
    assert found.extended.omega_n == pytest.approx(6.0, rel=0.03)


@pytest.mark.computes
def test_a_position_that_is_well_told_is_searched_once(monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", 0.05)
    tried = {"position": ClosedForm({}, 0.5), "velocity": ClosedForm({}, 0.4)}
    monkeypatch.setattr(
        "seod.diagnose.pipeline.closed_form", lambda _recordings, output, _told: tried[output]
    )
    A, B = SPEED
    A = np.block([[A, np.zeros((2, 1))], [np.array([[1.0, 0.0, 0.0]])]])
    u = steps()
    y = stepped(A, np.vstack([B, [[0.0]]]), u - np.mean(u))[:, 2]
    y = y + 0.005 * np.std(y) * np.random.default_rng(3).normal(size=N)
    types = []

    def counted(every, setup, closed):
        types.append(setup.sees_speed)
        return search_once(every, setup, closed)

    monkeypatch.setattr("seod.diagnose.pipeline.search_once", counted)
    found = diagnose([recorded(y, u - np.mean(u))], (), Options(None, effort="quick"))
    assert found.output == "position"
    assert found.extended.holdout_nrmse < 0.05
    assert types == [False]


@pytest.mark.slow
@pytest.mark.computes
def test_a_type_that_cannot_be_searched_takes_no_answer_away(monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", 0.05)

    def searched(every, setup, closed):
        if setup.sees_speed:
            raise DiagnoseError("y is noise for the most part")
        return search_once(every, setup, closed)

    monkeypatch.setattr("seod.diagnose.pipeline.search_once", searched)
    u = steps()
    y = np.abs(stepped(*SPEED, u)[:, 0])
    assert diagnose([recorded(y, u)], (), Options(None, effort="quick")).output == "position"


@pytest.mark.parametrize(
    ("limited", "errors", "adequacy", "output"),
    [
        pytest.param((True, False), (0.0143, 0.0141), 9.0, "position", id="at a limit, and no nearer"),
        pytest.param((True, False), (0.0141, 0.0143), 9.0, "velocity", id="nearer"),
        pytest.param((True, True), (0.0143, 0.0141), 9.0, "velocity", id="both are at a limit"),
        pytest.param((False, False), (0.0143, 0.0001), 9.0, "velocity", id="good already"),
        pytest.param((False, False), (0.188, 0.015), 9.0, "position", id="much is left"),
        pytest.param((False, False), (0.188, 0.16), 9.0, "velocity", id="of both"),
        pytest.param((False, False), (0.188, 0.015), 1.0, "velocity", id="noise is all"),
    ],
)
def test_a_plant_far_off_or_at_a_limit_may_be_one_of_the_other_type(
    monkeypatch, limited, errors, adequacy, output
):
    """A position that a spring holds was a speed of 20 times the damping, and a lag."""
    searched = {}
    for which, error in zip(("velocity", "position"), errors, strict=True):
        held = SimpleNamespace(nrmse=error, adequacy=adequacy)
        findings = SimpleNamespace(chosen=SimpleNamespace(held=held), seen=SimpleNamespace(adequacy=1.0))
        searched[which] = SimpleNamespace(findings=findings)
    ends = dict(zip(map(id, searched.values()), limited, strict=True))
    monkeypatch.setattr(pipeline, "_is_limited", lambda result: ends[id(result)])
    types = Types("velocity", {}, ("y is taken for a speed",))
    result, told, said = pipeline._as_either(types, lambda which, _: searched[which], lambda *_: None)
    assert (result, told) == (searched[output], output)
    assert ("what is found leaves" in said[0]) == (output == "position")


def test_the_usual_type_says_why_it_is_taken_where_the_other_is_a_little_nearer():
    assert "8.6 %, which is not below 60 % of that;" in taken_for("position", 0.093, 0.086)
    assert "below" not in taken_for("position", 0.086, 0.093)


@pytest.mark.slow
@pytest.mark.computes
def test_a_power_is_named_where_no_sign_ever_shows():
    """Whether a sensor shows a sign such a record does not tell; that it is bent it does."""
    u = 1.6 + 0.6 * steps(4)
    speed = np.maximum(stepped(*SPEED, u)[:, 0], 0.0)
    y = 2.0 * (0.25 * speed) ** 1.1
    y = y + 0.02 * np.std(y) * np.random.default_rng(5).normal(size=N)
    found = diagnose([recorded(y, u)], (), Options(None, effort="quick"))
    assert found.output == "velocity"
    assert [each.name for each in found.effects] == ["rectified_sensor"]
    power = found.effects[0].parameters["power"]
    assert power.value == pytest.approx(1.1, rel=0.03)
    assert power.ci95[0] > 1.0
    assert found.extended.holdout_nrmse < 0.03
