"""Recordings under a relay: fewer samples, states carried on, narrow valleys."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from relay_records import (
    LOST,
    STALLS,
    TRUTH,
    WAVES,
    N,
    T,
    grid_once,
    model_of,
    noise_of,
    recorded,
    searched,
)

from seod.diagnose.causes.base import DAMPED_BY_RELAY
from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import hidden_by_relay, searched_causes
from seod.diagnose.fitting.initial_states import (
    alike_states,
    begun_states,
    best_states,
    carried_states,
    measured_places,
    settled_states,
    simulated_states,
)
from seod.diagnose.fitting.least_squares import Fitted, fit, settle
from seod.diagnose.fitting.simulate import simulate
from seod.diagnose.record.windows import Cut, cut, segments, sparse
from seod.diagnose.search import refine
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.race import extended
from seod.diagnose.search.refine import refined, settled
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.relay.plant import GridPlant
from seod.diagnose.starts.sizes import scales
from sim.effects import EFFECTS

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _same_grids(monkeypatch):
    monkeypatch.setattr("seod.diagnose.search.screen.grid_plants", grid_once)


@pytest.fixture
def no_grid(monkeypatch):
    """Where it takes seconds and nothing asks for it."""
    monkeypatch.setattr("seod.diagnose.search.screen.grid_plants", lambda _: ())


def test_fewer_samples_see_the_same_plant():
    one, _ = recorded("stalls")
    windows = cut([one])[0]
    few = sparse(windows)
    stride = len(one.t) // len(few.series[0].t)
    assert stride > 1
    assert len(few.series[0].u) < 0.1 * N
    assert few.series[0].period_s / few.series[0].tick >= 50.0
    model = model_of(one, "coulomb_friction")
    record = model.kernel_parameters(searched(model, STALLS))
    every, some = (Cut([each], ((0, 0, len(each.t)),)) for each in (one, few.series[0]))
    y = simulate(record, every, measured_places(every))[:: one.t.searchsorted(few.series[0].t[1])]
    seen = simulate(record, some, measured_places(every))
    assert np.std(seen - y[: len(seen)]) < 0.02 * np.std(y)  # substeps may be longer than between all samples


def test_the_growth_of_a_limit_cycle_is_not_tried():
    windows = cut([recorded("stalls")[0]])[0]
    few = sparse(windows)
    assert len(few.windows) == len(windows.windows) - 1
    at = few.series[0].t[few.windows[0][1]]
    assert at == pytest.approx(windows.series[0].t[windows.windows[1][1]], abs=0.01)


def test_commands_of_another_kind_keep_all_samples():
    one, _ = recorded("stalls")
    other = replace(one, u=np.sin(7.0 * T), levels=N, relayed=False)
    windows = cut([other])[0]
    same = sparse(windows)
    assert same.windows == windows.windows
    assert len(same.series[0].t) == N


def test_where_in_its_play_a_load_was_at_rest_is_found():
    one = recorded("lost")[0]
    every = Cut([one], ((0, 0, N // 4),))
    model = model_of(one, *LOST)
    x = searched(model, LOST)
    start = begun_states(model, x, every)
    left = one.y[: N // 4] - simulate(model.kernel_parameters(x), every, start)
    assert np.mean(left**2) < 1.2 * math.exp(noise_of("lost"))


def test_other_plants_of_a_valley_are_tried_where_windows_are_fitted_unevenly(monkeypatch, no_grid):
    one = recorded("lost")[0]
    windows = segments(cut([one])[0]).only((0, 1))
    model = model_of(one, *LOST)
    far = searched(model, LOST, zeta=0.5)
    truth = GridPlant(
        0.0, *TRUTH.values(), 0.0, 0.1, {"coulomb_friction.level": 5000.0, "backlash.gap": 0.3}, {}
    )
    screened = replace(screen(windows, map, Budget(seconds=1e6)), grid_plants=(truth,))
    begun = fit(model, windows, far, simulated_states(model, far, windows), 0)
    ends = []
    for uneven in (False, True):
        monkeypatch.setattr(refine, "_uneven", lambda found, uneven=uneven: uneven)
        ends.append(refined(begun, windows, screened).excess)
    assert ends[1] < 1.1 < ends[0]


@pytest.mark.parametrize(
    ("squares", "uneven"), [((1.0, 1.1), False), ((1.0, 2.0), True), ((3.0, 9.0), False)]
)
def test_windows_are_fitted_unevenly_where_only_some_are_down_to_the_noise(squares, uneven):
    one = recorded("stalls")[0]
    windows = segments(cut([one])[0]).only((0, 1))
    model = model_of(one)
    x = model.searched(TRUTH)
    found = fit(model, windows, x, simulated_states(model, x, windows), 0)
    told = replace(found, error=np.array(squares) * windows.allowed**2)
    assert refine._uneven(told) is uneven


def test_plain_friction_is_also_tried_on_bristles():
    """Where plain friction is far from the truth it is not among the best, nor what is added to it."""
    one, _ = recorded("gives")
    screened = screen(segments(cut([one])[0]), map, Budget(seconds=1e6))
    model = model_of(one)
    x, few = model.searched(TRUTH), screened.cut
    base = fit(model, few, x, simulated_states(model, x, few))
    best = extended(screened, [base], [name for name in EFFECTS if name != "coulomb_friction"])[0]
    assert set(best.model.names) == {"coulomb_friction", "lugre_friction"}
    assert best.excess < 1.1


def test_a_load_as_heavy_as_the_actuator_is_found_from_the_limit_cycles_own_frequency():
    few = segments(cut([recorded("swings")[0]])[0])
    screened = screen(few, map, Budget(seconds=1e6))
    begun = baseline(screened.cut, False, {})
    assert begun.other is not None
    model = replace(begun.other.model, scales=scales(begun.near, screened.cut))
    x = begun.other.x
    parent = fit(model, screened.cut, x, settled_states(model, x, screened.cut), free=np.zeros(3, np.bool_))
    best = extended(screened, [parent], [name for name in EFFECTS if name != "load_resonance"])[0]
    assert best.excess < 1.05
    assert best.model.values(best.x)["load_resonance.inertia"] == pytest.approx(1.0, rel=0.3)


def test_the_best_fits_settle_where_steps_along_a_bent_valley_gain_little():
    one = recorded("swings")[0]
    screened = screen(segments(cut([one])[0]), map, Budget(seconds=1e6))
    model, ends = model_of(one, "load_resonance"), []
    for inertia, omega in ((1.5, 168.0), (0.6, 221.0)):
        x = searched(model, {"load_resonance": {"inertia": inertia, "omega": omega, "zeta": 0.05}})
        begun = fit(model, screened.cut, x, simulated_states(model, x, screened.cut), 3)
        ends.append([act(begun, screened.every, screened).x for act in (refined, settled)])
    (early, one_end), (late, other_end) = ends
    assert np.abs(early - late).max() > 0.03
    assert np.abs(one_end - other_end).max() < 1e-3


def test_what_is_but_a_gain_of_two_commands_is_not_tried():
    sizes = Scales(1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 10.0, 1.0, 1e-3)
    assert set(searched_causes(sizes)) >= hidden_by_relay().keys()
    assert not set(searched_causes(replace(sizes, levels=2))) & hidden_by_relay().keys()


def test_relays_of_two_amplitudes_give_four_commands_together(no_grid):
    """Then a deadband, a saturation and a hysteresis are no longer another gain."""
    one, _ = recorded("stalls")
    twice = replace(one, u=2.0 * one.u)
    for some, levels in (([one], 2), ([one, one], 2), ([one, twice], 4)):
        windows = segments(cut(some)[0])
        fitted = baseline(windows, False, {}).best
        told = scales(fitted, windows)
        assert told.levels == levels
        assert (hidden_by_relay().keys() <= set(searched_causes(told))) == (levels > 2)


def test_a_relay_s_plant_is_not_damped_beyond_what_shows(no_grid):
    one, _ = recorded("stalls")
    found = screen(cut([one])[0], map, Budget(seconds=1e6))
    assert baseline(found.cut, False, {}).best.model.scales.damped == DAMPED_BY_RELAY


def test_states_are_carried_on_where_one_reading_has_several_places():
    one, places = recorded("waves")
    model = model_of(one, "position_ripple")
    x = searched(model, WAVES)
    fitted, aside = cut([one])
    start = measured_places(fitted)
    start[:, 2] = places[[first for _, first, _ in fitted.windows]]
    found = Fitted(model, fitted, x, settle(model, fitted, x, start, fitted.good, 20), np.empty(0), 0.0)
    carried = carried_states(found, aside)
    truth = places[[first for _, first, _ in aside.windows]]
    assert np.abs(carried[:, 2] - truth).max() < 1e-3 * np.ptp(places)
    assert np.abs(measured_places(aside)[:, 2] - truth).max() > 0.03 * np.ptp(places)
    own = carried_states(found, fitted)
    assert np.array_equal(own, found.start)


def test_states_are_those_of_the_same_phase_of_other_limit_cycles():
    one, _ = recorded("stalls")
    model, (fitted, aside) = model_of(one, "coulomb_friction"), cut([one])
    x = searched(model, STALLS)
    start = settle(model, fitted, x, simulated_states(model, x, fitted), fitted.good, 20)
    found = fit(model, fitted, x, start, most=1)
    spoiled = replace(found, start=np.vstack([found.start[:1] + 1e3, found.start[1:]]))
    spoiled = replace(spoiled, error=found.error * np.array([1e4, *np.ones(len(found.error) - 1)]))
    held = simulate(model.kernel_parameters(found.x), aside, alike_states(spoiled, aside))
    truth = one.y[aside.windows[0][1] : aside.windows[0][2]]
    assert np.abs(held[aside.slices[0]] - truth).mean() < 0.03 * np.std(truth)
    blind = simulate(model.kernel_parameters(found.x), aside, carried_states(spoiled, aside))
    assert np.abs(blind[aside.slices[0]] - truth).mean() > np.std(truth)


def test_each_window_takes_the_state_that_leaves_less():
    one, _ = recorded("stalls")
    model, windows = model_of(one, "coulomb_friction"), segments(cut([one])[0])
    x = searched(model, STALLS)
    good = settle(model, windows, x, simulated_states(model, x, windows), windows.good)
    bad = good + np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    mixed, other = good.copy(), bad.copy()
    mixed[0], other[0] = bad[0], good[0]
    assert np.array_equal(best_states(model, x, windows, mixed, other), good)


def test_the_valley_between_friction_and_plant_is_followed():
    one, _ = recorded("stalls")
    model = model_of(one, "coulomb_friction")
    few = sparse(segments(cut([one])[0]))
    x = searched(model, {"coulomb_friction": {"level": 4000.0}}, K_L=5.0, omega_n=150.0, zeta=0.06)
    found = fit(model, few, x, simulated_states(model, x, few), most=15)
    assert found.excess < 1.22  # 1.28 without initial states looked for
