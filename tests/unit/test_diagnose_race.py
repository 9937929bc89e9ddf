"""Races of causes: the order in which they are tried, how long it may take, and what is kept."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnose_truth import linear, multisine, recording

from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import DELAYS, further_causes, group, plain_forms, remote
from seod.diagnose.fitting.initial_states import settled_states
from seod.diagnose.fitting.least_squares import LeastSquares
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments, sparse
from seod.diagnose.search.beam import survivors
from seod.diagnose.search.budget import EFFORTS, Budget
from seod.diagnose.search.race import Entrant, Runner, _few_of_each, best_starts, extended, promising
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.sizes import scales
from seod.diagnose.tuning.search import BEAM, BUDGET, RACE

pytestmark = pytest.mark.slow

PLANT = {"omega_n": 100.0, "zeta": 0.3}


def fitted(cost, *names, **plant):
    """What a race has found, as far as it is asked what to keep."""
    model = SimpleNamespace(names=names, values=lambda x: x)
    return SimpleNamespace(model=model, x=PLANT | plant, cost=cost)


@pytest.mark.parametrize(
    ("names", "plain"),
    [
        (["stribeck_friction"], [{"coulomb_friction"}]),
        (["coulomb_friction", "lugre_friction", "backlash"], [{"coulomb_friction", "backlash"}]),
        (["coulomb_friction", "stribeck_friction"], [{"coulomb_friction"}]),
        (["static_valve_map"], [{"asymmetric_gain"}, {"valve_deadband"}, {"valve_saturation"}]),
        (["backlash"], []),
        ([], []),
    ],
)
def test_richer_forms_have_plain_ones(names, plain):
    assert plain_forms(names) == set(map(frozenset, plain))


def test_plain_friction_is_grown_where_the_richer_form_saves_too_little():
    plain, other = fitted(-3.0, "coulomb_friction"), fitted(-2.0, "backlash")
    little = fitted(-3.0 - 0.9 * BEAM.richer_gain, "stribeck_friction")
    much = fitted(-3.0 - 1.1 * BEAM.richer_gain, "stribeck_friction")
    assert survivors([little, plain, other]) == [plain, other]
    assert survivors([much, plain, other]) == [much, plain, other]
    assert survivors([little, other]) == [little, other]


def test_of_each_set_the_best_is_grown_and_of_some_a_second_plant():
    some = [fitted(-9.0 + k, name) for k, name in enumerate(["a", "b", "c", "d"])]
    assert survivors(some) == some[: BEAM.width]
    alike, apart = fitted(-8.9, "a", omega_n=110.0), fitted(-8.8, "a", omega_n=200.0)
    assert survivors([some[0], alike, apart, *some[1:]]) == [*some[: BEAM.width], apart]
    assert survivors([some[0], fitted(-7.9, "a", zeta=0.9), *some[1:]]) == some[: BEAM.width]
    seconds = [fitted(-8.5, "a", zeta=0.9), fitted(-7.9, "b", zeta=0.9), fitted(-6.9, "c", zeta=0.9)]
    assert survivors([some[0], seconds[0], *some[1:], *seconds[1:]]) == [
        *some[: BEAM.width],
        *seconds[: BEAM.second_plants],
    ]


def test_of_each_cause_the_starts_that_promise_most_are_tried():
    one, two = fitted(0.0), fitted(0.1)
    few = [Entrant(one, "backlash", {"backlash.gap": 0.1 * k}) for k in range(RACE.starts_of_a_cause + 2)]
    ranked = [few[0], Entrant(one, "valve_lag", {}), *few[1:], Entrant(two, "backlash", {})]
    left_out = few[RACE.starts_of_a_cause :]
    assert _few_of_each(ranked) == [each for each in ranked if each not in left_out]


def test_of_a_contact_another_plant_goes_on_too():
    parent = fitted(0.0)
    best, alike = fitted(-3.0, "backlash"), fitted(-2.9, "backlash", zeta=0.35)
    apart, third = fitted(-2.5, "backlash", zeta=0.9), fitted(-2.4, "backlash", zeta=2.0)
    runners = [Runner(parent, "backlash", one) for one in (third, alike, apart, best)]
    assert [one.found for one in best_starts(runners)] == [best, apart]
    lags = [Runner(parent, "valve_lag", one) for one in (apart, best)]
    assert [one.found for one in best_starts(lags)] == [best]


@pytest.fixture(scope="module")
def late():
    """A screen of a plant whose spool lags, and Eq. 1 fitted to it."""
    u = multisine(6000)
    few, _ = cut([series(recording(u, linear(u, lag=0.004)))])
    screened = screen(segments(few), map, Budget(seconds=1e6))
    begun = baseline(screened.cut, False, {})
    model = replace(begun.best.model, scales=scales(begun.near, screened.cut))
    return screened, replace(begun.best, model=model, start=settled_states(model, begun.best.x, screened.cut))


def entrants(parent, names):
    return [
        Entrant(parent, name, start) for name in names for start in group(name, parent.model.scales).starts
    ]


def test_what_promises_most_is_tried_first_and_starts_far_away_soon(late):
    screened, parent = late
    names = ["load_bias", "asymmetric_gain", "parameter_drift", "coulomb_friction", "valve_deadband"]
    begun = entrants(parent, [*names, *DELAYS, "valve_saturation", "square_root_flow"])
    tried = promising(screened, begun)
    near = Counter(one.name for one in begun if not remote(one.start))
    assert Counter(one.name for one in tried if not remote(one.start)) == {
        name: min(count, RACE.starts_of_a_cause) for name, count in near.items()
    }
    assert [one for one in begun if remote(one.start)] == [one for one in tried if remote(one.start)]
    assert tried[0].name in DELAYS
    far = [k for k, one in enumerate(tried) if remote(one.start)]
    assert far == list(range(RACE.first_tried, RACE.first_tried + len(far)))
    assert {one.name for one in tried[-3:]}.isdisjoint(DELAYS)


def test_a_race_leaves_out_what_it_has_no_time_for(late):
    screened, parent = late
    now, begun = [0.0], []

    def each(act, some):
        for one in some:
            now[0] += 1.0
            begun.append(one)
            yield act(one)

    budget = Budget(lambda: now[0], 100.0)
    among = ["valve_lag", "load_bias", "coulomb_friction", "backlash"]
    hurried = replace(screened, parallel=each, budget=budget)
    names = [name for name in group_names(parent) if name not in among]
    found = extended(hurried, [parent], names)
    assert found[0].model.names == ("valve_lag",)
    assert not budget.missed
    now[0] = 99.0
    assert extended(hurried, [parent], names) == []
    assert budget.missed


def group_names(parent):

    return further_causes(parent.model.scales, parent.model.names)


def test_a_short_recording_is_searched_for_longer():
    assert Budget.of(0, "normal").total == BUDGET.search_s + BUDGET.further_s
    assert (
        Budget.of(BUDGET.long_rows, "normal").total
        == Budget.of(10 * BUDGET.long_rows, "normal").total
        == BUDGET.search_s
    )
    assert Budget.of(0, "quick").total == EFFORTS["quick"] * (BUDGET.search_s + BUDGET.further_s)
    assert Budget.of(0, "thorough").total == math.inf
    now = [0.0]
    budget = Budget(lambda: now[0], 10.0, 5.0)
    later, share = budget.last_fit(), budget.share(0.4)
    now[0] = 1.01 * BUDGET.last_fit_part * 10.0
    assert later()  # what follows has its part of the time that a long recording has
    now[0] = 5.9
    assert not share()
    assert not budget.missed
    now[0] = 6.1
    assert share()
    assert budget.missed
    assert not budget.spent
    now[0] = 15.1
    assert budget.spent


def test_a_lag_that_no_sample_shows_is_not_searched():
    sizes = Scales(1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 100.0, 10.0, 2e-3)
    for name in ("sensor_lag", "valve_lag"):
        assert group(name, sizes).coordinates[0].low == pytest.approx(2e-4)


def test_parameters_asked_for_again_are_those_of_the_numbers_given(late):
    _, parent = late
    search = LeastSquares(parent.model, parent.cut, map, np.ones(3, np.bool_))
    x = parent.x.copy()
    first = search.kernel_parameters(x)
    assert search.kernel_parameters(parent.x) is first
    x[1] += 0.1
    assert search.kernel_parameters(x) == parent.model.kernel_parameters(x) != first
    assert search.kernel_parameters(parent.x) == first


def test_slow_commands_keep_the_samples_that_show_how_the_plant_swings():
    t = np.arange(12000) * 1e-3
    u = np.sign(np.sin(2.0 * np.pi * 0.5 * t + 0.1))
    one = series(recording(u, linear(u), noise=1e-4))
    assert sparse(cut([one])[0]).series[0].tick < 2.0 * np.pi / 117.0 / 4.0
