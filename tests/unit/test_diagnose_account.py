"""What is left of a movement: systematic, or noise of whatever colour. The truth is integrated here."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnose_truth import RATE, linear, recording
from scipy.signal import freqz, lfilter

from seod.diagnose.account.account import Shown, accounted
from seod.diagnose.account.black_box import _free, foretold
from seod.diagnose.account.grade import graded
from seod.diagnose.account.residual import (
    Plant,
    WindowResidual,
    mean_square,
    not_repeated,
    window_residuals,
)
from seod.diagnose.account.yardstick import beaten, yardstick
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.noise_colour import NoiseColour, colour
from seod.diagnose.fitting.repeats import repeats
from seod.diagnose.fitting.uncertainty import at_limits, covariance, p_value, reaches_null
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.command_period import finer_period_s
from seod.diagnose.record.series import series
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.record.windows import Cut, cut
from seod.diagnose.result import Account, Unexplained
from seod.diagnose.search.budget import EFFORTS
from seod.diagnose.starts.baseline import _rough
from seod.diagnose.verdict.unexplained import systematic_part

K_L, OMEGA_N, ZETA = 17.0, 60.0, 0.4
PERIOD = 1000
"""Of the multisine [samples]."""
N = 8 * PERIOD


def multisine(seed=1):
    t, random = np.arange(N) / RATE, np.random.default_rng(seed)
    lines = np.arange(1, 40) * RATE / PERIOD
    u = np.cos(2.0 * np.pi * np.outer(t, lines) + random.uniform(0.0, 6.3, len(lines))).sum(axis=1)
    return u / np.max(np.abs(u))


def noise_command(seed=2):
    u = lfilter([1.0], [1.0, -0.97], np.random.default_rng(seed).normal(size=N))
    return u / np.max(np.abs(u))


def coloured(memory, sd, seed=3):
    white = np.random.default_rng(seed).normal(size=N + 3000)
    return sd * np.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], white)[3000:]


def moved(u, drag=0.0):
    """Pressure, velocity and position of Eq. 1 with a force against the square of speed, by Heun's method."""
    h, w = 1.0 / RATE / 4.0, np.zeros(3)
    out = np.empty((len(u), 3))

    def slope(w, volts):
        p, v, _ = w
        brakes = drag * v * abs(v)
        return np.array([OMEGA_N**2 * (K_L * volts - v) - 2.0 * ZETA * OMEGA_N * p, p - brakes, v])

    for k, volts in enumerate(u):
        out[k] = w
        for _ in range(4):
            first = slope(w, volts)
            w = w + 0.5 * h * (first + slope(w + h * first, volts))
    return out.T


def parts_of(u, error, states, count=8):
    """Windows of what is left; every other one is held out, the first fifth is not scored."""
    t, n = np.arange(N) / RATE, N // count
    scored = np.arange(n) >= n // 5
    return [
        WindowResidual(
            0, t[a : a + n], u[a : a + n], error[a : a + n], scored, *states[:, a : a + n], bool(k % 2)
        )
        for k, a in enumerate(range(0, N, n))
    ]


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
    assert not foretold(parts, PLANT).share.significant
    again = repeats([series(recording(u, states[2] + noise))], parts)
    assert again is None or not again.significant


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.95])
def test_what_is_missing_is_systematic(driven, memory):
    u, states, effect = driven
    error = np.concatenate([each - each.mean() for each in np.split(effect, 8)])
    parts = parts_of(u, error + coloured(memory, 0.1 * float(np.std(error))), states)
    box = foretold(parts, PLANT)
    rest = mean_square([one for one in box.rest if one.held_out])
    assert box.share.significant
    assert rest < 0.25 * box.share.square


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
    assert not foretold(parts_of(u, noise, states), PLANT).share.significant
    share = foretold(parts_of(u, noise + drag, states), PLANT).share
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
    box = foretold(parts_of(u, noise, states), PLANT)
    assert not box.share.significant

    def shown(part):
        return foretold(parts_of(u, noise + np.sqrt(part) * drag, states), PLANT).share.significant

    assert not math.isfinite(box.detectable) or shown(4.0 * box.detectable)
    assert not memory or not shown(0.0625)


@pytest.mark.parametrize("memory", [(), (0.95,), (0.5, 0.3, 0.1)])
def test_noise_is_drawn_with_its_colour(memory):
    drawn = NoiseColour(memory, 1.0, 1.0).drawn(40_000, 3, np.random.default_rng(1))
    past = np.array([drawn[3 - k : -k] for k in range(1, 4)]).reshape(3, -1)
    found = np.linalg.lstsq(past.T, drawn[3:].ravel(), rcond=None)[0]
    assert found == pytest.approx([*memory, 0.0, 0.0, 0.0][:3], abs=0.02)


def test_noise_whose_fit_grows_does_not():
    assert np.abs(NoiseColour((1.01,), 1.0, math.inf).drawn(3000, 3, np.random.default_rng(1))).max() < 1e3


@pytest.mark.slow
def test_chance_is_known_by_noise_of_the_same_colour(driven):
    """A limit that noise itself would pass, or never come near, is none."""
    u, states, _ = driven
    shares = [foretold(parts_of(u, coloured(0.9, 1.0, seed), states), PLANT).share for seed in range(20, 28)]
    assert not any(one.significant for one in shares)
    scores = np.array([one.score for one in shares])
    limit = np.mean([one.limit for one in shares])
    assert 1.5 < (limit - scores.mean()) / scores.std(ddof=1) < 7.0


@pytest.mark.parametrize("sees_speed", [True, False])
def test_what_is_free_in_a_window_is_counted_once(sees_speed):
    """A direction more would be one of rounding, another in each unit."""
    columns = _free(300, Plant(OMEGA_N, ZETA, sees_speed), OMEGA_N / RATE)
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
    box = foretold(parts_of(u, coloured(0.99, 1.0), moved(u)), PLANT)
    assert not box.share.significant
    assert box.detectable > 0.25


@pytest.mark.slow
def test_two_windows_held_out_are_enough(driven):
    u, states, effect = driven
    error = np.concatenate([each - each.mean() for each in np.split(effect, 4)])
    parts = parts_of(u, error + coloured(0.98, 0.6 * float(np.std(error))), states, 4)
    share = foretold(parts, PLANT).share
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


@pytest.mark.parametrize(("memory", "order"), [(0.0, 0), (0.95, 1), (0.99, 1)])
def test_the_colour_of_noise_is_found(memory, order):
    noise = coloured(memory, 0.2)
    found = colour(parts_of(noise, noise, np.zeros((3, N))))
    assert found.order == order
    assert found.sd == pytest.approx(0.2, rel=0.25)
    assert found.correlation == pytest.approx((1.0 + memory) / (1.0 - memory), rel=0.3)


def pieces_of(noise, count):
    """Noise as what is left of so many windows."""
    pieces = np.split(noise[: len(noise) // count * count], count)
    return [WindowResidual(0, each, each, each, each < np.inf, each, each, each, False) for each in pieces]


@pytest.mark.parametrize("of_sensor", [0.0, 0.2, 2.0])
def test_of_a_load_s_noise_below_a_sensor_s_all_is_foretold_that_can_be(of_sensor):
    """What no past foretells has the mean log spectrum's power (Kolmogorov)."""
    poles = np.array([0.999, 0.97 * np.exp(0.12j), 0.97 * np.exp(-0.12j)])
    a, random = np.real(np.poly(poles)), np.random.default_rng(5)
    load = lfilter([1e-3], a, random.normal(size=3 * N))
    noise = load + of_sensor * random.normal(size=3 * N)
    parts = pieces_of(noise, 4)
    omega = np.linspace(1e-5, np.pi, 200_001)
    power = np.abs(freqz([1e-3], a, omega)[1]) ** 2 + of_sensor**2
    least = np.exp(0.5 * np.mean(np.log(power)))
    found = colour(parts)
    white = np.concatenate([found.whitened(one.error)[found.order :] for one in parts])
    assert np.std(white) == pytest.approx(least, rel=0.01)
    drawn = np.std(white) * found.drawn(3 * N, 8, np.random.default_rng(6))
    assert np.std(np.diff(drawn, axis=0)) == pytest.approx(np.std(np.diff(noise)), rel=0.05)
    assert found.order < 8 if of_sensor == 0.0 else found.order > 8


def test_short_windows_keep_their_rows_for_short_memories():
    noise = np.concatenate([coloured(0.95, 0.2, seed) for seed in range(4)])
    assert colour(pieces_of(noise, len(noise) // 40)).memory[0] == pytest.approx(0.95, abs=0.08)


def scored_again(parts, scored):
    """The same windows, other rows of which count."""
    return [replace(one, scored=scored) for one in parts]


@pytest.mark.parametrize("count", [1, 8])
def test_the_colour_of_noise_is_found_across_holes(count):
    """Alternating noise: rows on both sides of a hole of one row are alike, neighbours are not."""
    noise = coloured(-0.9, 0.2)
    parts = parts_of(noise, noise, np.zeros((3, N)), count)
    scored = np.arange(N // count) % 20 != 0
    found = colour(scored_again(parts, scored))
    assert found.order == 1
    assert found.memory[0] == pytest.approx(-0.9, abs=0.03)


def test_a_sensor_that_repeats_readings_has_neighbours():
    readings = coloured(0.9, 0.2)[: N // 4]
    parts = parts_of(readings, np.repeat(readings, 4), np.zeros((3, N)))
    found = colour(scored_again(parts, np.arange(N // 8) % 4 == 0))
    assert found.memory == pytest.approx((0.9,), abs=0.05)


@pytest.mark.parametrize("kept", [lambda k: k < 8, lambda k: k % 3 == 0], ids=["few rows", "rows apart"])
def test_noise_of_rows_that_foretell_none_is_white(kept):
    """Half of the windows count in full, half hardly at all."""
    noise = coloured(0.9, 0.2)
    parts = parts_of(noise, noise, np.zeros((3, N)), 100)
    few = kept(np.arange(N // 100)) & (np.arange(N // 100) % 9 > 0)
    for first in (0, 1):
        some = [replace(one, scored=few) if k % 2 == first else one for k, one in enumerate(parts)]
        assert colour(some).order == 0


def test_models_without_physics_come_near_a_linear_plant():
    u = noise_command()
    halves = cut([series(recording(u, moved(u)[2]))])
    reached = yardstick(*halves)
    assert min(reached.arx, reached.narx) < 0.1
    assert len(reached.simulated) == len(halves[1].gathered("y"))
    assert yardstick(*(part.only([0]) for part in halves)) is not None


def account(systematic, remains=0.2, nrmse=0.1, detectable=0.01):
    parts = 1.0 - remains, systematic, remains - systematic
    return Account(*parts, nrmse, detectable_nrmse=detectable)


@pytest.mark.parametrize(
    ("before", "after", "adequacy", "parts", "grade"),
    [
        (1.6, 1.2, 9.0, account(0.1), "useless"),
        (0.4, 0.4, 9.0, account(0.1), "useless"),
        (0.4, 0.2, 9.0, account(0.1), "partly"),
        (0.4, 0.2, 9.0, account(0.0, nrmse=0.0), "down_to_noise"),
        (0.4, 0.2, 9.0, replace(account(0.0, nrmse=0.0), asked=False), "partly"),
        (0.4, 0.2, 9.0, account(0.0, nrmse=0.0, detectable=0.15), "partly"),
        (0.4, 0.2, 9.0, account(0.0, nrmse=0.0, detectable=float("inf")), "partly"),
        (0.4, 0.04, 9.0, account(0.0, nrmse=0.0, detectable=0.03), "partly"),
        (0.4, 0.02, 9.0, account(0.0, nrmse=0.0, detectable=0.03), "good_for_design"),
        (0.4, 0.4, 9.0, account(0.0, nrmse=0.0), "down_to_noise"),
        (0.2, 0.4, 9.0, account(0.0, nrmse=0.0), "useless"),
        (0.4, 0.2, 1.1, account(0.0, nrmse=0.0), "down_to_noise"),
        (0.4, 0.2, 1.1, account(0.0, nrmse=0.0, detectable=float("inf")), "down_to_noise"),
        (0.4, 0.04, 9.0, account(0.01, nrmse=0.015), "good_for_design"),
        (0.4, 0.04, 9.0, account(0.01, nrmse=0.025), "partly"),
        (0.04, 0.04, 9.0, account(0.01, nrmse=0.015), "good_for_design"),
        (0.4, 0.04, 9.0, None, "good_for_design"),
        (float("nan"), float("inf"), 9.0, None, "useless"),
    ],
)
def test_a_model_is_graded(before, after, adequacy, parts, grade):
    nothing = after <= 0.04 and parts is None
    parts = account(0.0, nrmse=0.01) if nothing else parts
    assert graded(before, after, adequacy, parts) == grade


@pytest.mark.parametrize(("relevance", "fraction"), [(0.05, 0.0), (0.02, 0.03 / 0.9), (0.0, 0.03 / 0.9)])
def test_unexplained_is_what_is_systematic_and_relevant(relevance, fraction):
    left = Unexplained(0.8, ("velocity",), {"velocity": 0.4})
    told = Account(0.87, 0.03, 0.1, 0.03)
    found = systematic_part(left, told, 0.1, relevance, named=True)
    assert found.fraction == pytest.approx(fraction)
    assert bool(found.correlates_with) == (fraction > 0.0)
    for unasked in (None, replace(told, asked=False)):
        assert systematic_part(left, unasked, 0.1, relevance, named=True) == left
        assert systematic_part(left, unasked, 0.01, 0.02, named=True).fraction == 0.0
    assert systematic_part(Unexplained(0.0), told, 0.1, 0.0, named=True).fraction == 0.0


def test_what_simulates_no_better_than_a_mean_leaves_no_noise():
    left, noise_alone = Unexplained(0.8), Account(0.2, 0.0, 0.8, 0.0)
    assert systematic_part(left, noise_alone, 0.99, 0.02, named=True).fraction == 0.0
    assert systematic_part(left, noise_alone, 1.0, 0.02, named=True) == left


@pytest.mark.parametrize(
    ("named", "rest", "detectable", "fraction"),
    [
        (False, 0.9, float("inf"), 0.8),
        (False, 0.06, 0.07, 0.8),
        (False, 0.06, 0.06, 0.0),
        (False, 0.04, float("inf"), 0.0),
        (True, 0.9, float("inf"), 0.0),
    ],
)
def test_eq_1_is_right_only_where_something_else_would_have_shown(named, rest, detectable, fraction):
    told = replace(Account(0.2, 0.0, 0.8, 0.0), detectable_nrmse=detectable)
    assert systematic_part(Unexplained(0.8), told, rest, 0.02, named=named).fraction == fraction


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
    """A fit of a plant whose valve lags, by its true numbers; the lag's standard deviation is [s]."""
    u = multisine()
    to_fit, _ = cut([series(recording(u, linear(u, lag=0.004), noise=0.001))])
    model = baseline_model(_rough(to_fit, 117.0), 1.0, False, {}).with_effect("valve_lag")
    x = model.searched({"K_L": 17.0, "omega_n": 117.0, "zeta": 0.3, "valve_lag.time": 0.004})
    return fit(model, to_fit, x, simulated_states(model, x, to_fit))


def test_a_size_that_may_be_none_is_no_cause(lagging):
    spread = covariance(lagging)
    assert not reaches_null(lagging, "valve_lag", spread, 1)
    k = [c.place for c in lagging.model.coordinates].index("valve_lag.time")
    sure = spread[k, k]
    vague = spread.copy()
    vague[k, k] = sure * (0.7 * lagging.x[k] / np.sqrt(sure)) ** 2
    assert reaches_null(lagging, "valve_lag", vague, 1)
    vague[k, k] = (0.4 * lagging.x[k]) ** 2  # 2.5 standard deviations: the largest of 24 by chance
    assert not reaches_null(lagging, "valve_lag", vague, 1)
    assert reaches_null(lagging, "valve_lag", vague, 24)
    at_none = replace(lagging, x=np.where(np.arange(4) == k, lagging.model.bounds[0], lagging.x))
    assert reaches_null(at_none, "valve_lag", spread, 1)
    assert at_limits(at_none) == []
    far = replace(lagging, x=np.where(np.arange(4) == k, lagging.model.bounds[1], lagging.x))
    assert not reaches_null(far, "valve_lag", spread, 1)
    assert at_limits(far) == ["valve_lag.time"]


def test_a_cause_of_several_sizes_may_be_none_only_if_all_of_them_may(lagging):
    """Of a sensor that never saw the other sign only the power is known."""
    model = lagging.model.without("valve_lag").with_effect("rectified_sensor")
    x = model.searched(
        {
            "K_L": 17.0,
            "omega_n": 117.0,
            "zeta": 0.3,
            "rectified_sensor.part": 0.9,
            "rectified_sensor.power": 1.3,
        }
    )
    fitted = replace(lagging, model=model, x=x)
    places = [c.place for c in model.coordinates]
    part, power = (places.index(f"rectified_sensor.{of}") for of in ("part", "power"))

    def spread(of_part, of_power):
        out = 1e-8 * np.eye(len(x))
        out[part, part], out[power, power] = of_part**2, of_power**2
        return out

    assert not reaches_null(fitted, "rectified_sensor", spread(9.0, 0.02), 1)
    assert not reaches_null(fitted, "rectified_sensor", spread(0.02, 9.0), 1)
    assert reaches_null(fitted, "rectified_sensor", spread(9.0, 9.0), 1)


def test_an_interval_is_never_of_no_width(lagging):
    """A fit that ended before its first step has no curvature."""
    ended = replace(lagging, curvature=np.zeros_like(lagging.curvature))
    np.testing.assert_allclose(
        np.sqrt(covariance(ended).diagonal()), np.sqrt(covariance(lagging).diagonal()), rtol=0.05
    )


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


def test_chance_counts_as_often_as_causes_were_tried(lagging):
    held = simulate_held_out(lagging.model, lagging.x, lagging.cut)
    worse = replace(held, simulated=held.simulated + 1e-4 * np.sin(np.arange(len(held.simulated)) / 50.0))
    once = p_value(worse, held)
    assert 0.0 < once < 0.9
    assert p_value(worse, held, 7) == pytest.approx(min(1.0, 7.0 * once))


@pytest.mark.slow
def test_windows_too_short_for_the_noises_memory_are_asked_as_if_it_were_white():
    """Holes leave no row with all of its past in one of them."""
    u = multisine()
    parts = parts_of(u, coloured(0.95, 1.0), moved(u))
    holes = replace(parts[0], scored=parts[0].scored & (np.arange(len(parts[0].t)) % 4 > 0))
    assert foretold([holes, *parts[1:]], PLANT) is not None
