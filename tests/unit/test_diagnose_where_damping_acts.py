"""Damping by leakage or by friction of the load: Eq. 1 is the same, a load that rubs is not.

The rig is a mass on oil in plain small steps, friction by the sign of the speed and a rule for rest.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnose_truth import RATE, recording

from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import begun_from, further_causes
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.uncertainty import at_limits
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows
from seod.diagnose.report.words import consequences
from seod.diagnose.starts.baseline import unchanged
from seod.diagnose.starts.twins import beside_all_shown, twins

STEPS = 20
K_L, OMEGA_N, ZETA = 10.0, 60.0, 0.4
SIZES = Scales(
    volts=1.0,
    speed=10.0,
    pressure=600.0,
    centre=0.0,
    travel=5.0,
    peak_to_peak=2.0,
    omega_n=60.0,
    span_s=8.0,
    tick_s=1.0 / RATE,
)


def command(seconds):
    random = np.random.default_rng(5)
    t = np.arange(round(seconds * RATE)) / RATE
    lines = np.unique(np.round(np.geomspace(1, 40, 25)))
    waves = (np.cos(math.pi * k * t + random.uniform(0.0, math.tau)) for k in lines)
    u = sum(waves)
    return 2.0 * u / np.std(u)


def rig(u, level=0.0, rubs=1.0, null=0.0, lag=0.0, zeta=ZETA, second=()):
    """Positions; `rubs` is the part of the damping that acts on the load, behind a sensor's lag.

    A second inertia has its part of the first, its own frequency and its damping.
    """
    x = v = a = seen = 0.0
    x_2 = v_2 = 0.0
    part, omega_2, zeta_2 = second or (0.0, 0.0, 0.0)
    h, b = 1.0 / (RATE * STEPS), 2.0 * zeta * OMEGA_N
    out = []
    for volts in u:
        out.append(seen if lag else x)
        for _ in range(STEPS):
            held = omega_2**2 * (x - x_2) + 2.0 * zeta_2 * omega_2 * (v - v_2)
            push = a - rubs * b * v - part * held
            way = math.copysign(1.0, v) if v else math.copysign(1.0, push)
            then = v + h * (push - level * way)
            if level and ((v == 0.0 and abs(push) <= level) or then * v < 0.0):
                then = 0.0
            a += h * (OMEGA_N**2 * (K_L * (volts - null) - v) - (1.0 - rubs) * b * a)
            v = then
            x += h * v
            v_2 += h * held
            x_2 += h * v_2
            seen += h * (x - seen) / lag if lag else 0.0
    return np.array(out)


@pytest.mark.slow
@pytest.mark.computes
@pytest.mark.parametrize(
    ("told", "names"),
    [
        pytest.param({"level": 200.0}, {"coulomb_friction"}, id="a textbook's rig"),
        pytest.param({"level": 200.0, "rubs": 0.5}, {"coulomb_friction"}, id="both"),
        pytest.param({"level": 200.0, "rubs": 0.0}, {"coulomb_friction"}, id="leakage alone"),
        pytest.param({"level": 200.0, "lag": 8e-3}, {"coulomb_friction", "sensor_lag"}, id="behind a lag"),
        pytest.param({"level": 200.0, "null": 0.3}, {"coulomb_friction", "load_bias"}, id="off centre"),
        pytest.param({}, set(), id="nothing"),
    ],
)
def test_friction_is_found_wherever_the_damping_acts(told, names):
    u = command(8.0)
    effort = "normal" if "lag" in told else "quick"
    found = diagnose([recording(u, rig(u, **told), noise=3e-3)], (), Options(effort=effort))
    assert {each.name for each in found.effects} == names
    assert found.extended.zeta == pytest.approx(ZETA, rel=0.03)
    assert found.extended.omega_n == pytest.approx(OMEGA_N, rel=0.02)
    for each in found.effects:
        if each.name == "coulomb_friction":
            assert each.parameters["level"].value == pytest.approx(200.0, rel=0.03)
    if names == {"coulomb_friction"}:
        share = found.extended.effects.get("viscous_friction", {}).get("share", 0.0)
        assert share == pytest.approx(told.get("rubs", 1.0), abs=0.05)
        said = " ".join(consequences(found))
        assert ("viscous_friction: " in said) is (share >= 0.001)
        assert "viscous_friction.share is at its limit" not in said


@pytest.mark.slow
@pytest.mark.computes
def test_a_second_inertia_is_one_where_half_of_the_damping_acts_on_the_load():
    """With both the plant has other numbers than Eq. 1; from those of Eq. 1 a sensor's lag made up for it."""
    steps = np.repeat(np.random.default_rng(3).uniform(-2.0, 2.0, 70), 175)[:12000]
    y = rig(steps, rubs=0.5, zeta=0.74, second=(0.5, 1.8 * OMEGA_N, 0.02))
    found = diagnose([recording(steps, y, noise=2e-4)], (), Options())
    (effect,) = found.effects
    assert effect.name == "load_resonance"
    assert effect.parameters["inertia"].value == pytest.approx(0.5, rel=0.03)
    assert effect.parameters["omega"].value == pytest.approx(1.8 * OMEGA_N, rel=0.01)
    assert found.extended.omega_n == pytest.approx(OMEGA_N / math.sqrt(1.5), rel=0.01)  # of both together
    share = (1.0 / 1.5) / (1.0 / 1.5 + 1.0)  # what rubs slows both down
    assert found.extended.effects["viscous_friction"]["share"] == pytest.approx(share, abs=0.05)


@pytest.fixture(scope="module")
def linear():
    u = command(4.0)
    own = [series(recording(u, rig(u), noise=3e-3))]
    return fitted_windows(cut(own)[0])


def fitted(windows, *names, **more):
    model = baseline_model(SIZES, 1.0, sees_speed=False, fixed={})
    for name in names:
        model = model.with_effect(name)
    return unchanged(model, model.searched({"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA} | more), windows)


def test_a_twin_explains_as_much(linear):
    own = fitted(linear)
    (twin,) = twins([own])
    assert twin.model.names == ("viscous_friction",)
    assert twin.cost == pytest.approx(own.cost, abs=1e-3)
    assert at_limits(twin) == []


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_a_start_with_some_of_the_damping_at_the_load_is_the_same_plant(linear, share):
    own = fitted(linear)
    values = begun_from(own.model.values(own.x), {"viscous_friction.share": share})
    assert values["omega_n"] < 0.95 * OMEGA_N
    model = own.model.with_effect("viscous_friction")
    assert unchanged(model, model.searched(values), linear).cost == pytest.approx(own.cost, abs=1e-3)
    assert own.model.values(own.model.searched(values)) == pytest.approx(own.model.values(own.x))
    assert model.values(model.searched(values)) == pytest.approx(values)


def test_a_start_of_an_over_damped_plant_is_one_that_can_be_simulated():
    values = begun_from({"K_L": 1.0, "omega_n": 60.0, "zeta": 3.0}, {"viscous_friction.share": 0.5})
    assert values["omega_n"] > 0.0
    assert values["zeta"] * values["omega_n"] == pytest.approx(180.0)


def test_a_set_that_shows_where_the_damping_acts_has_no_twin(linear):
    assert twins([fitted(linear, "coulomb_friction", **{"coulomb_friction.level": 1.0})]) == []
    assert twins(twins([fitted(linear)])) == []


def test_a_constant_load_is_the_valves_centre_where_nothing_leaks(linear):
    load = 50.0
    (twin,) = twins([fitted(linear, "load_bias", **{"load_bias.acceleration": load})])
    assert set(twin.model.names) == {"null_shift", "viscous_friction"}
    volts = twin.model.values(twin.x)["null_shift.voltage"]
    assert volts == pytest.approx(2.0 * ZETA * load / (OMEGA_N * K_L))


@pytest.mark.slow
def test_numbers_are_told_beside_where_the_damping_acts():
    """Whether that gains enough or not: as if all leaked, friction comes out too small, and sure of it."""
    u = command(4.0)
    windows = fitted_windows(
        cut([series(recording(u, rig(u, level=200.0, rubs=0.5), noise=3e-3), sees_speed=False)])[0]
    )
    began = fitted(windows, "coulomb_friction", **{"coulomb_friction.level": 150.0})
    alone = fit(began.model, windows, began.x, began.start)
    beside = beside_all_shown(alone, map, lambda: False)
    assert alone.model.values(alone.x)["coulomb_friction.level"] < 190.0
    values = beside.model.values(beside.x)
    assert values["viscous_friction.share"] == pytest.approx(0.5, abs=0.05)
    assert values["coulomb_friction.level"] == pytest.approx(200.0, rel=0.02)
    assert beside_all_shown(beside, map, lambda: False) is beside


def test_what_nothing_shows_is_not_told_beside_numbers(linear):
    own = fitted(linear, "load_bias", **{"load_bias.acceleration": 1.0})
    assert beside_all_shown(own, map, lambda: False) is own


def test_beside_eq_1_alone_only_what_shows_it_is_tried():
    assert "viscous_friction" not in further_causes(SIZES, ())
    assert "viscous_friction" in further_causes(SIZES, ("coulomb_friction",))
    tried = further_causes(SIZES, ("viscous_friction",))
    assert "coulomb_friction" in tried
    assert not {"valve_deadband", "sensor_lag", "load_spring", "load_bias"}.intersection(tried)
    assert "sensor_lag" in further_causes(SIZES, ("viscous_friction", "coulomb_friction"))
