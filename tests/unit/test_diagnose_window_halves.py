"""What happens too rarely to show in windows that are fitted and in others that are held out."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import K_L, OMEGA_N, RATE, ZETA, linear, multisine, recording
from scipy.signal import lfilter

from seod.diagnose.account import halves
from seod.diagnose.account.halves import noise_is_larger
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut
from seod.diagnose.starts.baseline import _rough
from seod.diagnose.verdict.answer import Findings, _remainder
from seod.diagnose.verdict.effects import Chosen
from seod.diagnose.verdict.remarks import RARE, UNFITTED

pytestmark = pytest.mark.slow

T = np.arange(12000) / RATE
LIMIT = 0.6


def rare(*peaks):
    """Slow commands, above `LIMIT` for a moment at these times, to a valve that goes no further."""
    u = 0.2 * np.sin(2.0 * np.pi * 0.4 * T) + 0.1 * multisine(len(T))
    for at in peaks:
        u = u + 0.8 * np.exp(-(((T - at) / 0.03) ** 2))
    y = linear(np.clip(u, -LIMIT, LIMIT))
    return recording(u, y + np.random.default_rng(2).normal(0.0, 0.002 * np.std(y), len(y)))


def test_what_shows_in_both_halves_is_named():
    told = diagnose([rare(5.0, 7.7)])
    assert [each.name for each in told.effects] == ["valve_saturation"]
    assert told.verdict == "effects"
    assert told.effects[0].parameters["limit"].value == pytest.approx(LIMIT, rel=0.02)
    assert told.remarks == ()


@pytest.mark.parametrize("peaks", [(1.0,), (7.7, 8.5)])
def test_what_shows_in_fitted_windows_alone_is_named_where_these_tell_it(peaks):
    """Windows held out show how it bends the numbers of a model without it."""
    told = diagnose([rare(*peaks)], options=Options(effort="quick"))
    assert [each.name for each in told.effects] == ["valve_saturation"]
    assert told.effects[0].parameters["limit"].value == pytest.approx(LIMIT, rel=0.02)


def test_what_shows_in_windows_held_out_alone_is_left_to_a_longer_recording():
    told = diagnose([rare(10.0, 10.7)], options=Options(effort="quick"))
    assert told.verdict == "unexplained"
    assert not told.effects


def test_what_happens_once_is_not_told_to_be_nothing():
    slipped = rare()
    slipped = replace(slipped, y=slipped.y + 0.1 * np.ptp(slipped.y) * (T > 7.7))
    told = diagnose([slipped], options=Options(effort="quick"))
    assert told.verdict == "unexplained"
    assert not told.effects
    assert told.unexplained.fraction > 0.5
    assert RARE in told.remarks


def detuned(to_fit, *parts):
    """Eq. 1 with so many times the natural frequency, of which only initial states were fitted."""
    model = baseline_model(_rough(to_fit, OMEGA_N), 1.0, False, {})
    every = [model.searched({"K_L": K_L, "omega_n": part * OMEGA_N, "zeta": ZETA}) for part in parts]
    return [
        fit(model, to_fit, x, simulated_states(model, x, to_fit), free=np.zeros(3, np.bool_)) for x in every
    ]


@pytest.mark.parametrize(
    ("off", "shaken", "said"),
    [(1.0, 0.0, None), (1.06, 0.0, ()), (1.0, 1.0, ()), (1.0, 3.0, (UNFITTED,))],
    ids=["noise", "numbers far off", "another movement", "a larger one"],
)
def test_windows_held_out_that_alone_show_more_are_told(off, shaken, said):
    u = multisine(6000)
    y = linear(u)
    noise = 0.01 * np.std(y)
    to_fit, aside = cut([series(recording(u, y + np.random.default_rng(3).normal(0.0, noise, len(y))))])
    _, first, last = aside.windows[0]
    aside.series[0].y[first:last] += shaken * noise * np.sin(900.0 * np.arange(last - first) / RATE)
    (found,) = detuned(to_fit, off)
    held = Judged.of(found, aside).held
    best = Chosen(found, found, found, {}, held)
    (far,) = detuned(to_fit, 0.8)
    some = Findings(far, far, Judged.of(far, aside).held, best, Judged.of(found, to_fit).held, (), None)
    left, told = _remainder(some, Judged.of(far, to_fit).held)
    assert (left.fraction == 0.0) == (said is None)
    assert told == (said or ())


def errs_more(memory, seed, larger=1.0, slow=0.0):
    """Whether one window held out, whose noise is so much larger, is taken for more than noise.

    Beside an offset that falls by so many times the noise while the second window is read.
    """
    u = multisine(12000)
    y = linear(u)
    noise = lfilter([1.0], [1.0, -memory], np.random.default_rng(seed).normal(0.0, 1.0, len(y)))
    to_fit, aside = cut([series(recording(u, y + 0.03 * np.std(y) / np.std(noise) * noise))])
    _, first, last = aside.windows[-1]
    moved, read = linear(u)[first:last], aside.series[0].y[first:last]
    read += (larger - 1.0) * (read - moved)
    _, first, last = aside.windows[0]
    aside.series[0].y[first:last] += slow * 0.03 * np.std(y) * np.cos(np.linspace(0.0, np.pi, last - first))
    (found,) = detuned(to_fit, 1.0)
    return noise_is_larger(Judged.of(found, to_fit).held, Judged.of(found, aside).held)


def test_noise_of_one_size_is_hardly_ever_taken_for_more():
    told = [errs_more(memory, seed) for memory in (0.5, 0.95, 0.99) for seed in range(20)]
    assert sum(told) == 0


@pytest.mark.parametrize("memory", [0.5, 0.95, 0.99])
def test_what_acts_in_windows_held_out_alone_is_no_noise(memory):
    assert errs_more(memory, 0, larger=6.0)


def test_an_offset_that_moves_slowly_in_one_of_them_is_of_such_noise(monkeypatch):
    assert not errs_more(0.9, 1, slow=3.0)
    monkeypatch.setattr(halves, "HALVES", replace(halves.HALVES, slow_bends=0))
    assert errs_more(0.9, 1, slow=3.0)
