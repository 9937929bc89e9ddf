"""Damping by leakage or by friction of the load: Eq. 1 is the same, a load that rubs is not.

The rig is a mass on oil in plain small steps, friction by the sign of the speed and a rule for rest.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnose_truth import RATE, recording

from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import further_causes
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.uncertainty import at_limits
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows
from seod.diagnose.report.words import consequences
from seod.diagnose.starts.baseline import unchanged
from seod.diagnose.starts.twins import twins

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


def rig(u, level=0.0, rubs=1.0, null=0.0, lag=0.0):
    """Positions; `rubs` is the part of the damping that acts on the load, behind a sensor's lag."""
    x = v = a = seen = 0.0
    h, b = 1.0 / (RATE * STEPS), 2.0 * ZETA * OMEGA_N
    out = []
    for volts in u:
        out.append(seen if lag else x)
        for _ in range(STEPS):
            push = a - rubs * b * v
            way = math.copysign(1.0, v) if v else math.copysign(1.0, push)
            then = v + h * (push - level * way)
            if level and ((v == 0.0 and abs(push) <= level) or then * v < 0.0):
                then = 0.0
            a += h * (OMEGA_N**2 * (K_L * (volts - null) - v) - (1.0 - rubs) * b * a)
            v = then
            x += h * v
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
        assert ("viscous_friction: " in said) is (share > 0.0)
        assert "viscous_friction.share is at its limit" not in said


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


def test_a_set_that_shows_where_the_damping_acts_has_no_twin(linear):
    assert twins([fitted(linear, "coulomb_friction", **{"coulomb_friction.level": 1.0})]) == []
    assert twins(twins([fitted(linear)])) == []


def test_a_constant_load_is_the_valves_centre_where_nothing_leaks(linear):
    load = 50.0
    (twin,) = twins([fitted(linear, "load_bias", **{"load_bias.acceleration": load})])
    assert set(twin.model.names) == {"null_shift", "viscous_friction"}
    volts = twin.model.values(twin.x)["null_shift.voltage"]
    assert volts == pytest.approx(2.0 * ZETA * load / (OMEGA_N * K_L))


def test_beside_eq_1_alone_only_what_shows_it_is_tried():
    assert "viscous_friction" not in further_causes(SIZES, ())
    assert "viscous_friction" in further_causes(SIZES, ("coulomb_friction",))
    tried = further_causes(SIZES, ("viscous_friction",))
    assert "coulomb_friction" in tried
    assert not {"valve_deadband", "sensor_lag", "load_spring", "load_bias"}.intersection(tried)
    assert "sensor_lag" in further_causes(SIZES, ("viscous_friction", "coulomb_friction"))
