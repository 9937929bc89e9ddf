"""Plants from which causes are searched."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose_truth import RATE, multisine, recording
from scipy.signal import cont2discrete, lfilter

from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut
from seod.diagnose.starts.baseline import _rough
from seod.diagnose.starts.search_roots import less_damped
from seod.diagnose.tuning.starts import SEARCH_ROOTS

N, K_L = 4000, 17.0


def fitted(omega_n, zeta, *, disturbed=0.0, wave=40.0, noise=0.01):
    """Eq. 1 at the plant that the recorded speed is of; a wave besides, as a part of its deviation."""
    u = multisine(N)
    number, denominator = [K_L * omega_n**2], [1.0, 2.0 * zeta * omega_n, omega_n**2]
    b, a, _ = cont2discrete((number, denominator), 1.0 / RATE)
    y = lfilter(b.ravel(), a, u)
    y = y + disturbed * np.std(y) * np.sin(wave * np.arange(N) / RATE)
    windows, _ = cut([series(recording(u, y, noise=noise), sees_speed=True)])
    model = baseline_model(_rough(windows, omega_n), 1.0, True, {})
    x = model.searched({"K_L": K_L, "omega_n": omega_n, "zeta": zeta})
    return fit(model, windows, x, simulated_states(model, x, windows), free=np.zeros(3, np.bool_))


def test_a_rate_too_quick_to_show_is_let_go():
    begun = fitted(700.0, 8.0, disturbed=1.0)
    found = less_damped(begun)
    values = found.model.values(found.x)
    assert values["omega_n"] == pytest.approx(700.0 * SEARCH_ROOTS.less_damping / 8.0)
    assert values["zeta"] == pytest.approx(SEARCH_ROOTS.less_damping, rel=0.3)
    slow = values["omega_n"] / (2.0 * values["zeta"])
    assert slow == pytest.approx(700.0 / 16.0, rel=0.3)


@pytest.mark.parametrize(
    ("omega_n", "zeta", "wrong"),
    [
        pytest.param(700.0, 8.0, {"noise": 2.0}, id="it leaves the noise alone"),
        pytest.param(150.0, 3.0, {"disturbed": 0.03}, id="both rates show"),
        pytest.param(117.0, 0.3, {"disturbed": 0.5}, id="it swings"),
        pytest.param(700.0, 8.0, {"disturbed": 2.0, "wave": 9.0}, id="the other is damped more"),
    ],
)
def test_a_plant_that_must_be_stays(omega_n, zeta, wrong):
    begun = fitted(omega_n, zeta, **wrong)
    assert less_damped(begun) is begun
