"""Effects that are no small part of the movement, where Eq. 1 alone comes to another plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import RATE, recording
from scipy.signal import cont2discrete

from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import group
from seod.diagnose.pipeline import Options, diagnose

N = 10_000
K_L, OMEGA_N, ZETA = 0.02, 50.0, 0.2
SIZES = Scales(
    volts=1.0,
    speed=1.0,
    pressure=100.0,
    centre=0.0,
    travel=2.0,
    peak_to_peak=0.02,
    omega_n=50.0,
    span_s=10.0,
    tick_s=0.001,
)


def behind_a_soft_shaft(u, inertia, omega, zeta):
    """Positions of the first of two inertias, by the exact discrete form; u holds between rows."""
    oil, shaft, rubs = OMEGA_N**2, omega**2, 2.0 * zeta * omega
    drag = inertia * np.array([shaft, rubs])
    A = np.array(
        [  # position and speed of the first, pressure, position and speed of the second
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-drag[0], -drag[1], 1.0 + inertia, drag[0], drag[1]],
            [0.0, -oil, -2.0 * ZETA * OMEGA_N, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [shaft, rubs, 0.0, -shaft, -rubs],
        ]
    )
    B = np.array([[0.0], [0.0], [oil * K_L], [0.0], [0.0]])
    A, B, *_ = cont2discrete((A, B, np.eye(5), np.zeros((5, 1))), 1.0 / RATE)
    x, y = np.zeros(5), []
    for volts in u:
        y.append(x[0])
        x = A @ x + B[:, 0] * volts
    return np.array(y)


@pytest.mark.slow
@pytest.mark.computes
def test_a_heavy_inertia_that_oscillates_below_the_plant_is_no_disturbance():
    """Eq. 1 took the higher resonance for the plant's own, and a wave for the lower one."""
    random = np.random.default_rng(3)
    lines = np.arange(1, 41)
    phases = random.uniform(0.0, 2.0 * np.pi, len(lines))
    t = np.arange(N) / RATE
    u = 0.6 * np.sin(2.0 * np.pi * 0.4 * t[:, None] * lines + phases).sum(axis=1)
    y = behind_a_soft_shaft(u, 3.0, 15.0, 0.05)
    found = diagnose([recording(u, y, noise=0.005)], (), Options(effort="quick"))
    assert [each.name for each in found.effects] == ["load_resonance"]
    told = found.effects[0].parameters
    assert (told["inertia"].value, told["omega"].value) == pytest.approx((3.0, 15.0), rel=0.02)
    assert found.extended.omega_n == pytest.approx(OMEGA_N, rel=0.02)


def test_a_gap_may_be_as_wide_as_the_travel():
    """Between far moves the baseline rings a little, and twelve times that was less than the gap."""
    (gap,) = group("backlash", SIZES).coordinates
    assert gap.value(gap.bounds[1]) == pytest.approx(2.0)
    (gap,) = group("backlash", replace(SIZES, peak_to_peak=1.0)).coordinates
    assert gap.value(gap.bounds[1]) == pytest.approx(12.0)
