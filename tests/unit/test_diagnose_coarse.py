"""Which readings stand for an interval, and of which rounding is as good as white noise."""

import numpy as np
from scipy.signal import lfilter

from seod.diagnose.record.coarse_sensor import readings
from seod.diagnose.record.noise import noise_sd

N, STEP = 4000, 1.0
T = np.arange(N) / 1000.0
GOOD = np.ones(N, bool)


def counted(reach, noise, colour=0.95, seed=3):
    """A movement of so many steps, with noise of so many that remembers, in whole steps."""
    random = np.random.default_rng(seed)
    own = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], random.normal(size=N + 500))[500:]
    return STEP * np.round(reach * np.sin(2.0 * np.pi * 2.0 * T) + noise * own)


def slack(y):
    return readings(y, GOOD, STEP, noise_sd(T, y, GOOD)).slack


def test_rounding_of_a_fast_movement_is_white_however_few_counts_go_back():
    assert slack(counted(2000.0, 5.0)) == 0.0


def test_readings_that_stay_for_many_rows_stand_for_an_interval():
    assert slack(counted(10.0, 0.01)) == 0.5 * STEP
