"""Recordings made at different supply pressures: what is found in one foretells the other."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import linear, multisine, recording
from kernel_cases import follow, record

from seod.diagnose.pipeline import Options, diagnose, nominal_conditions
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut
from seod.diagnose.report.page import page
from seod.diagnose.search.budget import EFFORTS
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.sizes import scales

N, NOMINAL = 6000, 7e6
T = np.arange(N) / 1000.0


def made(ps, seed):
    """A speed behind an orifice, at this supply pressure [Pa]."""
    u = multisine(N, seed=seed, volts=1.0)
    plant = record(("square_root_flow",), sees_speed=True)
    y, _ = follow(plant, T, u, T, supply=np.full(N, ps / NOMINAL))
    return recording(u, y, noise=0.003, ps=np.full(N, ps))


def test_nominal_is_the_mean_of_what_is_fitted():
    pressed, plain = made(7e6, 1), replace(made(7e6, 2), ps=None)
    assert nominal_conditions([pressed, made(9e6, 2), plain]) == {"nominal_ps": 8e6}
    assert nominal_conditions([plain]) == {}
    warm = replace(plain, temperature=np.full(N, 40.0), f=np.full(N, 3.0))
    assert nominal_conditions([warm]) == {"nominal_temperature": 40.0, "nominal_f": 3.0}


@pytest.mark.slow
@pytest.mark.parametrize(("second", "pressed"), [(7e6, False), (9e6, True)])
def test_pressure_changes_from_recording_to_recording(second, pressed):
    every = [series(made(ps, seed), sees_speed=True, nominal_ps=8e6) for seed, ps in ((1, 7e6), (2, second))]
    cut = Cut(every, tuple((k, 0, N) for k in range(2)))
    found = baseline(cut, True, {}, map).best
    assert scales(found, found.cut).pressed == pressed


@pytest.mark.slow
def test_an_orifice_foretells_another_pressure():
    told = diagnose([made(7e6, 1)], [made(9e6, 2)], Options(output="velocity", effort="quick"))
    assert [each.name for each in told.effects] == ["square_root_flow"]
    assert told.extended.holdout_nrmse < 0.01
    assert told.baseline.holdout_nrmse > 0.05


@pytest.mark.slow
def test_a_supply_pressure_of_0_is_told_and_not_used(monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", 0.05)
    u = multisine(N)
    dead = recording(u, linear(u), ps=np.zeros(N), names={"ps": "supply"})
    told = diagnose([dead], (), Options(effort="quick"))
    assert [each for each in told.remarks if "column 'supply', the supply pressure ps, is never" in each]
    assert all(window.ps is None for window in told.windows)
    assert "load pressure" not in page(told, "m", ["a.csv"])
    json.dumps(told.as_json(), allow_nan=False)
