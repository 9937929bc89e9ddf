"""A load that dry friction holds for most of the time: Eq. 1 is far off, the plant is behind the friction."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from diagnose_truth import RATE, multisine, recording

from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.search_roots import search_roots
from seod.diagnose.starts.sizes import scales

N = 24_000
K_L, OMEGA_N, ZETA = 7.0, 45.0, 0.2
FINER = 10
"""Steps of a tick."""


@cache
def position(shares, unit=1.0):
    """Of a load from rest that friction of so many times K_L omega_n std(u) holds.

    The pressure answers a speed that stands still over a step; the load's speed never turns within one.
    """
    u = 0.3 * multisine(N, seed=8)
    friction = shares * K_L * OMEGA_N * float(np.std(u))
    step, square = 1.0 / (FINER * RATE), OMEGA_N**2
    decay = np.exp(-2.0 * ZETA * OMEGA_N * step)
    x = v = p = 0.0
    places, stands = [], 0
    for volts in np.repeat(u, FINER).tolist():
        rests = square * (K_L * volts - v) / (2.0 * ZETA * OMEGA_N)
        p = rests + (p - rests) * decay
        faster = v + step * p
        held = min(max(faster, -step * friction), step * friction)
        v = faster - held if v == 0.0 or (faster - np.copysign(step * friction, v)) * v > 0.0 else 0.0
        x += step * v
        stands += v == 0.0
        places.append(x)
    return recording(u, unit * np.array(places)[::FINER], noise=0.005), friction, stands / len(places)


def roots_of(record):
    windows = segments(cut([series(record)])[0])
    begun = baseline(windows, False, {})
    return search_roots(begun.best, begun, scales(begun.near, begun.near.cut), windows)


@pytest.mark.slow
@pytest.mark.computes
@pytest.mark.parametrize(("shares", "unit"), [(0.4, 1.0), (0.7, 1e-3), (0.9, 1.0)])
def test_the_search_begins_at_the_plant_behind_friction(shares, unit):
    """Which holds the load for a fifth, a half and two thirds of the time."""
    record, friction, stands = position(shares, unit)
    print(stands)
    first, *_ = roots_of(record).begin
    assert first.model.names == ("coulomb_friction",)
    values = first.model.values(first.x)
    assert (values["omega_n"], values["zeta"]) == pytest.approx((OMEGA_N, ZETA), rel=0.05)
    assert values["K_L"] == pytest.approx(unit * K_L, rel=0.05)
    assert values["coulomb_friction.level"] == pytest.approx(unit * friction, rel=0.05)


@pytest.mark.slow
@pytest.mark.computes
def test_without_friction_nothing_is_hidden():
    record, *_ = position(0.0)
    assert not any(one.model.names for one in roots_of(record).begin)
