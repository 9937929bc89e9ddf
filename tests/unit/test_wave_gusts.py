"""Live answers where gusts move the load: what is told of their errors."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from gusty_loop import TRUTH, N, T, relay, stepped

from seod.estimate import make_estimator
from seod.estimate.base import EstimatorSettings, Row

CYCLES = 6


def apart(gusts, seed):
    """Errors over told deviations of omega_n and zeta, of windows that share no sample."""
    y, u = stepped(relay(), seed, gusts=gusts)
    estimator = make_estimator(
        EstimatorSettings("wave", TRUTH["K_L"], 0.02, 0.0, T[1], CYCLES, None, K_L_sd=0.0, delay_sd=0.0)
    )
    rows = (Row(T[k], y[k], u[k], T[k], 0.0, 1.0, 0.0, exciting=True) for k in range(N))
    answers = (one for row in rows if (one := estimator.update(row)) is not None)
    for one in islice(answers, 20, None, 2 * CYCLES):
        yield (one.omega_n - TRUTH["omega_n"]) / one.omega_n_sd, (one.zeta - TRUTH["zeta"]) / one.zeta_sd


@pytest.mark.slow
def test_errors_are_hardly_larger_than_told():
    """By an autoregression that forgets too soon they were three times as large."""
    off = np.array([each for seed in (1, 2) for each in apart(60.0, seed)])
    assert len(off) > 50
    assert np.all(np.sqrt(np.mean(off**2, axis=0)) < 1.6), off
