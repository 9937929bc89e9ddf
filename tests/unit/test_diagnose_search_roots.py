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
from seod.diagnose.starts import search_roots as search_roots_module
from seod.diagnose.starts.baseline import BaselineFits, _rough
from seod.diagnose.starts.search_roots import also_from, search_roots
from seod.diagnose.starts.sizes import scales
from seod.diagnose.starts.unsigned import unsigned_root

N, K_L = 4000, 17.0


def behind(read, omega_n=60.0, zeta=0.4):
    """A baseline on windows of a plant's speed as a sensor reads it."""
    u = multisine(N)
    b, a, _ = cont2discrete(([K_L * omega_n**2], [1.0, 2.0 * zeta * omega_n, omega_n**2]), 1.0 / RATE)
    windows, _ = cut([series(recording(u, read(lfilter(b.ravel(), a, u)), noise=0.01), sees_speed=True)])
    model = baseline_model(_rough(windows, omega_n), 1.0, True, {})
    x = model.searched({"K_L": K_L, "omega_n": omega_n, "zeta": zeta})
    return fit(model, windows, x, simulated_states(model, x, windows), most=4)


@pytest.mark.slow
@pytest.mark.parametrize("power", [1.0, 2.0])
def test_behind_a_sensor_without_sign_the_search_begins_at_the_plant(power):
    base = behind(lambda speed: 10.0 * (np.abs(speed) / 10.0) ** power)
    sizes = scales(base, base.cut)
    *_, root = search_roots(base, BaselineFits(base, base, base), sizes, base.cut).begin
    values = root.model.values(root.x)
    assert (values["omega_n"], values["zeta"]) == pytest.approx((60.0, 0.4), rel=0.02)
    assert values["rectified_sensor.power"] == pytest.approx(power, rel=0.02)
    assert root.excess < 1.2


def test_of_readings_of_either_sign_there_is_no_such_root():
    base = behind(lambda speed: speed)
    assert unsigned_root(base.model, base.cut, scales(base, base.cut)) is None


@pytest.mark.slow
def test_a_speed_that_never_turns_keeps_its_sign():
    """It comes down to 0 and no further, and the baseline explains it."""
    base = behind(lambda speed: speed - np.min(speed))
    roots = search_roots(base, BaselineFits(base, base, base), scales(base, base.cut), base.cut)
    assert not any("rectified_sensor" in one.model.names for one in roots.begin)


def of_position(push):
    """A baseline at the plant, on windows of a position that a constant acceleration pushes as well."""
    u, omega_n, zeta = multisine(N), 60.0, 0.4
    b, a, _ = cont2discrete(([K_L * omega_n**2], [1.0, 2.0 * zeta * omega_n, omega_n**2, 0.0]), 1.0 / RATE)
    y = lfilter(b.ravel(), a, u) + push * 2.0 * zeta / omega_n * np.arange(N) / RATE
    windows, _ = cut([series(recording(u, y, noise=0.001), sees_speed=False)])
    model = baseline_model(_rough(windows, omega_n), 1.0, False, {})
    x = model.searched({"K_L": K_L, "omega_n": omega_n, "zeta": zeta})
    return fit(model, windows, x, simulated_states(model, x, windows), free=np.zeros(3, np.bool_))


@pytest.mark.parametrize("damping", [14.0, 1.5])
def test_where_a_load_has_damped_eq_1_the_search_begins_at_a_plant_that_oscillates_too(monkeypatch, damping):
    """A deadband beside a load made an over-damped plant of one of 2.5 rad/s, from which no fit came back."""
    base = of_position(300.0)
    damped = fit(
        base.model,
        base.cut,
        base.x + np.array([0.0, 0.0, np.log(damping / 0.4)]),
        base.start,
        free=np.zeros(3, np.bool_),
    )
    usual = search_roots_module._fitted_with

    def fitted(name, root, *, load_alone=False):
        return usual(name, root if load_alone else damped, load_alone=True)

    monkeypatch.setattr(search_roots_module, "_fitted_with", fitted)
    begin = search_roots_module._with_load([base])
    zetas = [one.model.values(one.x)["zeta"] for one in begin]
    assert zetas == pytest.approx([damping, 0.4] if damping > 2.0 else [damping])


@pytest.mark.slow
@pytest.mark.parametrize("push", [0.0, 300.0])
def test_a_position_that_runs_away_begins_with_an_offset(push):
    base = of_position(push)
    roots = search_roots(base, BaselineFits(base, base, base), scales(base, base.cut), base.cut)
    assert roots.baseline.model.names == ()
    if not push:
        assert not any(one.model.names for one in roots.begin)
        return
    (root,) = roots.begin
    assert root.model.names == ("load_bias",)
    values = root.model.values(root.x)
    assert (values["omega_n"], values["zeta"]) == pytest.approx((60.0, 0.4), rel=0.02)
    assert values["load_bias.acceleration"] == pytest.approx(-push, rel=0.05)


@pytest.mark.slow
def test_a_set_that_is_known_is_one_of_the_roots():
    base = of_position(push=300.0)
    sizes = scales(base, base.cut)
    roots = search_roots(base, BaselineFits(base, base, base), sizes, base.cut)
    rough = base.model.with_effect("load_bias")
    x = rough.searched(base.model.values(base.x) | {"load_bias.acceleration": -280.0})
    known = fit(rough, base.cut, x, simulated_states(rough, x, base.cut), most=1)
    *others, last = also_from(roots, known, base.cut).begin
    assert others == roots.begin
    assert last.model.names == ("load_bias",)
    assert last.model.scales == sizes
    assert last.model.values(last.x)["load_bias.acceleration"] == pytest.approx(-300.0, rel=0.02)
