"""The grid of plants that a relay's recording may come from, and the steps from its points."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from relay_records import (
    LOST,
    STALLS,
    TRUTH,
    N,
    T,
    grid_once,
    gridded,
    model_of,
    noise_of,
    recorded,
    searched,
)

from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.record.command_period import relay_period_s
from seod.diagnose.record.windows import Cut, cut, segments, sparse
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.race import extended
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.relay import compare
from seod.diagnose.starts.relay.compare import Segment
from seod.diagnose.starts.relay.grid import grid_plants
from seod.diagnose.starts.relay.plant import GridPlant
from seod.diagnose.tuning.search import SCREEN
from sim.parameters import parameters

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _same_grids(monkeypatch):
    monkeypatch.setattr("seod.diagnose.search.screen.grid_plants", grid_once)


@pytest.mark.parametrize(
    ("kind", "causes"),
    [
        ("stalls", ["coulomb_friction"]),
        ("plays", ["backlash"]),
        ("gives", ["coulomb_friction", "lugre_friction"]),
        ("both", ["coulomb_friction", "backlash"]),
        ("locks", ["periodic_disturbance"]),
    ],
)
def test_the_grid_leads_to_the_cause(kind, causes):
    one, _ = recorded(kind)
    few = sparse(segments(cut([one])[0])).only((0, 1))
    model = model_of(one, *causes)
    begun = [model.searched(each.values()) for each in gridded(kind) if each.begins(causes)]
    assert 2 <= len(begun) <= 14
    found = (fit(model, few, x, simulated_states(model, x, few), most=25) for x in begun)
    assert any(each.excess < 1.1 for each in found)


def test_the_disturbance_to_which_a_relay_has_locked_is_that_of_the_plant_in_the_grid():
    one, _ = recorded("locks")
    assert relay_period_s(one.t, one.u) == pytest.approx(2.0 * np.pi / 88.0, rel=1e-3)
    near = [each for each in gridded("locks") if each.causes == {"periodic_disturbance"}]
    best = min(near, key=lambda each: each.cost)
    assert abs(best.K_L / TRUTH["K_L"] - 1.0) < 0.2
    told = {of.split(".")[1]: value for of, value in best.sizes.items()}
    assert told["omega"] == pytest.approx(88.0, rel=1e-3)
    assert math.hypot(told["cosine"], told["sine"]) == pytest.approx(9000.0, rel=0.3)
    assert math.atan2(told["cosine"], told["sine"]) == pytest.approx(0.4, abs=0.4)


def test_a_play_that_takes_most_of_the_swing_is_met_between_the_cells():
    both = [each for each in gridded("lost") if each.causes == LOST.keys()]
    assert min(each.cost for each in both) < noise_of("lost") + 0.05


def test_how_the_limit_cycle_grew_tells_the_plants_of_a_valley_apart():
    one = recorded("lost")[0]
    found = grid_plants(Cut((one,), ((0, 1200, 4000), (0, 4000, 6000))))
    both = [each for each in found if each.causes == LOST.keys() and each.cost < noise_of("lost") + 0.05]
    wide = [each.sizes["backlash.gap"] for each in both]
    assert max(wide) > 1.3 * LOST["backlash"]["gap"]
    assert sum(abs(gap / LOST["backlash"]["gap"] - 1.0) < 0.05 for gap in wide) >= 2


def test_bristles_of_the_grid_are_as_stiff_as_the_plants():
    bent = [each for each in gridded("gives") if "lugre_friction" in each.causes]
    best = min(bent, key=lambda each: each.cost)
    assert best.cost < noise_of("gives") + 0.1
    assert best.sizes["lugre_friction.stiffness"] == pytest.approx(1e5, rel=0.3)
    assert pytest.approx(TRUTH["K_L"], rel=0.1) == best.K_L
    assert best.begins({"coulomb_friction", "lugre_friction"})
    assert not best.begins({"coulomb_friction"})


def test_sets_of_the_grid_are_the_nearest_plant_of_each_kind_as_it_is():
    """A limit cycle hardly tells the gain of a plant from its damping: the nearest is 30 % off."""
    one, _ = recorded("gives")
    screened = screen(segments(cut([one])[0]), map, Budget.of(N, "normal"))
    sets = screened.grid_sets(model_of(one))
    kinds = [frozenset(each.model.names) for each in sets]
    assert len(kinds) == len(set(kinds)) == SCREEN.grid_sets
    nearest = min(screened.grid_plants, key=lambda each: each.cost)
    late = {"transport_delay"} if nearest.delay > 0.0 else set()
    assert kinds[0] == nearest.causes | late
    first = sets[0].model.values(sets[0].x)
    assert [first[of] for of in TRUTH] == pytest.approx([nearest.K_L, nearest.omega_n, nearest.zeta])
    assert first["coulomb_friction.level"] == pytest.approx(nearest.sizes["coulomb_friction.level"])
    assert first["K_L"] == pytest.approx(TRUTH["K_L"], rel=0.3)


def test_the_speed_at_which_friction_has_fallen_settles():
    """Of plain friction: one that hardly falls within the speeds of the limit cycle."""
    falls = [each for each in gridded("stalls") if each.causes == {"stribeck_friction"}]
    assert min(each.cost for each in falls) < noise_of("stalls") + 0.5


def test_a_command_may_be_measured_in_counts():
    one = recorded("stalls")[0]
    counts = replace(one, u=1e5 * one.u)
    few = sparse(segments(cut([counts])[0]))
    volts = gridded("stalls")
    best = min(each.cost for each in volts)
    for each, same in zip(grid_plants(few), volts, strict=True):
        assert each.cost == pytest.approx(same.cost, abs=0.02)
        # farther off plants lie in valleys, along which rounding decides where a fit ends
        assert pytest.approx(1e-5, rel=0.02 if same.cost < best + 0.3 else 0.2) == each.K_L / same.K_L


def test_a_plant_that_cannot_be_simulated_ends_no_search(monkeypatch):
    """Of the grid, of the steps from its points, or of both."""
    few = sparse(segments(cut([recorded("stalls")[0]])[0]))
    asked = []

    def refused(*given, **named):
        asked.append(given)
        if len(asked) % 5 == 0 or 3700 < len(asked) < 3800:
            raise ValueError("coulomb_friction.level must be within [0, 1e+06]")
        return parameters(*given, **named)

    monkeypatch.setattr("seod.diagnose.starts.relay.compare.parameters", refused)
    monkeypatch.setattr("seod.diagnose.starts.relay.grid._disturbed", lambda _: [])
    assert len(grid_plants(few)) > 20
    assert len(asked) > 3800


def test_a_disturbance_is_tried_by_one_that_a_plant_may_have(monkeypatch):
    segment = Segment(sparse(segments(cut([recorded("locks")[0]])[0])), 88.0)
    (cell, *_) = segment.plants(150.0, 4.0, {})
    assert cell.omega_n * segment.omega > 1e6
    found = segment.shaken(cell).sizes
    monkeypatch.setattr(compare, "COMPARE", replace(compare.COMPARE, strongest_disturbance=3e4))
    assert segment.shaken(cell).sizes == pytest.approx(found, rel=1e-3)


def test_where_samples_are_missing_there_is_no_plant():
    few = sparse(segments(cut([recorded("locks")[0]])[0]))
    (one,) = few.series
    none = replace(one, good=np.zeros_like(one.good))
    assert grid_plants(Cut((none,), few.windows)) == ()


def test_a_delay_moves_the_answer_of_the_grid():
    one, _ = recorded("stalls")
    later = replace(one, y=np.roll(one.y, 8))
    found = [
        each for each in grid_plants(sparse(segments(cut([later])[0]))) if each.causes == {"coulomb_friction"}
    ]
    late = min((each for each in found if each.delay > 0.0), key=lambda each: each.cost)
    prompt = min((each for each in found if each.delay == 0.0), key=lambda each: each.cost)
    assert late.cost < prompt.cost - 0.3
    assert 0.005 < late.delay < 0.012


def test_a_cell_is_a_start_of_the_sets_that_it_knows():
    prompt = GridPlant(0.0, 2.0, 30.0, 0.3, 0.0, 0.5, {"coulomb_friction.level": 5.0}, {})
    late = prompt._replace(delay=0.01)
    assert prompt.begins({"coulomb_friction", "load_bias"})
    assert not prompt.begins({"coulomb_friction", "sensor_lag"})
    assert late.begins({"coulomb_friction", "sensor_lag"})
    slight = prompt._replace(delay=0.001)
    assert slight.begins({"coulomb_friction"})
    assert slight.begins({"coulomb_friction", "sensor_lag"})
    assert not late.begins({"coulomb_friction"})
    assert not prompt.begins({"backlash"})
    assert not prompt.begins({"backlash", "coulomb_friction"})
    plain = {"K_L": 2.0, "omega_n": 30.0, "zeta": 0.3, "coulomb_friction.level": 5.0}
    stiff = {"lugre_friction.stiffness": 250.0, "lugre_friction.damping": 0.5 * math.sqrt(250.0)}
    assert prompt.values() == plain | stiff
    plays = prompt._replace(sizes={"backlash.gap": 0.1})
    assert "lugre_friction.stiffness" not in plays.values()
    both = prompt._replace(sizes=prompt.sizes | plays.sizes)
    assert both.begins({"backlash", "coulomb_friction"})
    assert not both.begins({"coulomb_friction"})
    assert both.values() == plain | {"backlash.gap": 0.1}
    assert late.values()["valve_lag.time"] == 0.01
    shaken = prompt._replace(sizes={"periodic_disturbance.omega": 30.0})
    assert shaken.begins({"periodic_disturbance", "load_bias"})
    assert not shaken.begins({"load_bias"})
    assert not shaken.begins({"periodic_disturbance", "backlash"})


def test_bristles_are_tried_from_the_cells_of_plain_friction():
    one, _ = recorded("stalls")
    tried, rounds = [], count()

    def each(act, some):
        some = list(some)
        if next(rounds) == 0:  # what each start promises
            return [0.0 for _ in some]
        tried.extend(one.name for one in some if "*K_L" not in one.start and "K_L" in one.start)
        return []

    screened = screen(segments(cut([one])[0]), each, Budget(time.process_time, 1e6))
    model = model_of(one, "coulomb_friction")
    x, few = searched(model, STALLS), screened.cut
    parent = fit(model, few, x, simulated_states(model, x, few), free=np.zeros(len(x), np.bool_))
    assert extended(screened, [parent]) == []
    begun = [cell for cell in screened.grid_plants if cell.begins(["coulomb_friction", "lugre_friction"])]
    assert tried.count("lugre_friction") == len(begun) > 0
    assert "periodic_disturbance" not in tried  # none of these points knows its size


def test_only_a_relay_has_cells():
    one, _ = recorded("stalls")
    budget = Budget(time.process_time, 1e6)
    assert screen(segments(cut([one])[0]), map, budget).grid_plants
    other = replace(one, u=np.sin(7.0 * T), levels=len(T), relayed=False)
    assert not screen(segments(cut([other])[0]), map, budget).grid_plants


def test_the_grid_takes_no_time_from_the_search(monkeypatch):
    now = [0.0]
    budget = Budget(lambda: now[0], 10.0)

    def slow(_):
        now[0] += 9.0
        return ()

    monkeypatch.setattr("seod.diagnose.search.screen.grid_plants", slow)
    screen(segments(cut([recorded("stalls")[0]])[0]), map, budget)
    now[0] += 9.0
    assert not budget.spent
    now[0] += 2.0
    assert budget.spent
