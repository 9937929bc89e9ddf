"""Sensor kinds in a whole loop: simulated sensors against the plant they look at, faults, homing, noise."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

from seod.config.sensors import sensor_or_none
from seod.estimate import make_estimator
from seod.loop.sensor import make_sensor
from seod.observe.estimation import Axis
from seod.processes.ring import AXIS_FIELDS, FLAG_SATURATED, AxisState
from sim.actuator import Actuator
from sim.config import PlantConfig, SimulationConfig
from sim.rig import SimulatedRig
from tests.unit.loop_bench import PERIOD, Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CRANK = {"base": 0.5, "rod": 0.45, "arm": 0.1, "zero": 0.05}
STROKES, ANGLES = [-0.06, -0.02, 0.01, 0.06], [-0.7, -0.2, 0.1, 0.8]

KINDS: dict[str, tuple[dict[str, Any], dict[str, Any], float]] = {
    "incremental": (
        {"kind": "incremental_encoder", "unit": "deg", "bits": 12, "counts_per_rev": 1e5},
        {"kind": "incremental_encoder", "bits": 12, "counts_per_unit": 1e5 / (2 * math.pi), "start": 4000},
        2 * math.pi / 1e5,
    ),
    "incremental, the other way round": (
        {"kind": "incremental_encoder", "unit": "rad", "bits": 16, "counts_per_unit": -2e4},
        {"kind": "incremental_encoder", "bits": 16, "counts_per_unit": -2e4},
        1 / 2e4,
    ),
    "absolute": (
        {"kind": "absolute_encoder", "unit": "rad", "bits": 17, "offset": 0.5},
        {"kind": "absolute_encoder", "counts_per_rev": 1 << 17, "zero": 0.5},
        2 * math.pi / (1 << 17),
    ),
    "absolute, the other way round": (
        {"kind": "absolute_encoder", "unit": "deg", "bits": 14, "counts_per_rev": -16000},
        {"kind": "absolute_encoder", "counts_per_rev": 16000, "sign": -1},
        2 * math.pi / 16000,
    ),
    "scale on a crank": (
        {"kind": "linear_scale", "unit": "mm", "scale": 10, "offset": -30, "linkage": {"crank": CRANK}},
        {"kind": "linear_scale", "scale": 100.0, "offset": 3.0, "crank": CRANK},
        1e-9,
    ),
    "scale by a table": (
        {
            "kind": "linear_scale",
            "unit": "m",
            "linkage": {"table": {"stroke": STROKES, "angle": ANGLES, "interpolation": "linear"}},
        },
        {"kind": "linear_scale", "table": {"stroke": STROKES, "angle": ANGLES}},
        1e-9,
    ),
    "linear": (
        {"kind": "linear", "unit": "deg", "scale": 18.0, "offset": -9.0},
        {"kind": "linear", "scale": 10 / math.pi, "offset": 0.5},
        1e-9,
    ),
}
"""Rig file's section, the simulated sensor's, and how far they may be apart [rad]."""


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(sensor: dict[str, Any], simulated: dict[str, Any] | None, **plant: Any) -> Bench:
        channel = {"channel": "motor.angle", "unit": "rad"}
        simulation = {"plants": {"motor": {"sensor": simulated, **plant}}}
        made.append(Bench({"sensors": {"angle": channel | sensor}, "simulation": simulation}))
        made[-1].run(0.05)
        return made[-1]

    yield make
    for each in made:
        each.close()


def truth(rig: Bench) -> dict[str, Any]:
    assert rig.driver.rig is not None
    return rig.driver.rig.state(rig.pacer.now())["motor"]


def plant(rig: Bench) -> SimulatedRig:
    assert rig.driver.rig is not None
    return rig.driver.rig


@pytest.mark.parametrize("kind", KINDS)
def test_the_axis_sees_the_plant_through_any_kind(bench: Callable[..., Bench], kind: str) -> None:
    """From first to last sample of a limit cycle the reading differs from the position by a constant."""
    sensor, simulated, step = KINDS[kind]
    rig = bench(sensor, simulated, noise=0.0)
    rig.call("start")
    apart = []
    for _ in range(400):
        rig.run(0.0025)
        apart.append(rig.loop.axes[0].y - truth(rig)["position"])
    assert rig.state is AxisState.EXCITING, rig.faults()
    assert max(apart) - min(apart) <= 2 * step
    if "incremental" not in kind:  # it starts at 0 where it stands, which is 0 here but for a count
        assert apart[0] == pytest.approx(0.0, abs=2 * step)


def test_an_encoder_with_an_index_is_homed_by_hand_before_it_may_start(bench: Callable[..., Bench]) -> None:
    sensor, simulated, step = KINDS["incremental"]
    index = {"channel": "motor.index", "position": 0.3}
    rig = bench(sensor | {"index": {"channel": "motor.index"}}, simulated | {"index": index}, noise=0.0)
    assert "index mark has not passed" in (rig.call("start") or "")
    for position in (0.1, 0.2, 0.3 + step, 0.4):
        plant(rig).actuators["motor"].change(rig.pacer.now(), {"position": position})
        rig.run(0.002)
    assert rig.loop.axes[0].y == pytest.approx(0.1, abs=3 * step)
    assert rig.call("start") is None


def test_a_broken_wire_stops_the_rig_in_the_same_tick(bench: Callable[..., Bench]) -> None:
    rig = bench({"kind": "linear", "range": (-1.0, 1.0)}, None)
    rig.call("start")
    rig.run(1.0)
    assert rig.state is AxisState.EXCITING
    plant(rig).actuators["motor"].change(rig.pacer.now(), {"position": 1.5})
    rig.run(0.0005)
    assert rig.state is AxisState.FAULT
    assert rig.faults() == ["sensor_range"]
    assert "a sound sensor -1 to 1" in rig.take("fault")[0]["why"]
    assert rig.volts == 0.0
    rig.call("reset")
    assert "a sound sensor" in (rig.call("start") or "")


def test_rows_tell_where_the_sensor_clips(bench: Callable[..., Bench]) -> None:
    rig = bench({"kind": "linear", "saturation": (-0.15, 0.15)}, None)
    rig.call("start")
    rig.run(1.0)
    rows = rig.rows()
    marked = [bool(int(row["flags"]) & FLAG_SATURATED) for row in rows]
    assert marked == [abs(row["y"]) >= 0.15 for row in rows]
    assert any(marked)


@pytest.mark.slow
def test_zeta_and_omega_n_are_right_behind_a_converter_that_lags_and_ripples() -> None:
    """Velocity mode at 32.5 rad/s; the ripple is of 500 Hz there."""
    sensor = {"kind": "fv_converter", "unit": "rad/s", "scale": 20.0, "lag": 1.5e-3}
    converter = {"kind": "fv_converter", "volts_per_unit": 0.05, "lag": 1.5e-3}
    ripple = {"ripple": 0.02, "ripples_per_unit": 500 / 32.5}
    limits = {"output": 10.0, "travel": (-60.0, 190.0), "speed": None, "amplitude": 0.45}
    axis = {"mode": "velocity", "reference": 32.5, "limits": limits, "polarity": {"movement": 3.0}}
    plant = {"zeta": 0.45, "omega_n": 145.0, "sensor": converter | ripple, "noise": 0.05}
    rig = Bench(
        {
            "sensors": {"angle": sensor},
            "axes": {"motor": axis},
            "simulation": {"plants": {"motor": plant}},
        }
    )
    rig.run(0.05)
    assert rig.call("start") is None
    rig.run(4.0)
    rows = [tuple(row[name] for name in (*AXIS_FIELDS, "state", "flags")) for row in rig.rows()]
    for lag, right in ((1.5e-3, True), (0.0, False)):
        seen = Axis("motor", rig.config.axes["motor"], PERIOD, make_estimator, lag)
        last = seen.feed(rows)[-20:]  # type: ignore[arg-type]  # int flags come as they are
        assert {answer.quality for answer in last} == {"ok" if right else "nonlinear"}
        zeta, omega_n = (sum(getattr(a, name) for a in last) / 20 for name in ("zeta", "omega_n"))
        assert (zeta == pytest.approx(0.45, rel=0.01)) is right
        assert (omega_n == pytest.approx(145.0, rel=0.01)) is right
    rig.close()


# The simulated F/V converter and its reading


def fv_rig(**sensor: Any) -> SimulatedRig:
    converter = {"kind": "fv_converter", "volts_per_unit": 0.1, "offset_v": 0.3, **sensor}
    section = {"input": "u", "output": "v", "K_L": 17.0, "omega_n": 117.0, "zeta": 0.5, "sensor": converter}
    config = SimulationConfig.model_validate({"plants": {"motor": section}, "watchdog_s": 10.0})
    return SimulatedRig(config, 0.0)


def run_fv(rig: SimulatedRig, seconds: float, volts: float = 1.0) -> list[tuple[float, float, float]]:
    """Time [s], true speed [rad/s] and channel [V], each 0.5 ms."""
    rig.apply(0.0, {"u": volts})
    out = []
    for k in range(1, int(seconds / 5e-4)):
        reading = rig.measure(k * 5e-4)["v"]
        out.append((k * 5e-4, float(rig.state(k * 5e-4)["motor"]["velocity"] or 0.0), reading))
    return out


def test_an_fv_converter_is_read_back_as_speed() -> None:
    config = sensor_or_none(
        '{"kind": "fv_converter", "channel": "v", "unit": "rad/s", "scale": 10, "offset_v": 0.3}'
    )
    assert config is not None
    sensor = make_sensor(config)
    for _, speed, volts in run_fv(fv_rig(), 0.1):
        assert sensor.read(volts) == pytest.approx(speed, abs=1e-9)


def test_its_lag_is_of_first_order() -> None:
    """On a speed that has settled, and on the way there behind by tau times the slope."""
    run = run_fv(fv_rig(lag=2e-3), 0.4)
    _, speed, volts = run[-1]
    assert (volts - 0.3) * 10 == pytest.approx(speed, rel=1e-6)
    seen = 0.0
    for (t0, v0, _), (t1, v1, volts) in pairwise(run):
        if t0 == run[0][0]:
            seen = (run[0][2] - 0.3) * 10
        for k in range(50):  # the differential equation itself, in small steps
            now = v0 + (v1 - v0) * (k + 0.5) / 50
            seen += (now - seen) * (t1 - t0) / 50 / 2e-3
        assert (volts - 0.3) * 10 == pytest.approx(seen, abs=0.02)


def test_its_ripple_is_a_multiple_of_the_speed_and_its_voltage_clips() -> None:
    run = run_fv(fv_rig(ripple=0.05, ripples_per_unit=3.0), 2.0)[2000:]
    ripple = [volts - 0.3 - 0.1 * speed for _, speed, volts in run]
    assert max(ripple) == pytest.approx(0.05 * 1.7, rel=0.02)
    turns = sum(a < 0.0 <= b for a, b in pairwise(ripple))
    assert turns == pytest.approx(3.0 * 17.0 * (run[-1][0] - run[0][0]), abs=1)
    assert max(volts for _, _, volts in run_fv(fv_rig(clip=(-1.0, 1.0)), 0.2)) == 1.0


def test_noise_is_in_what_is_measured() -> None:
    """An encoder's counts jitter by the angle's noise."""
    sensor, simulated, _ = KINDS["incremental"]
    section = {"input": "u", "output": "y", "K_L": 17.0, "omega_n": 117.0, "zeta": 0.5, "noise": 0.01}
    actuator = Actuator(PlantConfig.model_validate(section | {"sensor": simulated}), 1.0, Random(1), 0.0)
    counts = [actuator.measure(0.0) for _ in range(2000)]
    config = sensor_or_none(json.dumps(sensor | {"channel": "y"}))
    assert config is not None
    encoder = make_sensor(config)
    angles = [encoder.read(count) for count in counts]
    mean = sum(angles) / len(angles)
    deviation = math.sqrt(sum((angle - mean) ** 2 for angle in angles) / len(angles))
    assert deviation == pytest.approx(0.01, rel=0.1)
