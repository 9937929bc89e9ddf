"""Numbers told beside when commands were given, where nobody tells that."""

from dataclasses import replace

import numpy as np
import pytest
from late_commands import K_L, OMEGA_N, RATE, ZETA, N, T, moved, recorded, volts

from seod.diagnose.fitting.command_lead import lead_remarks, untimed
from seod.diagnose.fitting.free_run import fitted_to_all_rows
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.uncertainty import base_sd, covariance
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, all_windows, cut
from seod.diagnose.starts.baseline import _rough


def read(y):
    """With noise as of measured rigs, 2 % of the movement."""
    return y + np.random.default_rng(2).normal(0.0, 0.02 * np.std(y), N)


Y = read(moved())
TRUTH = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA}


def last(one, as_recorded=False, fixed=None):
    """Eq. 1 fitted to all rows."""
    to_fit, _ = cut([one])
    model = baseline_model(_rough(to_fit, OMEGA_N), 1.0, False, fixed or {})
    x = model.searched(TRUTH)
    found = fit(model, to_fit, x, simulated_states(model, x, to_fit))
    every = Cut([one], all_windows([one]))
    return fitted_to_all_rows(found, every, map, lambda: False, as_recorded)


def beyond(fitted):
    """By how many standard deviations each number is off, and these over the number."""
    values, sd = fitted.model.values(fitted.x), base_sd(fitted, covariance(fitted))
    off = {name: abs(values[name] - truth) / sd[name] for name, truth in TRUTH.items()}
    return off, {name: sd[name] / truth for name, truth in TRUTH.items()}


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0])
def test_commands_that_ran_on_are_given_when_they_were(late):
    """What runs on is half a row earlier than what holds."""
    fitted = last(recorded(volts(T - late / RATE), Y, hold=None)[1])
    off, sd = beyond(fitted)
    assert fitted.cut.series[0].lead == pytest.approx(late + 0.5, abs=0.05)
    assert max(off.values()) < 3.0
    assert max(sd.values()) < 0.01


def test_as_they_are_recorded_numbers_are_off():
    off, _ = beyond(last(recorded(volts(T - 0.5 / RATE), Y, hold=None)[1], as_recorded=True))
    assert off["omega_n"] > 5.0


def test_commands_that_held_stay_where_they_are_recorded():
    held = read(moved(at=lambda t: volts(np.floor(t * RATE + 1e-9) / RATE)))
    fitted = last(recorded(volts(T), held, hold=None)[1])
    assert fitted.cut.series[0].lead == pytest.approx(0.0, abs=0.05)
    assert lead_remarks(fitted) == []


def test_an_answer_says_what_it_takes_them_for():
    (said,) = lead_remarks(last(recorded(volts(T - 1.0 / RATE), Y, hold=None)[1]))
    assert "0.003 s (1.5 rows) earlier than recorded" in said


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_the_user_tells_how_they_ran(hold):
    fitted = last(recorded(volts(T), Y, hold=hold)[1])
    assert not fitted.cut.untimed
    assert fitted.cut.series[0].lead == 0.0


def test_a_column_tells_when_they_were_given():
    told = series(replace(recorded(volts(T), Y)[0], t_u=T + 1e-4))
    assert not last(told).cut.untimed


def test_a_delay_counts_from_where_they_are_recorded():
    one = recorded(volts(T), Y, hold=None)[1]
    every = Cut([one], ((0, 0, N),))
    plain = last(one).model
    assert untimed(every, plain).untimed
    assert not untimed(every, replace(plain, fixed={"transport_delay": {"time": 0.001}})).untimed
