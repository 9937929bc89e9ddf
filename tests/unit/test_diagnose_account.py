"""What is left of a movement: systematic, or noise of whatever colour. The truth is integrated here."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from account_truth import (
    OMEGA_N,
    PERIOD,
    ZETA,
    N,
    by_heun,
    coloured,
    fitted_lag,
    moved,
    multisine,
    noise_command,
    parts_of,
)
from diagnose_truth import RATE, linear, recording
from scipy.signal import lfilter

from seod.diagnose.account.account import Shown, accounted
from seod.diagnose.account.black_box import foretold
from seod.diagnose.account.black_box_terms import free_movements
from seod.diagnose.account.residual import (
    Plant,
    mean_square,
    not_repeated,
    window_residuals,
)
from seod.diagnose.account.yardstick import beaten, yardstick
from seod.diagnose.causes.base import LEAST_DAMPING
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.noise_colour import NoiseColour
from seod.diagnose.fitting.repeats import repeats
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.command_period import finer_period_s
from seod.diagnose.record.series import series
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.record.windows import Cut, cut
from seod.diagnose.search.budget import EFFORTS

PLANT = Plant(OMEGA_N, ZETA, sees_speed=False)


@pytest.fixture(scope="module", params=["multisine", "noise"])
def driven(request):
    """A command, what Eq. 1 makes of it, and what a drag changes."""
    u = multisine() if request.param == "multisine" else noise_command()
    plain, dragged = moved(u), moved(u, drag=0.2)
    return u, plain, dragged[2] - plain[2]


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.95, 0.99])
def test_noise_of_any_colour_is_not_systematic(driven, memory):
    u, states, effect = driven
    noise = coloured(memory, float(np.std(effect)))
    parts = parts_of(u, noise, states)
    assert not foretold(parts, PLANT, in_loop=False).share.significant
    again = repeats([series(recording(u, states[2] + noise))], parts)
    assert again is None or not again.significant


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.95])
def test_what_is_missing_is_systematic(driven, memory):
    u, states, effect = driven
    error = np.concatenate([each - each.mean() for each in np.split(effect, 8)])
    parts = parts_of(u, error + coloured(memory, 0.1 * float(np.std(error))), states)
    box = foretold(parts, PLANT, in_loop=False)
    rest = mean_square([one for one in box.rest if one.held_out])
    assert box.share.significant
    assert rest < 0.25 * box.share.square


def test_a_measured_force_that_acts_later_than_the_model_has_it_is_systematic():
    """A filter of 20 ms: with the gain 27 % too low all that was left passed for gusts on the load."""
    f = noise_command(9)
    late = lfilter([1.0 - math.exp(-1.0 / 20.0)], [1.0, -math.exp(-1.0 / 20.0)], f)

    def slope(w, push):
        p, v, _ = w
        return np.array([-(OMEGA_N**2) * v - 2.0 * ZETA * OMEGA_N * p, p + 100.0 * push, v])

    left = by_heun(slope, late - 0.7 * f)[2]
    error = np.concatenate([each - each.mean() for each in np.split(left, 8)])
    u = multisine()
    parts = parts_of(u, error + coloured(0.9, 0.1 * float(np.std(error))), moved(u))
    seen = [replace(one, force=force) for one, force in zip(parts, np.split(f, 8), strict=True)]
    box = foretold(seen, PLANT, in_loop=False)
    assert box.share.significant
    assert mean_square([one for one in box.rest if one.held_out]) < 0.5 * box.share.square
    assert not foretold(parts, PLANT, in_loop=False).share.significant


@pytest.mark.slow
def test_a_drift_that_does_not_repeat_hides_no_force():
    """What random forces moved stays moved: in a window twice as far as a drag does."""
    u = multisine()
    states = moved(u)
    drag = moved(u, drag=0.2)[2] - states[2]
    drag = np.concatenate([each - each.mean() for each in np.split(drag, 8)])
    random = np.random.default_rng(8)
    drift = np.cumsum(lfilter([1.0], [1.0, -0.98], random.normal(size=(8, N // 8)), axis=1), axis=1)
    drift = np.concatenate([each - each.mean() for each in drift])
    noise = 2.0 * np.std(drag) / np.std(drift) * drift + 0.1 * np.std(drag) * random.normal(size=N)
    assert not foretold(parts_of(u, noise, states), PLANT, in_loop=False).share.significant
    share = foretold(parts_of(u, noise + drag, states), PLANT, in_loop=False).share
    assert share.significant
    assert 0.5 * np.var(drag) < share.square < 2.0 * np.var(drag)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.95, 0.99])
def test_what_would_have_been_shown_is_known_before_it_is_there(driven, memory):
    """Noise alone tells how small a drag is found beside it; beside coloured noise a small one is not."""
    u, states, effect = driven
    drag = np.concatenate([each - each.mean() for each in np.split(effect, 8)])
    drag /= np.std(drag)
    noise = coloured(memory, 1.0)
    box = foretold(parts_of(u, noise, states), PLANT, in_loop=False)
    assert not box.share.significant

    def shown(part):
        return foretold(
            parts_of(u, noise + np.sqrt(part) * drag, states), PLANT, in_loop=False
        ).share.significant

    assert not math.isfinite(box.detectable) or shown(4.0 * box.detectable)
    assert not memory or not shown(0.0625)


@pytest.mark.slow
def test_chance_is_known_by_noise_of_the_same_colour(driven):
    """A limit that noise itself would pass, or never come near, is none."""
    u, states, _ = driven
    shares = [
        foretold(parts_of(u, coloured(0.9, 1.0, seed), states), PLANT, in_loop=False).share
        for seed in range(20, 28)
    ]
    assert not any(one.significant for one in shares)
    scores = np.array([one.score for one in shares])
    limit = np.mean([one.limit for one in shares])
    assert 1.5 < (limit - scores.mean()) / scores.std(ddof=1) < 7.0


@pytest.mark.parametrize("sees_speed", [True, False])
def test_what_is_free_in_a_window_is_counted_once(sees_speed):
    """A direction more would be one of rounding, another in each unit."""
    columns = free_movements(300, Plant(OMEGA_N, ZETA, sees_speed), OMEGA_N / RATE)
    assert columns.shape == (300, 3)
    assert np.linalg.cond(columns / np.linalg.norm(columns, axis=0)) < 1e6


@pytest.mark.parametrize("signed", [True, False])
def test_what_is_asked_of_a_speed_is_where_its_readings_say_that_the_load_is(signed):
    """A model whose speed is off lets the load drift away; the bend that is left is the model's."""
    n = 400
    t = np.arange(n) / RATE
    y = np.cos(9.0 * t) if signed else 1.5 + np.cos(9.0 * t)
    one = series(recording(np.sin(5.0 * t), y), np.zeros(n, np.bool_), sees_speed=True)
    place = one.travelled
    off, wave = 0.7 * (t - t[0]) + 0.2, 0.01 * np.sin(40.0 * t)
    states = np.column_stack([np.zeros(n), y, place + off + wave, place, np.zeros(n)])
    some = np.ones(n, np.bool_)
    cut = Cut([one], ((0, 0, 200), (0, 200, n)))
    held = SimpleNamespace(cut=cut, states=states, error=np.zeros(n), scored=some, sure=some)
    found = np.concatenate([each.position for each in window_residuals(held, held_out=True)])
    expected = place + wave if signed else states[:, 2]
    assert np.max(np.abs(found - expected)) < (0.006 if signed else 1e-12)  # the wave has a line of its own


@pytest.mark.slow
def test_slow_noise_in_few_windows_could_hide_anything():
    u = noise_command()
    box = foretold(parts_of(u, coloured(0.99, 1.0), moved(u)), PLANT, in_loop=False)
    assert not box.share.significant
    assert box.detectable > 0.25


@pytest.mark.slow
def test_two_windows_held_out_are_enough(driven):
    u, states, effect = driven
    error = np.concatenate([each - each.mean() for each in np.split(effect, 4)])
    parts = parts_of(u, error + coloured(0.98, 0.6 * float(np.std(error))), states, 4)
    share = foretold(parts, PLANT, in_loop=False).share
    assert share.significant
    assert share.square < mean_square([one for one in parts if one.held_out])


def test_what_repeats_with_the_command_is_told_by_its_size():
    u = multisine()
    states, wave = moved(u), 0.3 * np.sin(2.0 * np.pi * 7.0 * np.arange(N) / PERIOD)
    parts = parts_of(u, wave + coloured(0.95, 0.1), states)
    every = [series(recording(u, states[2]))]
    again = repeats(every, parts)
    assert again.significant
    assert again.square == pytest.approx(0.3**2 / 2.0, rel=0.2)
    assert mean_square(not_repeated(every, parts)) < 0.4 * mean_square(parts)
    slower = 0.3 * np.sin(2.0 * np.pi * 7.37 * np.arange(N) / PERIOD)
    assert not repeats(every, parts_of(u, slower, states)).significant


def test_a_command_that_does_not_repeat_has_nothing_to_compare():
    u = noise_command()
    states = moved(u)
    assert repeats([series(recording(u, states[2]))], parts_of(u, states[2], states)) is None


def test_a_period_is_told_to_a_part_of_a_sample():
    t = np.arange(20000) / RATE
    u = np.sign(np.sin(2.0 * np.pi * t / 1.2343)) + 0.3 * np.sin(6.0 * np.pi * t / 1.2343)
    assert finer_period_s(t, u, 1.2343 * 1.0005) == pytest.approx(1.2343, abs=0.1 / RATE)


def test_models_without_physics_come_near_a_linear_plant():
    u = noise_command()
    halves = cut([series(recording(u, moved(u)[2]))])
    reached = yardstick(*halves)
    assert min(reached.arx, reached.narx) < 0.1
    assert len(reached.simulated) == len(halves[1].gathered("y"))
    assert yardstick(*(part.only([0]) for part in halves)) is not None


@pytest.mark.slow
@pytest.mark.timeout(400)  # a whole diagnosis, on a busy machine
def test_coloured_noise_is_no_cause(monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", 0.05)  # the blind tests search on; here the account is asked for
    u = multisine()
    y = linear(u)
    record = replace(recording(u, y), y=y + coloured(0.95, 0.02 * float(np.std(y))))
    told = diagnose([record], (), Options(effort="quick"))
    assert (told.verdict, told.effects, told.grade) == ("clean", (), "down_to_noise")
    answer = json.loads(json.dumps(told.as_json()))
    parts = answer["account"]
    assert parts["explained"] + parts["systematic"] + parts["not_repeatable"] == pytest.approx(1.0)
    assert parts["systematic"] == 0.0
    assert parts["noise"]["order"] >= 1
    assert answer["noise_floor_nrmse"] == pytest.approx(answer["extended"]["holdout_nrmse"], rel=0.02)
    assert answer["yardstick"]["arx"] < 0.2


def test_a_sweep_is_told_from_what_goes_on_alike():
    t = np.arange(N) / RATE
    faster = np.sin(2.0 * np.pi * (0.5 + 0.4 * t) * t)
    assert sweeps(t, faster)
    assert sweeps(t, (0.2 + t) * np.sin(2.0 * np.pi * 3.0 * t))
    assert not sweeps(t, np.sin(2.0 * np.pi * 3.0 * t))
    assert not sweeps(t, multisine())
    assert not sweeps(t, noise_command())
    assert not sweeps(t, np.zeros(N))


@pytest.fixture(scope="module")
def lagging():
    return fitted_lag()


@pytest.mark.parametrize(
    ("size", "detectable", "chance"),
    [
        (0.5, 0.5, 0.002),
        (0.5, 1.0, 0.002),
        (0.5, float("inf"), 0.05),
        (0.0, float("inf"), 0.002),
    ],
)
def test_less_is_asked_of_arx_where_nothing_else_would_have_shown(
    lagging, monkeypatch, size, detectable, chance
):
    asked, rest = [], NoiseColour((), 0.0, 1.0)

    def noted(*arguments, chance, **how):
        asked.append(chance)
        return beaten(*arguments, chance=chance, **how)

    shown = Shown(0.0, "nothing", rest, asked=True, detectable=detectable)
    monkeypatch.setattr("seod.diagnose.account.account.systematic", lambda *_, **__: shown)
    monkeypatch.setattr("seod.diagnose.account.account.beaten", noted)
    off = lagging.x + np.where(np.array([c.place for c in lagging.model.coordinates]) == "K_L", size, 0.0)
    held = simulate_held_out(lagging.model, off, lagging.cut)
    accounted(lagging, held, held, held)
    assert asked == [chance]


@pytest.mark.parametrize(
    ("numbers", "asked"),
    [({}, True), ({"zeta": 0.0012}, False), ({"zeta": LEAST_DAMPING}, False), ({"zeta": 0.05}, True)],
)
def test_of_a_plant_that_rings_through_its_windows_nothing_is_known(lagging, monkeypatch, numbers, asked):
    """Its oscillation begins anew in each, and may stand for anything."""
    shown = Shown(0.0, "nothing", NoiseColour((), 0.0, 1.0), asked=True, detectable=0.1)
    monkeypatch.setattr("seod.diagnose.account.account.systematic", lambda *_, **__: shown)
    monkeypatch.setattr("seod.diagnose.account.account.yardstick", lambda *_: None)
    held = simulate_held_out(lagging.model, lagging.x, lagging.cut)
    off = lagging.model.searched(lagging.model.values(lagging.x) | numbers)
    told, _ = accounted(replace(lagging, x=off), held, held, held)
    assert told.asked == asked


@pytest.mark.slow
def test_windows_too_short_for_the_noises_memory_are_asked_as_if_it_were_white():
    """Holes leave no row with all of its past in one of them."""
    u = multisine()
    parts = parts_of(u, coloured(0.95, 1.0), moved(u))
    holes = replace(parts[0], scored=parts[0].scored & (np.arange(len(parts[0].t)) % 4 > 0))
    assert foretold([holes, *parts[1:]], PLANT, in_loop=False) is not None
