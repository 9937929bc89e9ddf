"""A valve so slow that it seldom comes to where it is sent: Eq. 1 is far off, the plant is behind it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnose_truth import RATE, recording
from scipy.signal import cont2discrete, lfilter

from seod.diagnose.fitting.work import used_s
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments
from seod.diagnose.starts import search_roots as search_roots_module
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.hidden_plants import _half_lost
from seod.diagnose.starts.search_roots import search_roots
from seod.diagnose.starts.sizes import scales

N, VOLTS = 12_000, 5.0
K_L, OMEGA_N, ZETA = 11.0, 80.0, 0.3
FINER = 10
"""Places of the valve in a tick."""


def binary(seed=2):
    """One of two commands by chance every 45 ticks: each stays for 90 on average."""
    return VOLTS * np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], N // 45 + 1), 45)[:N]


def steps(seed=2):
    """Commands of any size, for 20 to 160 ticks each."""
    random = np.random.default_rng(seed)
    return np.repeat(random.uniform(-VOLTS, VOLTS, N // 20), random.integers(20, 160, N // 20))[:N]


@cache
def position(command, rate):
    """Of Eq. 1 behind a valve no faster than `rate` [V/s], from rest, by tenths of a tick."""
    place, valve, most = 0.0, np.empty(FINER * N), rate / (FINER * RATE)
    for k, volts in enumerate(np.repeat(command(), FINER).tolist()):
        valve[k] = place
        place = min(max(volts, place - most), place + most)
    square = OMEGA_N**2
    plant = [K_L * square], [1.0, 2.0 * ZETA * OMEGA_N, square, 0.0]
    b, a, _ = cont2discrete(plant, 1.0 / (FINER * RATE))
    return recording(command(), lfilter(b.ravel(), a, valve)[::FINER], noise=0.001)


def roots_of(record, quicker=1.0):
    """Roots beside a baseline whose plant is so many times as quick as fitted."""
    windows = segments(cut([series(record)])[0])
    begun = baseline(windows, False, {})
    sizes = scales(begun.near, begun.near.cut)
    return search_roots(begun.best, begun, replace(sizes, omega_n=quicker * sizes.omega_n), windows)


@pytest.mark.slow
@pytest.mark.computes
@pytest.mark.parametrize("command", [binary, steps])
@pytest.mark.parametrize("lasts", [0.8, 2.0])
def test_the_search_begins_at_the_plant_behind_a_slow_valve(command, lasts):
    """Ramps from end to end last `lasts` of the mean time from one command to the next."""
    rate = 2.0 * VOLTS / (lasts * 0.09)
    first, *_ = roots_of(position(command, rate)).begin
    assert first.model.names == ("valve_rate_limit",)
    values = first.model.values(first.x)
    assert [values[of] for of in ("K_L", "omega_n", "zeta", "valve_rate_limit.rate")] == pytest.approx(
        [K_L, OMEGA_N, ZETA, rate], rel=0.03
    )


@pytest.mark.slow
@pytest.mark.computes
def test_a_baseline_that_is_far_too_quick_does_not_limit_the_valve():
    """Its limits are in radians of a plant: of the one behind the ramps."""
    rate = 2.0 * VOLTS / (2.0 * 0.09)
    first, *_ = roots_of(position(binary, rate), quicker=200.0).begin
    assert first.model.names == ("valve_rate_limit",)
    assert first.model.values(first.x)["valve_rate_limit.rate"] == pytest.approx(rate, rel=0.01)


@pytest.mark.slow
def test_plants_behind_ramps_do_not_count_as_work_of_the_search(monkeypatch):
    """A search of little work had ended before it tried what it had found until then."""
    monkeypatch.setattr(search_roots_module, "pulled_back", lambda _: [])
    monkeypatch.setattr(search_roots_module, "is_another_plant", lambda *_: False)
    record, used = position(binary, 2.0 * VOLTS / (2.0 * 0.09)), []
    for plants in (search_roots_module.hidden_plants, lambda *_: []):
        monkeypatch.setattr(search_roots_module, "hidden_plants", plants)
        before = used_s()
        roots_of(record)
        used.append(used_s() - before)
    assert used[0] == pytest.approx(used[1], rel=1e-9)


@pytest.mark.slow
def test_behind_a_quick_valve_nothing_is_hidden():
    begin = roots_of(position(binary, 1e5)).begin
    assert not any(one.model.names for one in begin)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_half_of_a_square_wave_s_deviation_is_lost_at_a_known_speed(unit):
    """Ramps from -1 to 1 that last a part p of half a period leave sqrt(8 p / 3 / 2) of it."""
    t = np.arange(100_000) / 1000.0 * unit
    u = np.where(np.arange(100_000) // 1000 % 2, 1.0, -1.0)
    part = 0.25 * 3.0 / 4.0
    assert _half_lost(t, u) == pytest.approx(2.0 / part / unit, rel=0.02)


@pytest.mark.slow
@pytest.mark.computes
def test_a_valve_that_hardly_comes_to_its_commands_is_named():
    """It had been `unexplained` with nothing named, or another cause beside a plant of no meaning."""
    rate = 2.0 * VOLTS / (2.0 * 0.09)
    told = diagnose([position(binary, rate)], (), Options(effort="quick", output="position"))
    assert (told.verdict, [each.name for each in told.effects]) == ("effects", ["valve_rate_limit"])
    rate_told = told.effects[0].parameters["rate"]
    assert rate_told.value == pytest.approx(rate, rel=0.01)
    plant = told.extended
    assert (plant.K_L, plant.omega_n, plant.zeta) == pytest.approx((K_L, OMEGA_N, ZETA), rel=0.03)
