"""Velocity mode on a virtual rig and simulated time, its estimates against the simulated plant."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest

from seod.estimate import make_estimator
from seod.observe.estimation import Axis
from seod.processes.ring import AXIS_FIELDS, FLAG_EXCITING, AxisState
from tests.unit.loop_bench import PERIOD, Bench, merge

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytestmark = pytest.mark.slow

E_A, K_L = 0.5, 17.0
SPEED_AMPLITUDE = 26.0
"""Of the limit cycle at zeta 0.21 and omega_n 117 [rad/s]."""

VELOCITY: dict[str, Any] = {
    "sensors": {"angle": {"channel": "motor.angle", "unit": "rad/s"}},
    "axes": {
        "motor": {
            "mode": "velocity",
            "reference": 32.5,
            "ramp": 150.0,
            "relay": {"hysteresis": 0.004},
            "limits": {"output": 10.0, "travel": (-60.0, 190.0), "speed": None, "amplitude": 0.45},
            "polarity": {"movement": 3.0},
        }
    },
    "simulation": {"plants": {"motor": {"measures": "velocity", "noise": 0.02 * SPEED_AMPLITUDE}}},
}


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(motor: dict[str, Any] | None = None, plant: dict[str, Any] | None = None, **more: Any) -> Bench:
        changes = {"axes": {"motor": motor or {}}, "simulation": {"plants": {"motor": plant or {}}}}
        made.append(Bench(merge(merge(VELOCITY, changes), more)))
        made[-1].run(0.05)
        return made[-1]

    yield make
    for each in made:
        each.close()


def null_shift(volts: float) -> dict[str, Any]:
    return {"effects": {"null_shift": {"voltage": volts}}}


def until(rig: Bench, state: AxisState, seconds: float = 20.0) -> None:
    for _ in range(round(seconds / 0.01)):
        if rig.state is state:
            return
        rig.run(0.01)
    raise AssertionError(f"{rig.state.name} after {seconds} s: {rig.take()}")


def estimates(rig: Bench, method: str = "exact") -> list[Any]:
    """What the gateway makes of the rows."""
    config = rig.config.axes["motor"]
    axis = Axis("motor", config, PERIOD, make_estimator)
    if method != "exact":
        axis.change({"method": method})
    rows = [tuple(row[name] for name in (*AXIS_FIELDS, "state", "flags")) for row in rig.rows()]
    return axis.feed(rows)  # type: ignore[arg-type]  # int flags come as they are


@pytest.mark.parametrize(
    ("zeta", "omega_n", "reference"),  # others in test_velocity_truth.py
    [(0.21, 117.0, 120.0), (0.45, 145.0, 0.0), (0.8, 60.0, 32.5)],
)
def test_zeta_and_omega_n_are_the_plants_at_any_speed(
    bench: Callable[..., Bench], reference: float, zeta: float, omega_n: float
) -> None:
    """With 2 % noise on the speed and a valve null that the rig file does not know."""
    amplitude = 1.28 * K_L * E_A / (2 * zeta)
    plant = {"zeta": zeta, "omega_n": omega_n, "noise": 0.02 * amplitude, **null_shift(0.1)}
    rig = bench({"reference": reference, "estimator": {"cycles": 8}}, plant)
    assert rig.call("start") is None
    until(rig, AxisState.EXCITING)
    rig.run(1.2 + 250 / omega_n)
    answers = [a for a in estimates(rig) if a.quality == "ok"]
    assert len(answers) > 20
    last = answers[-20:]
    assert sum(a.zeta for a in last) / 20 == pytest.approx(zeta, rel=0.015)
    assert sum(a.omega_n for a in last) / 20 == pytest.approx(omega_n, rel=0.01)
    assert sum(a.mean_speed for a in last) / 20 == pytest.approx(reference, abs=0.02 * amplitude + 0.1)
    assert abs(last[-1].asymmetry) < 0.02
    assert rig.faults() == []


def test_states_and_ramps_up_and_down(bench: Callable[..., Bench]) -> None:
    rig = bench(plant={"noise": 1e-3})
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rows = rig.rows()
    run_up = [r for r in rows if r["reference"] > 0.0]
    assert run_up[-1]["reference"] == 32.5
    steps = [b["reference"] - a["reference"] for a, b in pairwise(run_up)]
    assert max(steps) <= 150.0 * PERIOD * 1.001
    assert max(r["y"] for r in rows) < 40.0  # no overshoot to speak of
    rig.run(1.0)
    rig.rows()
    rig.call("stop")
    until(rig, AxisState.IDLE)
    down = rig.rows()
    assert not any(int(r["flags"]) & FLAG_EXCITING for r in down[2:])
    volts = [abs(b["u"] - a["u"]) for a, b in pairwise(down[2:])]
    assert max(volts) < 0.02
    assert abs(down[-1]["y"]) < 0.5 * K_L * E_A
    assert [e["state"] for e in rig.take("state")] == ["armed", "exciting", "holding", "idle"]
    assert rig.volts == 0.0


def test_the_reference_changes_while_it_runs_without_a_jump(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(1.0)
    rig.rows()
    assert rig.call("set", reference=120.0) is None
    rig.run(3.0)
    rows = rig.rows()
    assert rows[-1]["reference"] == 120.0
    jumps = [abs(b["u"] - a["u"]) for a, b in pairwise(rows)]
    assert all(jump < 0.04 or abs(jump - 2 * E_A) < 0.15 for jump in jumps)
    assert sum(r["y"] for r in rows[-2000:]) / 2000 == pytest.approx(120.0, abs=1.0)
    assert rig.state is AxisState.EXCITING
    rig.call("set", reference=0.0)
    rig.run(3.0)
    assert rig.state is AxisState.EXCITING
    assert sum(r["y"] for r in rig.rows()[-2000:]) / 2000 == pytest.approx(0.0, abs=1.0)


def duty(rows: list[dict[str, float]]) -> float:
    return sum(r["u"] > r["bias"] for r in rows) / len(rows)


def test_the_trim_makes_the_halves_equal(bench: Callable[..., Bench]) -> None:
    halves = []
    for trim in (False, True):
        rig = bench({"trim": trim}, null_shift(0.3))
        rig.call("start")
        until(rig, AxisState.EXCITING)
        rig.run(4.0)
        halves.append(duty(rig.rows()[-2000:]))
    assert halves[0] == pytest.approx(0.5 + 0.3 / (2 * E_A), abs=0.02)
    assert halves[1] == pytest.approx(0.5, abs=0.02)


def test_a_bias_error_of_e_a_stops_the_oscillation_and_is_said(bench: Callable[..., Bench]) -> None:
    rig = bench({"trim": False}, null_shift(0.6))
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(4.0)
    (warning,) = [e for e in rig.take("warning") if e["code"] == "bias"]
    assert "the oscillation has stopped" in warning["why"]
    assert "correct K_L" in warning["why"]
    rows = rig.rows()
    assert max(abs(r["signal"]) for r in rows) < 0.5  # anti-windup
    assert max(abs(r["signal"]) for r in rows[-100:]) < 0.1
    assert rig.faults() == []
    assert rig.call("set", bias=0.6) is None  # what the warning asks for
    rig.run(4.0)
    assert duty(rig.rows()[-2000:]) == pytest.approx(0.5, abs=0.05)


def test_the_trim_finds_its_way_out_of_a_bias_error_beyond_e_a(bench: Callable[..., Bench]) -> None:
    rig = bench({}, null_shift(0.6))
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(8.0)
    assert {e["code"] for e in rig.take("warning")} >= {"bias"}
    assert duty(rig.rows()[-2000:]) == pytest.approx(0.5, abs=0.12)
    assert rig.faults() == []


def test_settings_change_without_a_jump_beyond_the_new_level(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(1.5)
    rig.rows()
    for values in ({"K_L": 16.5}, {"trim": False}, {"hysteresis": 0.01}, {"bias": 0.1}, {"e_a": 0.7}):
        assert rig.call("set", **values) is None
        rig.run(0.5)
    rows = rig.rows()
    for a, b in pairwise(rows):
        level = max(a["e_a"], b["e_a"])
        assert abs(b["bias"] - a["bias"]) < 0.02
        assert abs(b["u"] - b["bias"]) == pytest.approx(b["e_a"]) or level == 0.0
    assert {r["K_L"] for r in rows} == {17.0, 16.5}
    assert rows[-1]["e_a"] == 0.7
    assert next(e["values"] for e in rig.take("changed")) == {"K_L": 16.5}


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"reference": -60.0}, "limits.travel"),
        ({"reference": 165.0}, "limits.output"),
        ({"K_L": 2.0}, "limits.output"),
        ({"K_L": -17.0}, "must lie within limits.K_L"),
        ({"e_a": 9.0}, "limits.output"),
        ({"K_L": math.nan}, "finite"),
    ],
)
def test_settings_are_held_against_the_limits(
    bench: Callable[..., Bench], values: dict[str, float], told: str
) -> None:
    rig = bench()
    assert told in str(rig.loop.axes[0].change(rig.pacer.now(), values))
    assert rig.loop.axes[0].settings["reference"] == 32.5


def test_position_mode_has_no_reference_to_set() -> None:
    rig = Bench()
    assert "position mode" in str(rig.call("set", reference=1.0))
    rig.close()


EQ_9 = {"polynomial": [4.25, 2.72e-6, -0.134e-12], "range": (5e6, 10e6)}
PRESSURE = {
    "sensors": {
        "supply": {"channel": "ps", "unit": "MPa", "kind": "pressure"},
        "oil": {"channel": "oil", "unit": "degC", "kind": "temperature"},
    },
}


def test_the_gain_follows_the_pressure(bench: Callable[..., Bench]) -> None:
    """Eq. 9 at 8 MPa is the plant's gain; a constant number would be 10 % off."""
    true = 4.25 + 2.72 * 8 - 0.134 * 64
    motor = {"K_L": EQ_9, "supply_pressure": "supply", "temperature": "oil", "estimator": {"cycles": 8}}
    more = merge(PRESSURE, {"simulation": {"constants": {"ps": 8.0, "oil": 40.0}}})
    rig = bench(motor, {"K_L": true}, **more)
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(5.0)
    last = [a for a in estimates(rig) if a.quality == "ok"][-20:]
    assert pytest.approx(true) == last[-1].K_L
    assert (last[-1].ps, last[-1].temperature) == (pytest.approx(8e6), pytest.approx(313.15))
    assert sum(a.zeta for a in last) / len(last) == pytest.approx(0.21, rel=0.015)
    assert sum(a.omega_n for a in last) / len(last) == pytest.approx(117.0, rel=0.01)


def test_without_a_pressure_nothing_starts_that_needs_it(bench: Callable[..., Bench]) -> None:
    motor = {"K_L": EQ_9, "supply_pressure": "supply", "temperature": "oil"}
    more = merge(PRESSURE, {"simulation": {"constants": {"ps": math.nan, "oil": 40.0}}})
    with pytest.raises(ValueError, match="finite"):
        bench(motor, {}, **more)
    more["simulation"]["constants"]["ps"] = 8.0
    rig = bench(motor, {}, **more)
    rig.loop.axes[0].conditions.known = False
    assert "K_L is not known" in str(rig.loop.axes[0].start(rig.pacer.now()))


def test_a_wrong_polarity_is_found_by_the_speed(bench: Callable[..., Bench]) -> None:
    rig = bench(outputs={"valve": {"scale": -1.0}})
    rig.call("start")
    rig.run(1.0)
    assert rig.faults() == ["polarity"]
    assert max(abs(r["y"]) for r in rig.rows()) < 15.0


def test_a_drive_in_velocity_mode_comes_to_rest(bench: Callable[..., Bench]) -> None:
    rig = bench()
    assert rig.call("drive", volts=1.0, duration=0.5) is None
    until(rig, AxisState.EXCITING)
    rig.run(0.4)
    assert rig.rows()[-1]["y"] == pytest.approx(17.0, abs=3.0)
    until(rig, AxisState.IDLE)
    assert abs(rig.rows()[-1]["y"]) < 5.0


def test_too_high_a_speed_trips(bench: Callable[..., Bench]) -> None:
    rig = bench({"limits": {"travel": (-60.0, 45.0)}})
    rig.call("start")
    rig.run(3.0)
    (fault,) = rig.take("fault")
    assert fault["code"] == "travel"
    assert "speed" in fault["why"]


def test_bursts_pause_at_speed(bench: Callable[..., Bench]) -> None:
    rig = bench({"excitation": {"kind": "burst", "duration": 0.5, "pause": 0.3}})
    rig.call("start")
    until(rig, AxisState.EXCITING)
    until(rig, AxisState.HOLDING)
    rig.rows()
    until(rig, AxisState.EXCITING)
    assert {r["reference"] for r in rig.rows()} == {32.5}


def test_noise_of_5_percent_on_the_speed_hardly_counts(bench: Callable[..., Bench]) -> None:
    """The integrator is the filter: what Fig. 6b has it for."""
    rig = bench({"reference": 120.0, "estimator": {"cycles": 10}}, {"noise": 0.05 * SPEED_AMPLITUDE})
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(8.0)
    last = [a for a in estimates(rig) if a.quality == "ok"][-30:]
    assert len(last) == 30
    assert sum(a.zeta for a in last) / 30 == pytest.approx(0.21, rel=0.02)
    assert sum(a.omega_n for a in last) / 30 == pytest.approx(117.0, rel=0.01)


def test_estimates_go_on_while_the_pressure_changes(bench: Callable[..., Bench]) -> None:
    """From 5 to 10 MPa in 10 s, as in Fig. 11: the gain is Eq. 9 and omega_n grows with the pressure."""
    motor = {"K_L": EQ_9, "supply_pressure": "supply", "estimator": {"cycles": 4}}
    rig = bench(
        motor, {"K_L": 14.5}, **merge(PRESSURE, {"simulation": {"constants": {"ps": 5.0, "oil": 40.0}}})
    )
    rig.call("start")
    until(rig, AxisState.EXCITING)
    rig.run(1.0)
    rig.rows()
    simulated = rig.driver.rig
    assert simulated is not None
    for k in range(201):
        ps = 5.0 + k / 40.0
        simulated.constants["ps"] = ps
        true = {"K_L": 4.25 + 2.72 * ps - 0.134 * ps * ps, "omega_n": 80.0 + 8.0 * ps}
        simulated.actuators["motor"].change(rig.pacer.now(), true)
        rig.run(0.05)
    answers = estimates(rig)
    good = [a for a in answers[20:] if a.quality == "ok"]
    assert len(good) > 0.9 * len(answers[20:])
    for a in good:
        ps = a.ps / 1e6
        true_gain = 4.25 + 2.72 * ps - 0.134 * ps * ps
        assert abs(a.K_L - true_gain) < 0.02 * true_gain
        assert a.omega_n == pytest.approx(80.0 + 8.0 * ps, rel=0.03)
        assert a.zeta == pytest.approx(0.21, rel=0.15)
    assert sum(a.zeta for a in good) / len(good) == pytest.approx(0.21, rel=0.02)
    assert rig.faults() == []


def test_an_axis_that_waits_for_its_turn_rests(bench: Callable[..., Bench]) -> None:
    rig = bench()
    axis = rig.loop.axes[0]
    axis.start(rig.pacer.now(), waiting=True)
    rig.run(1.5)
    assert rig.state is AxisState.HOLDING
    rows = rig.rows()[-200:]
    assert abs(sum(r["y"] for r in rows)) / 200 < 1.0
    axis.course.go_on(rig.pacer.now())
    until(rig, AxisState.EXCITING)
    assert rig.rows()[-1]["y"] == pytest.approx(32.5, abs=6.0)
    axis.course.wait(rig.pacer.now(), "its turn is over")
    rig.run(2.0)
    assert rig.rows()[-1]["y"] == pytest.approx(0.0, abs=6.0)
