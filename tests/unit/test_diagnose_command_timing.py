"""Commands that a logger took late, or seldom."""

from dataclasses import replace

import numpy as np
import pytest
from late_commands import K_L, OMEGA_N, RATE, ZETA, N, T, moved, recorded, volts

from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.command_timing import Timing, timings
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows
from seod.diagnose.search.other_timing import other_timing
from seod.diagnose.starts.baseline import _rough
from seod.diagnose.starts.sizes import scales


def seldom(rows):
    at = np.arange(N)
    return volts(T)[at - at % rows]


def test_commands_of_each_row_may_have_been_a_row_earlier():
    assert [each.lead for each in timings([recorded(volts(T))[1]])] == [0.0, 0.5, 1.0]


def test_commands_that_were_seldom_looked_at_may_have_changed_each_row():
    assert min(each.lead for each in timings([recorded(seldom(4))[1]])) == -0.5


def test_where_it_is_told_when_commands_were_given_they_were_not_given_earlier():
    """They may still have changed between two looks."""
    each_row, few = (replace(recorded(u)[0], t_u=T + 1e-4) for u in (volts(T), seldom(2)))
    assert timings([series(each_row)]) == []
    assert [each.lead for each in timings([series(few)])] == [-0.5]


@pytest.mark.parametrize(
    ("u", "hold"),
    [
        pytest.param(np.sign(np.sin(9.0 * T) + 1e-9), "zero", id="a relay"),
        pytest.param(np.floor(T), "zero", id="steps"),
        pytest.param(seldom(20), "zero", id="a controller that is far slower"),
        pytest.param(volts(T), "first", id="the user tells that they run on"),
    ],
)
def test_others_are_as_they_were_recorded(u, hold):
    one = recorded(u, hold=hold)[1]
    assert timings([one]) == []
    assert hold == "first" or Timing(1.0).of(one) is one


def test_recordings_that_were_looked_at_otherwise_have_nothing_in_common():
    assert timings([recorded(volts(T))[1], recorded(seldom(4))[1]]) == []
    assert timings([recorded(volts(T))[1]] * 2)


def apart(one, timing, late=0.0):
    """Commands as they are given to the plant, less what they were; in deviations of the command."""
    t, given = timing.of(one).drive
    seen = t < T[-1] - 1.0
    return np.std(given[seen] - volts(t[seen] + (0.125 + late) / RATE)) / np.std(given)


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0])
def test_they_are_given_back_as_they_ran(late):
    _, one = recorded(volts(T - late / RATE))
    errors = {each.lead: apart(one, each) for each in timings([one])}
    assert min(errors, key=errors.get) == pytest.approx(late)
    assert min(errors.values()) < 0.03


def test_between_two_looks_they_run_on():
    _, one = recorded(seldom(4))
    later = timings([one])[0]
    assert apart(one, later, -0.5) < 0.1 < np.std(volts(T) - seldom(4)) / np.std(volts(T))


def timed(late, stiffness, stiff=0.0, at=volts):
    """Whether a set does without one of its causes where commands are earlier than recorded."""
    _, one = recorded(volts(T - late / RATE), moved(stiff, at), hold=None)
    to_fit, held_out = cut([one])
    small = fitted_windows(to_fit)
    model = baseline_model(_rough(to_fit, OMEGA_N), 1.0, False, {})
    x = model.searched({"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA})
    plain = fit(model, small, x, simulated_states(model, x, small))
    grown = model.__class__(scales(plain, small), (), model.coordinates, {}, model.sees_speed)
    grown = grown.with_effect("load_spring")
    start = grown.searched(
        {each.place: 0.0 for each in grown.coordinates}
        | {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA, "load_spring.stiffness": stiffness}
    )
    found = fit(grown, small, start, simulated_states(grown, start, small))
    return other_timing(found, {"load_spring": plain}, held_out, map)


@pytest.mark.parametrize("late", [0.25, 0.6, 1.0])
def test_a_cause_that_stands_for_late_commands_is_spared(late):
    told = timed(late, 1.0)
    assert told is not None
    assert told.spares == "load_spring"
    assert told.timing.lead == pytest.approx(late, abs=0.03)
    assert f"{told.lead:.3g} s earlier" in told.sentence


def test_so_is_one_that_stands_for_two_commands_a_row():
    """Of which the file has the first: a quarter of a row earlier than recorded, on average."""
    told = timed(0.0, 1.0, at=lambda t: volts(np.floor(2.0 * t * RATE + 1e-9) / (2.0 * RATE)))
    assert told is not None
    given = told.timing.lead + (0.0 if told.timing.holds else 0.5)
    assert given == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_cause_that_is_there_stays(late):
    assert timed(late, 0.02 * OMEGA_N**2, stiff=0.02) is None


@pytest.mark.slow
@pytest.mark.computes
def test_a_record_of_late_commands_has_no_cause_and_says_so():
    late, _ = recorded(volts(T - 1.0 / RATE), moved())
    told = diagnose([late], options=Options(effort="quick"))
    assert told.verdict == "clean"
