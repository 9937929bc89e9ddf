"""Which effects leave a set again."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from seod.diagnose.fitting.uncertainty import may_be_chance, p_value
from seod.diagnose.search import prune
from seod.diagnose.tuning.search import PRUNE

SCREEN = SimpleNamespace(parallel=map)


def judged(cost, nrmse=0.5, held=None, whole=None, adequacy=1.0, sees_speed=False, relayed=False):
    held = SimpleNamespace(nrmse=nrmse, log_error=cost if held is None else held, adequacy=adequacy)
    whole = nrmse if whole is None else whole
    model, cut = SimpleNamespace(sees_speed=sees_speed), SimpleNamespace(relayed=relayed)
    found = SimpleNamespace(cost=cost, model=model, cut=cut)
    return SimpleNamespace(found=found, held=held, whole=whole)


@pytest.fixture
def no_chance(monkeypatch):
    monkeypatch.setattr(prune, "_gains_by_chance", lambda *_: False)
    monkeypatch.setattr(prune, "is_at_null", lambda *_: False)


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize("at_null", [False, True])
def test_a_size_at_its_least_is_none_whatever_it_saves(monkeypatch, at_null):
    """A second inertia of a thousandth and hardly any damping is a line of the mains."""
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: True)
    monkeypatch.setattr(prune, "is_at_null", lambda *_: at_null)
    own, rest = judged(-3.0, 0.1), judged(-3.0 + 1.1 * PRUNE.surely)
    assert (prune._unidentified(own, {"load_resonance": rest}, 1.0, SCREEN) == [rest]) is at_null


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize(
    ("saves", "leaves"),
    [
        pytest.param(0.9 * PRUNE.surely, True, id="its interval reaches none"),
        pytest.param(1.1 * PRUNE.surely, False, id="it saves too much to be none"),
    ],
)
def test_a_linear_interval_does_not_outweigh_what_an_effect_saves(monkeypatch, saves, leaves):
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: True)
    own, rest = judged(-3.0, 0.1), judged(-3.0 + saves)
    assert (prune._unidentified(own, {"load_spring": rest}, 1.0, SCREEN) == [rest]) is leaves


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize(("held", "leaves"), [(0.8, True), (3.0, False)])
def test_what_no_fit_has_seen_speaks_for_an_effect_too(monkeypatch, held, leaves):
    """Of what noise that remembers does not foretell, a fit saves little."""
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: True)
    own = judged(-3.0, 0.1)
    rest = judged(-3.0 + 0.8 * PRUNE.surely, held=-3.0 + held * PRUNE.surely)
    assert (prune._unidentified(own, {"load_spring": rest}, 1.0, SCREEN) == [rest]) is leaves


@pytest.mark.parametrize(
    ("held", "sure", "leaves"),
    [
        pytest.param(1.1 * PRUNE.foretold, True, False, id="windows held out are foretold by it"),
        pytest.param(0.9 * PRUNE.foretold, True, True, id="too little better"),
        pytest.param(1.1 * PRUNE.foretold, False, True, id="but fitted windows do not tell its size"),
    ],
)
def test_what_acts_in_windows_held_out_stays_by_what_it_foretells(monkeypatch, held, sure, leaves):
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: not sure)
    own, rest = judged(-3.0), judged(-3.0 + 0.01, held=-3.0 + held)
    assert (prune._gaining_too_little(own, {"valve_rate_limit": rest}, 0.02) == [rest]) is leaves


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize(
    ("with_it", "without", "leaves"),
    [
        pytest.param(0.011, 0.0112, True, id="one run gains nothing"),
        pytest.param(0.011, 0.02, False, id="one run gains as much"),
        pytest.param(0.0305, 0.03, True, id="one run is far off, and without it is not"),
        pytest.param(0.05, 0.0501, False, id="one run is far off for another reason"),
        pytest.param(math.nan, 0.02, False, id="one run does not end"),
        pytest.param(0.0, math.inf, False, id="without it one run does not end"),
    ],
)
def test_what_windows_alone_gain_is_of_their_initial_states(monkeypatch, with_it, without, leaves):
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: False)
    own, rest = judged(-3.0, 0.01, whole=with_it), judged(-2.0, 0.02, whole=without)
    assert (prune._unidentified(own, {"load_spring": rest}, 0.01, SCREEN) == [rest]) is leaves


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize(("name", "leaves"), [("position_ripple", False), ("load_spring", True)])
def test_one_run_says_nothing_of_a_wave_that_loses_its_place_in_it(monkeypatch, name, leaves):
    """Of a speed nobody measures where the load is, and gusts move it off."""
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: False)
    own, rest = judged(-3.0, 0.01, whole=0.0305, sees_speed=True), judged(-2.0, 0.02, whole=0.03)
    assert (prune._unidentified(own, {name: rest}, 0.01, SCREEN) == [rest]) is leaves


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize(
    ("part", "adequacy", "relayed", "left", "leaves"),
    [
        pytest.param(0.95, 50.0, False, 0.02, True, id="beside a slow offset it saves little"),
        pytest.param(1.05, 50.0, False, 0.02, False, id="it saves more"),
        pytest.param(0.95, 1.0, False, 0.02, False, id="the sensor's noise is white"),
        pytest.param(0.95, 1.0, True, 0.02, True, id="a relay's commands answer to the offset"),
        pytest.param(1.05, 1.0, True, 0.02, False, id="it saves more than that"),
        pytest.param(0.95, 50.0, False, 1.1 * PRUNE.most_offset, False, id="no sensor's zero moves as far"),
    ],
)
def test_what_a_slow_offset_of_the_sensor_explains_is_no_cause(
    monkeypatch, part, adequacy, relayed, left, leaves
):
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: False)
    own, rest = judged(-3.0, 0.01, adequacy=adequacy, relayed=relayed), judged(-1.0, left)
    monkeypatch.setattr(prune, "part_beside_slow_offset", lambda *_: part * PRUNE.beside_slow_offset)
    assert (prune._unidentified(own, {"load_spring": rest}, 0.01, SCREEN) == [rest]) is leaves


@pytest.mark.usefixtures("no_chance")
@pytest.mark.parametrize(("saved", "leaves"), [(0.2, True), (1.2, False)])
def test_where_noise_is_white_an_effect_that_saves_little_is_asked_beside_a_slow_offset_too(
    monkeypatch, saved, leaves
):
    """A zero that wandered by half of the noise was an unequal gain, behind which white noise was left."""
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: False)
    monkeypatch.setattr(prune, "part_beside_slow_offset", lambda *_: 0.9 * PRUNE.beside_slow_offset)
    own, rest = judged(-3.0, 0.01, adequacy=1.0), judged(saved - 3.0, 0.011)
    assert (prune._unidentified(own, {"asymmetric_gain": rest}, 1e-6, SCREEN) == [rest]) is leaves


@pytest.mark.parametrize(
    ("adequacy", "without", "none"),
    [
        pytest.param(1.0, 2.8, False, id="noise alone is left with it, and more without"),
        pytest.param(1.0, 1.1, True, id="noise alone is left without it, too"),
        pytest.param(9.0, 9.4, True, id="more is left with it"),
    ],
)
def test_what_noise_shows_to_be_there_has_a_share_however_far_the_baseline_is_off(adequacy, without, none):
    """A constant load threw the baseline off by half of the movement: a friction beside it was 0.006 %."""
    own, rest = judged(-3.0, 0.0034, adequacy=adequacy), judged(-2.0, 0.0055, adequacy=without)
    assert prune._has_no_share(own, rest, 0.55**2) is none


class WindowsHeldOut:
    """Errors of each row of windows of so many rows that no fit has seen."""

    def __init__(self, error, rows):
        windows = tuple((0, at, at + rows) for at in range(0, len(error), rows))
        slices = [slice(first, last) for _, first, last in windows]
        series = [SimpleNamespace(slack=0.0)]
        self.cut = SimpleNamespace(series=series, windows=windows, slices=slices, noise=np.ones(len(windows)))
        self.error, self.scored, self.sure = error, *np.ones((2, len(error)), np.bool_)


def held_out(seed, wrong=0.0, windows=6, rows=500):
    random = np.random.default_rng(seed)
    error = random.normal(size=windows * rows)
    return WindowsHeldOut(error + wrong * np.sin(np.arange(len(error)) / 50.0), rows)


@pytest.mark.parametrize("seed", range(5))
def test_what_windows_held_out_do_not_show_may_be_chance(seed):
    with_it, without = held_out(seed), held_out(seed, 0.5)
    assert not may_be_chance(without, with_it, 20, 0.01)
    assert may_be_chance(with_it, without, 20, 0.01)
    assert may_be_chance(held_out(seed + 10), with_it, 20, 0.01)


def test_where_nothing_can_be_compared_nobody_calls_it_chance():
    one = held_out(1)
    assert not may_be_chance(one, one, 20, 0.01)
    one.sure = ~one.sure
    assert p_value(held_out(2, 0.5), one) == 1.0
    assert not may_be_chance(one, one, 20, 0.01)


@pytest.mark.parametrize(
    ("saves", "p_value", "chance"),
    [
        pytest.param(0.5, 0.3, True, id="an asymmetric gain in gusts"),
        pytest.param(0.5, 0.001, False, id="all windows show it"),
        pytest.param(1.5, 0.08, False, id="a valve's limit in few windows"),
        pytest.param(1.5, 0.6, True, id="windows held out do not show it"),
    ],
)
def test_what_saves_much_may_show_in_fewer_windows(monkeypatch, saves, p_value, chance):
    monkeypatch.setattr(prune, "causes_tried", lambda _: 0)
    monkeypatch.setattr(prune, "may_be_chance", lambda *asked: p_value > asked[-1])
    own, rest = judged(-3.0, 0.1), judged(-3.0 + saves * PRUNE.surely)
    own.found.model.scales = None
    assert prune._gains_by_chance(own, "load_spring", rest) is chance
