"""Noise that is not white is no cause, and hides none; what is off the list still shows through it."""

import dataclasses

import numpy as np
import pytest
from hidden_cases import draw, run
from hidden_records import Record, write
from hidden_rig import GIVEN, Drive, simulate
from scipy.signal import chirp, detrend, lfilter

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose

pytestmark = [pytest.mark.blind, pytest.mark.timeout(1200)]
SECONDS = 6.0


def coloured(memory, case, seed=7):
    """Noise that is an autoregression of first order, with the case's deviation."""
    white = np.random.default_rng(seed).normal(size=len(case.t) + 3000)
    return case.noise * np.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], white)[3000:]


def told(case, y, u, folder):
    write(Record(case.t, u, y, case.t + case.latency if case.latency else None, None), folder / "run.csv")
    output = "velocity" if case.rig.sees_speed else "position"
    return diagnose([read(folder / "run.csv")], (), Options(output, effort="quick"))


@pytest.mark.parametrize(
    ("cause", "excitation", "memory"),
    [
        (None, "multisine", 0.95),
        (None, "multisine", 0.99),
        (None, "relay", 0.99),
        ("coulomb_friction", "multisine", 0.99),
        ("backlash", "relay", 0.95),
        ("load_spring", "steps", 0.95),
    ],
)
def test_coloured_noise_is_no_cause_and_hides_none(tmp_path, cause, excitation, memory):
    case = draw(6, *(("clean", ()) if cause is None else ("one", (cause,))), excitation, duration=SECONDS)
    found = told(case, *run(case, coloured(memory, case)), tmp_path)
    assert [each.name for each in found.effects] == ([] if cause is None else [cause])
    assert found.verdict == ("clean" if cause is None else "effects")
    assert found.grade in {"down_to_noise", "good_for_design"}
    assert found.account.noise_order >= 1


@pytest.mark.parametrize("memory", [0.95, 0.99])
def test_a_command_of_noise_tells_as_well(tmp_path, memory):
    case = draw(6, "clean", (), "steps", duration=SECONDS)
    white = np.random.default_rng(8).normal(size=len(case.t))
    keep = np.exp(-case.tick * case.rig.omega_n)
    u = case.volts * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white) / 2.0
    y, u = simulate(case.rig, case.t, Drive(GIVEN, u), latency=case.latency)
    quiet = dataclasses.replace(case, noise=0.01 * float(np.std(y)))
    found = told(case, y + coloured(memory, quiet), u, tmp_path)
    assert (found.verdict, found.effects) == ("clean", ())


@pytest.mark.parametrize(("cause", "excitation"), [("volume", "multisine"), ("hardening", "relay")])
def test_what_is_off_the_list_shows_through_coloured_noise(tmp_path, cause, excitation):
    case = draw(6, "unlisted", (cause,), excitation, duration=SECONDS if cause == "volume" else 2.0 * SECONDS)
    found = told(case, *run(case, coloured(0.95, case)), tmp_path)
    assert found.verdict == "unexplained"
    assert found.account.systematic_nrmse > 0.02
    assert found.grade in {"partly", "useless"}


@pytest.mark.parametrize(("cause", "sees_speed"), [(None, False), ("hardening", False), ("drag", True)])
def test_under_a_sweep_coloured_noise_is_noise_and_what_is_off_the_list_shows(tmp_path, cause, sees_speed):
    """No two windows of a sweep are alike; pieces of one are like those beside them."""
    kind = ("clean", ()) if cause is None else ("unlisted", (cause,))
    case = draw(71050 if cause is None else 71200, *kind, "multisine", sees_speed, duration=SECONDS)
    hertz = case.rig.omega_n / (2.0 * np.pi)
    u = case.volts * chirp(case.t, 0.1 * hertz, case.t[-1], 3.0 * hertz, method="logarithmic")
    y, u = simulate(case.rig, case.t, Drive(GIVEN, u), latency=case.latency)
    quiet = dataclasses.replace(case, noise=0.01 * float(np.std(detrend(y))))
    found = told(case, y + coloured(0.95, quiet), u, tmp_path)
    if cause is None:
        assert (found.verdict, found.effects) == ("clean", ())
        assert found.account.asked
    else:
        assert found.verdict == "unexplained"
