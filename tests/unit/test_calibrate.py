"""Calibration against truth: lines and responses with noise, the procedure on simulated rigs, the file."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from seod.calibrate.command import as_json, as_text, changes
from seod.calibrate.delay import Response, fit_response, unit_step
from seod.calibrate.procedure import CalibrationError, Edge, Plan, Procedure, Result
from seod.calibrate.recording import Recording, recording
from seod.calibrate.static import Line, Point, Static, by_pressure, characteristic, fit_line, steady_speed
from seod.calibrate.value import Value, mean, measured
from seod.config.edit import edited, replace_file
from seod.config.errors import ConfigErrors
from seod.config.gain_in_force import gain_of
from seod.config.load import load_rig, load_text
from seod.config.yaml_lines import parse
from seod.files.shipped import configs_dir
from seod.processes.ring import FLAG_FRESH, AxisState
from tests.unit.linear_plant import LinearPlant
from tests.unit.loop_bench import Bench, merge

if TYPE_CHECKING:
    from pathlib import Path

REST_S = 0.15
"""How long an axis is left alone before each drive."""
REST_ROWS = 150
"""Rows of that which are used."""


class BenchRig:
    """An axis of the test bench, driven as the client drives one over TCP."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        bench.run(REST_S)
        self.rest = samples(bench, AxisState.IDLE)

    def drive(self, volts: float, duration: float, stay: bool = False) -> Recording:
        error = self.bench.call("drive", 0, volts=volts, duration=duration, stay=stay)
        assert error is None, error
        while self.bench.state is not AxisState.IDLE:
            self.bench.run(0.02)
            if self.bench.state is AxisState.FAULT:
                raise CalibrationError(self.bench.take("fault")[-1]["why"])
        self.bench.run(REST_S)
        rows = self.bench.rows()
        rest, self.rest = self.rest, chosen(rows, AxisState.IDLE)
        return recording(rest, chosen(rows, AxisState.EXCITING))

    def position(self) -> float:
        return self.bench.loop.axes[0].y

    def set_bias(self, volts: float) -> None:
        assert self.bench.call("set", 0, bias=volts) is None


def samples(bench: Bench, state: AxisState) -> list[dict[str, Any]]:
    return chosen(bench.rows(), state)


def chosen(rows: list[dict[str, float]], state: AxisState) -> list[dict[str, Any]]:
    names = ("t", "y", "u", "t_u")
    kept = [row for row in rows if row["state"] == state]
    return [
        {**{n: row[n] for n in names}, "ps": None, "fresh": bool(int(row["flags"]) & FLAG_FRESH)}
        for row in kept
    ][-REST_ROWS if state is AxisState.IDLE else 0 :]


def calibrated(K_L: float, rate_hz: float, **plant: Any) -> tuple[Result, float]:
    """Result on a simulated rig, and how far from its start the actuator ends."""
    changes = {"axes": {"motor": {"K_L": K_L}}, "simulation": {"plants": {"motor": plant}}}
    bench = Bench(merge({"loop": {"rate_hz": rate_hz}}, changes))
    try:
        rig = BenchRig(bench)
        start = rig.position()
        result = Procedure(rig, Plan(K_L, (-2.0, 2.0), 2.0, 0.5), lambda *_: None).run()
        return result, rig.position() - start
    finally:
        bench.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "rate_hz", "plant"),
    [
        (17.0, 1000.0, {"noise": 1e-3, "effects": {"null_shift": {"voltage": 0.02}}}),
        (
            21.0,
            1000.0,
            {
                "zeta": 0.8,
                "omega_n": 60.0,
                "effects": {"null_shift": {"voltage": -0.03}, "valve_saturation": {"limit": 1.0}},
            },
        ),
        (14.0, 2000.0, {"zeta": 1.6, "effects": {"null_shift": {"voltage": 0.01}}}),
    ],
)
def test_finds_what_the_simulated_rig_is(file: float, rate_hz: float, plant: dict[str, Any]) -> None:
    result, off = calibrated(file, rate_hz, **plant)
    static, null = result.static, plant["effects"]["null_shift"]["voltage"]
    assert static.K_L.value == pytest.approx(17.0, rel=0.01)
    assert static.null.value == pytest.approx(null, abs=1e-3)
    assert abs(static.K_L.value - 17.0) < 4.5 * static.K_L.sd
    assert result.response.omega_n == pytest.approx(plant.get("omega_n", 117.0), rel=0.05)
    assert abs(result.delay.value) < 4.5 * result.delay.sd + 2e-5
    assert result.down.moves < null < result.up.moves
    assert abs(off) < 0.4


def test_wrong_polarity_ends_it_with_the_guards_reason() -> None:
    bench = Bench({"outputs": {"valve": {"scale": -1.0}}})
    try:
        with pytest.raises(CalibrationError, match="wrong sign"):
            Procedure(BenchRig(bench), Plan(17.0, (-2.0, 2.0), 2.0, 0.5), lambda *_: None).run()
    finally:
        bench.close()


class DeadRig:
    """A quick integrator with a deadband, bias and drift; nothing of it is in the simulation."""

    def __init__(self, low: float, high: float, noise: float) -> None:
        self.low, self.high, self.noise = low, high, noise
        self.y = self.bias = self.t = 0.0
        self.random = np.random.default_rng(3)
        self.furthest = 0.0

    def speed(self, volts: float) -> float:
        return 17.0 * (volts - self.high) if volts > self.high else 17.0 * min(0.0, volts - self.low)

    def drive(self, volts: float, duration: float, stay: bool = False) -> Recording:
        u = volts + self.bias
        plant = LinearPlant(17.0, 117.0, 0.5, position=self.y)
        t = np.arange(-0.1, duration, 5e-4)
        y = np.empty_like(t)
        for k, each in enumerate(t):
            plant.advance(5e-4, self.speed(u) / 17.0 if each > 0.0 else 0.0)
            y[k] = plant.position
        self.furthest = max(self.furthest, *abs(y))
        self.y = y[-1] if stay else self.y
        return Recording(t, y + self.random.normal(0.0, self.noise, len(t)), u, 0.0, u, math.nan)

    def position(self) -> float:
        return self.y

    def set_bias(self, volts: float) -> None:
        self.bias = volts


def test_edges_of_a_deadband_lie_in_their_brackets_and_null_between() -> None:
    rig = DeadRig(-0.01, 0.02, 2e-4)
    procedure = Procedure(rig, Plan(17.0, (-1.0, 1.0), 2.0, 0.5), lambda *_: None)
    up, down = procedure.edge(1.0, 0.1), procedure.edge(-1.0, 0.1)
    step = 5e-3  # the speed that counts as movement, over the gain
    assert up.still - step <= 0.02 <= up.moves
    assert down.moves <= -0.01 <= down.still + step
    static = procedure.speeds(0.1, up, down)
    assert static.null.value == pytest.approx(0.005, abs=2e-3)
    assert static.K_L.value == pytest.approx(17.0, rel=0.01)
    assert rig.furthest < 1.0


def test_something_that_never_moves_is_said() -> None:
    rig = DeadRig(-9.0, 9.0, 1e-4)
    with pytest.raises(CalibrationError, match="is the pressure on"):
        Procedure(rig, Plan(17.0, (-1.0, 1.0), 2.0, 0.5), lambda *_: None).edge(1.0, 0.1)


def covered(truth: float, intervals: list[tuple[float, float]]) -> float:
    return sum(low <= truth <= high for low, high in intervals) / len(intervals)


@pytest.mark.slow
def test_intervals_of_gain_and_null_cover_the_truth() -> None:
    random = np.random.default_rng(1)
    volts = np.array([-0.08, -0.06, -0.05, -0.03, 0.03, 0.05, 0.06, 0.08])
    sd = np.array([3.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0]) * 1e-3
    found = [
        characteristic(
            [
                Point(v, s, e)
                for v, s, e in zip(volts, random.normal(17.0 * (volts - 0.01), sd), sd, strict=True)
            ],
            0.0,
        )
        for _ in range(1000)
    ]
    assert 0.93 <= covered(17.0, [each.K_L.interval for each in found]) <= 0.97
    assert 0.93 <= covered(0.01, [each.null.interval for each in found]) <= 0.97


def test_interval_of_a_speed_covers_the_truth() -> None:
    random = np.random.default_rng(2)
    t = np.arange(0.0, 0.2, 1e-3)
    points = [
        steady_speed(
            Recording(t, 3.0 * t + random.normal(0.0, 0.01, len(t)), 1.0, 0.0, 1.0, math.nan), 0.05, False
        )
        for _ in range(1000)
    ]
    assert 0.93 <= covered(3.0, [(p.speed - 1.96 * p.sd, p.speed + 1.96 * p.sd) for p in points]) <= 0.97


@pytest.mark.parametrize("measures_speed", [False, True])
@pytest.mark.parametrize("zeta", [0.21, 1.0, 2.0])
def test_step_response_is_the_plants(zeta: float, measures_speed: bool) -> None:
    plant = LinearPlant(1.0, 60.0, zeta)
    truth = []
    for _ in range(300):
        plant.advance(1e-3, 1.0)
        truth.append(plant.velocity if measures_speed else plant.position)
    t = 1e-3 * np.arange(1, 301)
    assert unit_step(t, 60.0, zeta, measures_speed) == pytest.approx(np.array(truth), abs=1e-4)
    assert not unit_step(-t, 60.0, zeta, measures_speed).any()


@pytest.mark.slow
@pytest.mark.parametrize("measures_speed", [False, True])
def test_delay_is_found_and_its_interval_covers(measures_speed: bool) -> None:
    random = np.random.default_rng(4)
    t = np.arange(-0.1, 0.15, 5e-4)
    clean = 17.0 * 0.3 * unit_step(t - 2.5e-3, 117.0, 0.3, measures_speed)
    noise = 2e-2 if measures_speed else 5e-4
    found = []
    for _ in range(12):
        y = clean + random.normal(0.0, noise, len(t)) + (0.0 if measures_speed else 0.2 * t)
        found.append(fit_response(Recording(t, y, 0.3, 0.0, 0.3, math.nan), 15.0, measures_speed).delay)
    delay = mean(found)
    assert abs(delay.value - 2.5e-3) < 4.0 * delay.sd
    assert delay.sd < 2e-4


def test_no_response_is_said() -> None:
    t = np.arange(-0.1, 0.15, 5e-4)
    with pytest.raises(ValueError, match="did not follow"):
        fit_response(Recording(t, -unit_step(t, 117.0, 0.3, False), 0.3, 0.0, 0.3, math.nan), 15.0, False)


def test_lines_need_points_that_differ() -> None:
    with pytest.raises(ValueError, match="too few"):
        fit_line([Point(1.0, 1.0, 0.1)] * 2)
    with pytest.raises(ValueError, match="one voltage"):
        fit_line([Point(1.0, 1.0, 0.1)] * 4)


def static_at(ps: float, K_L: float = 17.0) -> Static:
    value = measured(K_L, 0.01, 6)
    return Static(value, measured(0.01, 1e-4, 6), Line(value, value, 6, 1.0), None, ps)


def test_pressures_ascend_and_equal_ones_count_once() -> None:
    found = by_pressure([static_at(8e6), static_at(5e6), static_at(8.1e6)])
    assert [round(each.ps) for each in found] == [5_000_000, 8_000_000]
    assert all(a.ps < b.ps for a, b in pairwise(found))


def test_results_go_into_the_file_and_nothing_else_changes(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    before = (configs_dir() / "virtual.yaml").read_text()
    path.write_text(before)
    line = Line(measured(17.01, 0.01, 6), measured(0.02, 1e-5, 6), 6, 1.0)
    static = Static(line.K_L, line.zero, line, line, math.nan)
    response = Response(17.0, 117.0, 0.21, 1e-5, 1e-3)
    edges = Edge(0.0201, 0.0202), Edge(0.0199, 0.0198)
    result = Result(static, *edges, measured(1e-5, 1e-5, 5), response)
    answer = as_json(result, [result.static], "ok")
    assert "K_L_up" in as_text("motor", load_rig(path).axes["motor"], answer)
    after = edited(before, changes("motor", load_rig(path).axes["motor"], answer, parse(before).value))
    gone = [line for line in before.splitlines() if line not in after.splitlines()]
    assert [line.split(":")[0].strip() for line in gone] == [
        "K_L",
        "bias",
    ]  # of the delay the interval holds 0
    backup = replace_file(path, after)
    assert backup.read_text() == before
    axis = load_rig(path).axes["motor"]
    assert axis.relay.bias == pytest.approx(0.02, abs=1e-4)
    assert axis.calibration is not None
    low, high = axis.calibration.K_L.interval
    assert low < axis.calibration.K_L.value < high
    assert edited(after, changes("motor", axis, answer, parse(after).value)) == after


def answer_of(null: Value, delay: Value, K_L: float = 0.051) -> dict[str, Any]:
    line = Line(measured(K_L, 0.001, 6), null, 6, 1.0)
    static = Static(line.K_L, line.zero, line, line, math.nan)
    edges = Edge(0.0201, 0.0202), Edge(0.0199, 0.0198)
    result = Result(static, *edges, delay, Response(17.0, 117.0, 0.21, 1e-5, 1e-3))
    return as_json(result, [result.static], "ok")


def in_units() -> str:
    """The shipped rig on a ram: every value in use carries a unit."""
    text = (configs_dir() / "virtual.yaml").read_text()
    for old, new in (
        ("unit: rad", "unit: m"),
        (" mrad", " mm"),
        (" deg", " mm"),
        ("speed: 60 rad/s", "speed: 60 m/s"),
        ("\n    K_L: 17 ", "\n    K_L: 50 mm/s/V "),
        ("amplitude: 0.45 rad", "amplitude: 50 mm"),
        ("bias: 0 V", "bias: 10 mV"),
        ("delay: 0 s", "delay: 1.5 ms"),
    ):
        assert old in text
        text = text.replace(old, new, 1 if "K_L" in old else -1)
    return text


def test_values_in_use_keep_their_units() -> None:
    before = in_units()
    axis = load_text(before, "x", configs_dir()).axes["motor"]
    answer = answer_of(measured(0.02, 1e-3, 6), measured(2e-3, 1e-4, 5))
    after = edited(before, changes("motor", axis, answer, parse(before).value))
    for line in ("    K_L: 51 mm/s/V ", "      bias: 20 mV ", "      delay: 2 ms "):
        assert f"\n{line}" in after
    again = load_text(after, "x", configs_dir()).axes["motor"]
    assert (again.K_L, again.relay.bias, again.estimator.delay) == pytest.approx((0.051, 0.02, 0.002))
    said = as_text("motor", axis, answer)
    assert "m/s/V" in said
    assert "SI" not in said


def test_what_cannot_be_told_from_zero_is_zero() -> None:
    before = in_units()
    noise = answer_of(measured(0.0003, 1e-3, 6), measured(2e-5, 1e-4, 5))
    axis = load_text(before, "x", configs_dir()).axes["motor"]
    after = edited(before, changes("motor", axis, noise, parse(before).value))
    assert "      bias: 0 mV " in after
    assert "      delay: 0 ms " in after
    shipped = (configs_dir() / "virtual.yaml").read_text()
    axis = load_text(shipped, "x", configs_dir()).axes["motor"]
    found = changes("motor", axis, noise, parse(shipped).value)
    assert [path[-1] for path in found] == [
        "K_L",
        "calibration",
    ]  # what is zero already stays as it is written
    with pytest.raises(CalibrationError, match="cannot be told from 0"):
        changes("motor", axis, answer_of(measured(0.0, 1.0, 6), measured(0.0, 1.0, 5), 0.001), {})


def test_gain_at_several_pressures_becomes_a_table_that_the_rig_file_reads(tmp_path: Path) -> None:
    before = (configs_dir() / "servo-virtual.yaml").read_text()
    path = tmp_path / "rig.yaml"
    path.write_text(before)
    (name, axis), *_ = load_rig(path).axes.items()
    statics = by_pressure([static_at(8e6, 17.5), static_at(5e6, 14.0), static_at(6.5e6, 16.0)])
    edges = Edge(0.0201, 0.0202), Edge(0.0199, 0.0198)
    result = Result(statics[-1], *edges, measured(1e-5, 1e-5, 5), Response(17.0, 117.0, 0.21, 1e-5, 1e-3))
    answer = as_json(result, statics, "ok")
    assert "K_L at 5e+06 Pa: 14" in as_text(name, axis, answer)
    replace_file(path, edited(before, changes(name, axis, answer, parse(before).value)))
    gain = gain_of(load_rig(path).axes[name].K_L)
    assert [gain(ps) for ps in (4e6, 5e6, 5.75e6, 8e6, 9e6)] == pytest.approx([14.0, 14.0, 15.0, 17.5, 17.5])


@pytest.mark.parametrize("path", sorted(configs_dir().glob("*.yaml")), ids=lambda path: path.name)
def test_a_file_that_nothing_is_changed_in_stays_the_same(path: Path) -> None:
    assert edited(path.read_text(), {}) == path.read_text()


def test_a_text_that_is_no_rig_file_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text((configs_dir() / "virtual.yaml").read_text())
    with pytest.raises(ConfigErrors):
        replace_file(path, edited(path.read_text(), {("axes", "motor", "K_L"): -1.0}))
    assert [each.name for each in tmp_path.iterdir()] == ["rig.yaml"]
    assert path.read_text() == (configs_dir() / "virtual.yaml").read_text()
