"""Recordings under a relay: plants to begin from, fewer samples, states carried on, narrow valleys."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from diagnose_models import sized_model
from plant_truth import PLACE, Plant

from seod.data import Recording
from seod.diagnose import judge
from seod.diagnose.begin import baseline, scales
from seod.diagnose.budget import Budget
from seod.diagnose.cell import Cell
from seod.diagnose.cells import cells
from seod.diagnose.command_period import relay_period_s
from seod.diagnose.coordinates import DAMPED_BY_RELAY, GAINS, Scales, searched_causes
from seod.diagnose.fit import Fitted, fit, settle
from seod.diagnose.judge import refined, settled
from seod.diagnose.screen import screen
from seod.diagnose.select import excess
from seod.diagnose.simulate import simulate
from seod.diagnose.states import (
    alike_states,
    begun_states,
    best_states,
    carried_states,
    measured_places,
    simulated_states,
)
from seod.diagnose.stretch import Stretch
from seod.diagnose.windows import Cut, cut, pieces, series, sparse
from sim.effects import EFFECTS
from sim.parameters import parameters

TICK, N, VOLTS = 1e-3, 8000, 1.85
T = np.arange(N) * TICK
NOISE = 0.01
TRUTH = {"K_L": 13.0, "omega_n": 113.0, "zeta": 0.17}
STALLS = {"coulomb_friction": {"level": 5400.0}}
GIVES = {"coulomb_friction": {"level": 1500.0}, "lugre_friction": {"stiffness": 1e5, "damping": 150.0}}
PLAYS = {"backlash": {"gap": 0.15}}
BOTH = {"coulomb_friction": {"level": 2500.0}, "backlash": {"gap": 0.1}}
LOST = {"coulomb_friction": {"level": 5000.0}, "backlash": {"gap": 0.3}}
SWINGS = {"load_resonance": {"inertia": 1.0, "omega": 190.0, "zeta": 0.05}}
LOCKS = {"periodic_disturbance": {"amplitude": 9000.0, "omega": 88.0, "phase": 0.4}}
WAVES = {"position_ripple": {"amplitude": 0.08, "wavenumber": 20.0, "phase": 0.3}}


@cache
def recorded(kind):
    """Series of the plant written apart under a relay, whose threshold it crosses between samples."""
    every = {"stalls": STALLS, "gives": GIVES, "plays": PLAYS, "both": BOTH, "waves": WAVES, "locks": LOCKS}
    effects = (every | {"swings": SWINGS, "lost": LOST})[kind]
    plant = Plant(*TRUTH.values(), effects)
    y, u, places = np.empty(N), np.empty(N), np.empty(N)
    for k in range(N):
        plant.advance(T[k])
        y[k], places[k] = plant.reading(plant.w), plant.w[PLACE]
        u[k] = -VOLTS if y[k] > 0.0 else VOLTS
        plant.command(u[k])
    y = y + np.random.default_rng(3).normal(0.0, NOISE * np.std(y), N)
    rows = np.arange(1, N + 1)
    return series(Recording((Path("relay.csv"),), T, u, y, None, None, None, rows, {}, {}, ())), places


@cache
def gridded(kind):
    """Its plants of the grid."""
    return cells(sparse(pieces(cut([recorded(kind)[0]])[0])))


def model_of(one, *names):
    """A model with these effects, in sizes of the recording."""
    rough = Scales(VOLTS, 10.0, 600.0, 0.0, 1.0, 0.5, 100.0, 8.0, TICK)
    return sized_model(one, rough, TRUTH, names)


def searched(model, effects, **base):
    values = {f"{name}.{of}": value for name, own in effects.items() for of, value in own.items()}
    for name in {"position_ripple"} & effects.keys():
        own = effects[name]
        values[f"{name}.cosine"] = own["amplitude"] * math.sin(own["phase"])
        values[f"{name}.sine"] = own["amplitude"] * math.cos(own["phase"])
    return model.searched(TRUTH | base | values)


def test_fewer_samples_see_the_same_plant():
    one, _ = recorded("stalls")
    windows = cut([one])[0]
    few = sparse(windows)
    stride = len(one.t) // len(few.series[0].t)
    assert stride > 1
    assert len(few.series[0].u) < 0.1 * N
    assert few.series[0].period_s / few.series[0].tick >= 50.0
    model = model_of(one, "coulomb_friction")
    record = model.record(searched(model, STALLS))
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
    other = replace(one, u=np.sin(7.0 * T))
    windows = cut([other])[0]
    same = sparse(windows)
    assert same.windows == windows.windows
    assert len(same.series[0].t) == N


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
    few = sparse(pieces(cut([one])[0])).only((0, 1))
    model = model_of(one, *causes)
    begun = [model.searched(each.values()) for each in cells(few) if each.begins(causes)]
    assert 2 <= len(begun) <= 14
    found = (fit(model, few, x, simulated_states(model, x, few), most=25) for x in begun)
    assert any(excess(each, few) < 1.1 for each in found)


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


def noise_of(kind):
    """Mean log squared error of nothing but the noise."""
    return 2.0 * math.log(NOISE * np.std(recorded(kind)[0].y) / math.hypot(1.0, NOISE))


def test_a_play_that_takes_most_of_the_swing_is_met_between_the_cells():
    both = [each for each in gridded("lost") if each.causes == LOST.keys()]
    assert min(each.cost for each in both) < noise_of("lost") + 0.05


def test_how_the_limit_cycle_grew_tells_the_plants_of_a_valley_apart():
    one = recorded("lost")[0]
    found = cells(Cut((one,), ((0, 1200, 4000), (0, 4000, 6000))))
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


def test_the_speed_at_which_friction_has_fallen_settles():
    """Of plain friction: one that hardly falls within the speeds of the limit cycle."""
    falls = [each for each in gridded("stalls") if each.causes == {"stribeck_friction"}]
    assert min(each.cost for each in falls) < noise_of("stalls") + 0.5


def test_a_command_may_be_measured_in_counts():
    one = recorded("stalls")[0]
    counts = replace(one, u=1e5 * one.u)
    few = sparse(pieces(cut([counts])[0]))
    volts = gridded("stalls")
    for each, same in zip(cells(few), volts, strict=True):
        ratio = each.K_L / same.K_L
        assert ratio == pytest.approx(1e-5, rel=0.02)
        assert each.cost == pytest.approx(same.cost, abs=0.02)


def test_a_plant_that_cannot_be_simulated_ends_no_search(monkeypatch):
    """Of the grid, of the steps from its cells, or of both."""
    few = sparse(pieces(cut([recorded("stalls")[0]])[0]))
    asked = []

    def refused(*given, **named):
        asked.append(given)
        if len(asked) % 5 == 0 or 3700 < len(asked) < 3800:
            raise ValueError("coulomb_friction.level must be within [0, 1e+06]")
        return parameters(*given, **named)

    monkeypatch.setattr("seod.diagnose.stretch.parameters", refused)
    monkeypatch.setattr("seod.diagnose.cells._shaken", lambda _: [])
    assert len(cells(few)) > 20
    assert len(asked) > 3800


def test_a_disturbance_is_tried_by_one_that_a_plant_may_have(monkeypatch):
    stretch = Stretch(sparse(pieces(cut([recorded("locks")[0]])[0])), 88.0)
    (cell, *_) = stretch.cells(150.0, 4.0, {})
    assert cell.omega_n * stretch.omega > 1e6
    found = stretch.shaken(cell).sizes
    monkeypatch.setattr("seod.diagnose.stretch.STRONG", 3e4)
    assert stretch.shaken(cell).sizes == pytest.approx(found, rel=1e-3)


def test_where_in_its_play_a_load_was_at_rest_is_found():
    one = recorded("lost")[0]
    every = Cut([one], ((0, 0, N // 4),))
    model = model_of(one, *LOST)
    x = searched(model, LOST)
    start = begun_states(model, x, every)
    left = one.y[: N // 4] - simulate(model.record(x), every, start)
    assert np.mean(left**2) < 1.2 * math.exp(noise_of("lost"))


def test_other_plants_of_a_valley_are_tried_where_windows_are_fitted_unevenly(monkeypatch):
    one = recorded("lost")[0]
    windows = pieces(cut([one])[0]).only((0, 1))
    model = model_of(one, *LOST)
    far = searched(model, LOST, zeta=0.5)
    truth = Cell(0.0, *TRUTH.values(), 0.0, 0.1, {"coulomb_friction.level": 5000.0, "backlash.gap": 0.3}, {})
    screened = replace(screen(windows, map, Budget(time.process_time, 1e6)), cells=(truth,))
    begun = fit(model, windows, far, simulated_states(model, far, windows), 0)
    ends = []
    for uneven in (False, True):
        monkeypatch.setattr(judge, "_uneven", lambda found, uneven=uneven: uneven)
        ends.append(excess(refined(begun, windows, screened), windows))
    assert ends[1] < 1.1 < ends[0]


@pytest.mark.parametrize(
    ("squares", "uneven"), [((1.0, 1.1), False), ((1.0, 2.0), True), ((3.0, 9.0), False)]
)
def test_windows_are_fitted_unevenly_where_only_some_are_down_to_the_noise(squares, uneven):
    one = recorded("stalls")[0]
    windows = pieces(cut([one])[0]).only((0, 1))
    model = model_of(one)
    x = model.searched(TRUTH)
    found = fit(model, windows, x, simulated_states(model, x, windows), 0)
    told = replace(found, error=np.array(squares) * windows.allowed**2)
    assert judge._uneven(told) is uneven


def test_where_samples_are_missing_there_is_no_plant():
    few = sparse(pieces(cut([recorded("locks")[0]])[0]))
    (one,) = few.series
    none = replace(one, good=np.zeros_like(one.good))
    assert cells(Cut((none,), few.windows)) == ()


def test_a_delay_moves_the_answer_of_the_grid():
    one, _ = recorded("stalls")
    later = replace(one, y=np.roll(one.y, 8))
    found = [each for each in cells(sparse(pieces(cut([later])[0]))) if each.causes == {"coulomb_friction"}]
    late = min((each for each in found if each.delay > 0.0), key=lambda each: each.cost)
    prompt = min((each for each in found if each.delay == 0.0), key=lambda each: each.cost)
    assert late.cost < prompt.cost - 0.3
    assert 0.005 < late.delay < 0.012


def test_a_cell_is_a_start_of_the_sets_that_it_knows():
    prompt = Cell(0.0, 2.0, 30.0, 0.3, 0.0, 0.5, {"coulomb_friction.level": 5.0}, {})
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
    tried = []

    def each(act, some):
        some = list(some)
        from_cells = [one.name for one in some if "*K_L" not in one.start and "K_L" in one.start]
        tried.extend(from_cells)
        return [] if from_cells else [0.0 for _ in some]

    screened = screen(pieces(cut([one])[0]), each, Budget(time.process_time, 1e6))
    model = model_of(one, "coulomb_friction")
    x, few = searched(model, STALLS), screened.cut
    parent = fit(model, few, x, simulated_states(model, x, few), free=np.zeros(len(x), np.bool_))
    assert screened.extended([parent]) == []
    begun = [cell for cell in screened.cells if cell.begins(["coulomb_friction", "lugre_friction"])]
    assert tried.count("lugre_friction") == len(begun) > 0
    assert "periodic_disturbance" not in tried  # none of these cells knows its size


def test_plain_friction_is_also_tried_on_bristles():
    """Where plain friction is far from the truth it is not among the best, nor what is added to it."""
    one, _ = recorded("gives")
    screened = screen(pieces(cut([one])[0]), map, Budget(time.process_time, 1e6))
    model = model_of(one)
    x, few = model.searched(TRUTH), screened.cut
    base = fit(model, few, x, simulated_states(model, x, few))
    best = screened.extended([base], [name for name in EFFECTS if name != "coulomb_friction"])[0]
    assert set(best.model.names) == {"coulomb_friction", "lugre_friction"}
    assert excess(best, few) < 1.1


def test_a_load_as_heavy_as_the_actuator_is_found_from_the_limit_cycles_own_frequency():
    few = pieces(cut([recorded("swings")[0]])[0])
    screened = screen(few, map, Budget(time.process_time, 1e6))
    begun = baseline(screened.cut, False, {})
    assert begun.other is not None
    model = replace(begun.other.model, scales=scales(begun.near, screened.cut))
    x = begun.other.x
    parent = fit(model, screened.cut, x, screened.start(model, x), free=np.zeros(3, np.bool_))
    best = screened.extended([parent], [name for name in EFFECTS if name != "load_resonance"])[0]
    assert excess(best, screened.cut) < 1.05
    assert best.model.values(best.x)["load_resonance.inertia"] == pytest.approx(1.0, rel=0.3)


def test_the_best_fits_settle_where_steps_along_a_bent_valley_gain_little():
    one = recorded("swings")[0]
    screened = screen(pieces(cut([one])[0]), map, Budget(time.process_time, 1e6))
    model, ends = model_of(one, "load_resonance"), []
    for inertia, omega in ((1.5, 168.0), (0.6, 221.0)):
        x = searched(model, {"load_resonance": {"inertia": inertia, "omega": omega, "zeta": 0.05}})
        begun = fit(model, screened.cut, x, simulated_states(model, x, screened.cut), 3)
        ends.append([act(begun, screened.every, screened).x for act in (refined, settled)])
    (early, one_end), (late, other_end) = ends
    assert np.abs(early - late).max() > 0.03
    assert np.abs(one_end - other_end).max() < 1e-3


def test_only_a_relay_has_cells():
    one, _ = recorded("stalls")
    budget = Budget(time.process_time, 1e6)
    assert screen(cut([one])[0], map, budget).cells
    assert not screen(cut([replace(one, u=np.sin(7.0 * T))])[0], map, budget).cells


def test_what_is_but_a_gain_of_two_commands_is_not_tried():
    sizes = Scales(1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 10.0, 1.0, 1e-3)
    assert set(searched_causes(sizes)) >= GAINS
    assert not set(searched_causes(replace(sizes, relayed=True))) & GAINS


def test_a_relay_s_plant_is_not_damped_beyond_what_shows():
    one, _ = recorded("stalls")
    found = screen(cut([one])[0], map, Budget(time.process_time, 1e6))
    assert baseline(found.cut, False, {}).best.model.scales.damped == DAMPED_BY_RELAY


def test_states_are_carried_on_where_one_reading_has_several_places():
    one, places = recorded("waves")
    model = model_of(one, "position_ripple")
    x = searched(model, WAVES)
    fitted, aside = cut([one])
    start = measured_places(fitted)
    start[:, 2] = places[[first for _, first, _ in fitted.windows]]
    found = Fitted(
        model, fitted, x, settle(model, fitted, x, start, fitted.good, 20), *(np.empty(0),), 0.0, np.empty(0)
    )
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
    held = simulate(model.record(found.x), aside, alike_states(spoiled, aside))
    truth = one.y[aside.windows[0][1] : aside.windows[0][2]]
    assert np.abs(held[aside.slices[0]] - truth).mean() < 0.03 * np.std(truth)
    blind = simulate(model.record(found.x), aside, carried_states(spoiled, aside))
    assert np.abs(blind[aside.slices[0]] - truth).mean() > np.std(truth)


def test_each_window_takes_the_state_that_leaves_less():
    one, _ = recorded("stalls")
    model, windows = model_of(one, "coulomb_friction"), pieces(cut([one])[0])
    x = searched(model, STALLS)
    good = settle(model, windows, x, simulated_states(model, x, windows), windows.good)
    bad = good + np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    mixed, other = good.copy(), bad.copy()
    mixed[0], other[0] = bad[0], good[0]
    assert np.array_equal(best_states(model, x, windows, mixed, other), good)


def test_the_valley_between_friction_and_plant_is_followed():
    one, _ = recorded("stalls")
    model = model_of(one, "coulomb_friction")
    few = sparse(pieces(cut([one])[0]))
    x = searched(model, {"coulomb_friction": {"level": 4000.0}}, K_L=5.0, omega_n=150.0, zeta=0.06)
    found = fit(model, few, x, simulated_states(model, x, few), most=15)
    assert excess(found, few) < 1.22  # 1.28 without initial states looked for


def test_the_grid_takes_no_time_from_the_search(monkeypatch):
    now = [0.0]
    budget = Budget(lambda: now[0], 10.0)

    def slow(_):
        now[0] += 9.0
        return ()

    monkeypatch.setattr("seod.diagnose.screen.cells", slow)
    screen(pieces(cut([recorded("stalls")[0]])[0]), map, budget)
    now[0] += 9.0
    assert not budget.spent
    now[0] += 2.0
    assert budget.spent
