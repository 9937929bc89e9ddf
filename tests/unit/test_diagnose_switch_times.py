"""When each switch of a relay was given, where a record only has the row that saw it first."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from seod.data import Recording
from seod.diagnose import pipeline
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.switch_times import _Search, switch_times
from seod.diagnose.one_search import SearchResult, SearchSetup
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.command_timing import switch_look
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, all_windows, cut, fitted_windows, undivided
from seod.diagnose.search.budget import Budget
from seod.diagnose.starts.baseline import _rough
from seod.diagnose.starts.sizes import scales

K_L, OMEGA_N, ZETA = 2.0, 12.0, 0.6
ROWS_HZ, SECONDS, NOISE = 100.0, 20.0, 1e-3


def relayed(finer, spring=0.0, late=0, push=0.0, noise=NOISE, gusts=0.0):
    """Rows of a relay that switches `finer` times a row, and by how many rows earlier it switched.

    The plant by its transition matrix, apart from the simulation under test; `gusts` push the load at random.
    """
    tick = 1.0 / (finer * ROWS_HZ)
    rates = np.zeros((5, 5))  # position, speed, acceleration by the oil, command, 1
    rates[0, 1] = rates[1, 2] = 1.0
    rates[1, 0], rates[1, 4] = -spring, push
    rates[2, 1:4] = -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N, K_L * OMEGA_N**2
    step = expm(rates * tick)
    count = int(finer * ROWS_HZ * SECONDS)
    y, u, x, volts = np.zeros(count), np.zeros(count), np.r_[0.0, 0.0, 0.0, 0.0, 1.0], 1.0
    pushes = gusts * np.sqrt(tick) * np.random.default_rng(6).normal(size=count)
    for k in range(count):
        y[k] = x[0]
        if volts * (x[0] - 0.05 * np.sin(1.7 * k * tick)) > 0.003:
            volts = -volts
        u[k] = x[3] = volts
        x = step @ x
        x[1] += pushes[k]
    rows = np.arange(0, count, finer)
    seen = u[np.maximum(rows - late, 0)]
    switched = np.flatnonzero(np.diff(u)) + 1
    recorded = np.flatnonzero(np.diff(seen)) + 1
    leads = recorded - switched[: len(recorded)] / finer
    errors = noise * np.std(y) * np.random.default_rng(5).normal(size=len(rows))
    return rows * tick, seen, y[rows] + errors, leads


def recorded(t, u, y, t_u=None):
    return Recording((Path("relay.csv"),), t, u, y, t_u, None, None, np.arange(1, len(t) + 1), {}, {}, ())


def fits(t, u, y, damping=ZETA, t_u=None, **beside):
    """A record's windows, and fits of Eq. 1 and of one beside an effect that begins at a number."""
    one = series(recorded(t, u, y, t_u))
    to_fit, _ = cut([one])
    model = baseline_model(_rough(to_fit, OMEGA_N), 1.0, False, {})
    small = fitted_windows(to_fit)
    x = model.searched({"K_L": K_L * damping / ZETA, "omega_n": OMEGA_N, "zeta": damping})
    plain = fit(model, small, x, begun_states(model, x, small))
    sets = [plain]
    for place, value in beside.items():
        name, _, number = place.partition("__")
        richer = replace(model, scales=scales(plain, small)).with_effect(name)
        values = {each.place: 0.0 for each in richer.coordinates}
        x = richer.searched(values | model.values(plain.x) | {f"{name}.{number}": value})
        sets.append(fit(richer, small, x, begun_states(richer, x, small)))
    return Cut([one], all_windows([one])), sets


def asked(*args, **beside):
    """What is told of the record's switches by these fits."""
    windows, sets = fits(*args, **beside)
    return switch_times(sets, windows, map)


@pytest.mark.parametrize(("finer", "late"), [(4, 0), (8, 3)])
@pytest.mark.parametrize("damping", [ZETA, 0.15])
def test_each_switch_is_told_its_own_time(finer, late, damping):
    """Also from a fit that has a quarter of the damping and of the gain, as a limit cycle may show it."""
    t, u, y, true = relayed(finer, late=late)
    told = asked(t, u, y, damping)
    assert told is not None
    off = np.abs(told.leads[0] - true)
    assert np.std(true) > 0.2
    assert np.mean(off < 0.1) > 0.9
    assert np.median(off) < 0.03
    assert "rows earlier than recorded" in told.sentence


@pytest.mark.parametrize(("finer", "late"), [(4, 0), (8, 3)])
def test_a_run_of_the_whole_recording_keeps_to_it_with_these_times(finer, late):
    """Near its ends a segment's initial state stands for the time of a switch: a longer run went astray."""
    t, u, y, _ = relayed(finer, late=late)
    windows, sets = fits(t, u, y)
    told = switch_times(sets, windows, map)
    given, found = Cut(told.of(windows.series), windows.windows), told.told_by
    for run in (given, undivided(given)):
        assert simulate_held_out(found.model, found.x, run).nrmse < 1.5 * NOISE


def test_times_near_the_ends_of_windows_go_with_the_numbers_of_the_others():
    """Under gusts the numbers of other windows differ a little, and lead one run astray with their times."""
    t, u, y, _ = relayed(2, gusts=0.01)
    windows, sets = fits(t, u, y)
    told = switch_times(sets, windows, map)
    given, found = Cut(told.of(windows.series), windows.windows), told.told_by
    in_windows, in_one_run = (
        simulate_held_out(found.model, found.x, each).nrmse for each in (given, undivided(given))
    )
    assert in_windows < 1.7 * NOISE
    assert in_one_run < 1.2 * in_windows


def test_times_are_also_told_from_a_plant_that_no_fit_to_commands_as_recorded_came_to():
    t, u, y, true = relayed(4, spring=40.0)
    windows, (plain, sprung) = fits(t, u, y, load_spring__stiffness=30.0)
    near = {"K_L": 1.1 * K_L, "omega_n": 1.05 * OMEGA_N, "zeta": 1.1 * ZETA, "load_spring.stiffness": 36.0}
    centre = {"load_spring.centre": 0.0}
    begun = replace(sprung, x=sprung.model.searched(near | centre))
    assert switch_times([plain], windows, map) is None
    told = switch_times([plain], windows, map, lambda: [begun])
    assert np.median(np.abs(told.leads[0] - true)) < 0.03


@pytest.mark.parametrize("spring", [0.0, 40.0])
def test_switches_that_were_given_at_rows_keep_their_times(spring):
    """Also where the set lacks an effect that the plant has."""
    t, u, y, true = relayed(1, spring)
    assert np.all(true == 0.0)
    assert asked(t, u, y) is None


def test_an_effect_that_is_none_does_not_bend_the_times():
    t, u, y, true = relayed(4)
    plain, both = asked(t, u, y, 0.15), asked(t, u, y, 0.15, load_spring__stiffness=60.0)
    assert np.array_equal(plain.leads[0], both.leads[0])
    assert np.median(np.abs(plain.leads[0] - true)) < 0.03


def test_an_effect_that_the_plant_has_is_needed_to_tell_the_times():
    t, u, y, true = relayed(4, spring=40.0)
    assert asked(t, u, y) is None
    both = asked(t, u, y, load_spring__stiffness=30.0)
    assert np.median(np.abs(both.leads[0] - true)) < 0.03


def test_a_load_that_pushes_is_no_difference_of_switches_up_and_down():
    """Times do as much as a small load, but who looks at commands does not see which way they go."""
    t, u, y, true = relayed(4, push=0.2, noise=0.02)
    bent, told = asked(t, u, y), asked(t, u, y, load_bias__acceleration=0.15)
    assert np.median(np.abs(bent.leads[0] - true)) > 0.1
    assert np.median(np.abs(told.leads[0] - true)) < 0.05


def test_a_set_that_came_to_no_plant_begins_again_from_the_one_that_errs_least():
    t, u, y, true = relayed(4)
    windows, (plain,) = fits(t, u, y)
    search = _Search(fitted_windows(windows), map)
    best, _ = search.run(plain)
    model = plain.model.with_effect("load_bias")
    far = {"K_L": 0.01, "omega_n": 1.0, "zeta": 0.001, "load_bias.acceleration": 0.0}
    stuck, parts = search.run(replace(plain, model=model, x=model.searched(far)))
    nearest, _ = search.nearest((stuck, parts), best)
    assert stuck.fitted.cost > best.fitted.cost + 1.0
    assert nearest.fitted.cost < best.fitted.cost + 0.02
    assert np.median(np.abs(nearest.leads[0] - true)) < 0.03


def test_what_is_told_is_not_asked():
    t, u, y, _ = relayed(4)
    assert asked(t, u, y, t_u=t - 0.001) is None


def test_a_relay_that_is_seldom_looked_at_has_longer_looks():
    t, u, y, _ = relayed(1)
    rows = np.arange(len(u))
    seldom = u[rows - rows % 3]
    looks = [switch_look(series(recorded(t, each, y))) for each in (u, seldom, np.sin(t))]
    assert looks == [1, 3, 0]


@pytest.mark.parametrize(
    ("coarse", "left", "asked"),
    [
        pytest.param(True, (0.03, 0.9), False, id="rounding alone is left"),
        pytest.param(True, (0.03, 3.0), True, id="fitted windows show more"),
        pytest.param(False, (0.03, 0.9), True, id="a fine sensor"),
    ],
)
def test_times_within_a_coarse_sensors_rounding_are_not_asked(monkeypatch, coarse, left, asked):
    """Of 600 switches at rows each had its own time: what a sensor of six steps rounds away let it be any."""
    held, seen = (SimpleNamespace(adequacy=each) for each in left)
    chosen = SimpleNamespace(searched=None, without={}, held=held)
    start = SimpleNamespace(to_fit=Cut([], ()), held_out=SimpleNamespace(windows=(), coarse=coarse))
    result = SearchResult(
        start, start.held_out, SimpleNamespace(chosen=chosen, seen=seen), Budget.of(1, "quick")
    )
    tried = []
    monkeypatch.setattr(pipeline, "other_timing", lambda *_: None)
    monkeypatch.setattr(pipeline, "switch_times", lambda *given: tried.append(given))
    setup = SearchSetup(False, None, map, result.budget, lambda *_: None)
    result.findings.grown = SimpleNamespace(best=[SimpleNamespace(model=None)])
    assert pipeline._timed_otherwise(result, ([], []), setup, None) is result
    assert bool(tried) is asked


def test_what_was_found_stays_where_the_clock_has_ended_the_search(monkeypatch):
    """Another search would try nothing, and find less."""
    held = SimpleNamespace(adequacy=9.0)
    findings = SimpleNamespace(chosen=SimpleNamespace(searched=None, without={}, held=held), seen=held)
    budget = Budget(safety=(iter([0.0, *[700.0] * 9]).__next__, 600.0))
    result = SearchResult(SimpleNamespace(held_out=SimpleNamespace(windows=())), None, findings, budget)
    monkeypatch.setattr(pipeline, "other_timing", lambda *_: pytest.fail("asked"))
    setup = SearchSetup(False, None, map, budget, lambda *_: None)
    assert pipeline._timed_otherwise(result, ([], []), setup, None) is result


@pytest.mark.slow
def test_a_plant_behind_a_relay_that_is_seen_at_rows_hides_nothing():
    """Without times of its own it had a tenth of its damping, and a disturbance."""
    t, u, y, true = relayed(4)
    told = diagnose([recorded(t, u, y)], (), Options(effort="quick"))
    assert (told.verdict, told.effects) == ("clean", ())
    found = told.extended
    assert [found.K_L, found.omega_n, found.zeta] == pytest.approx([K_L, OMEGA_N, ZETA], rel=0.01)
    assert any(f"each of the {len(true)} switches" in each for each in told.remarks)
