"""Effects met live: on the virtual driver, in sensor frames, through the back door."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions
from drivers.virtual import VirtualDriver, VirtualOptions
from sim.can_messages import sensor_messages
from sim.config import SimulationConfig
from sim.rig import SimulatedRig

PLANT = {"input": "Valve.voltage", "output": "Encoder.angle", "K_L": 17.0, "omega_n": 100.0, "zeta": 0.3}
CONSTANTS = {"Encoder.run_enable": 1.0, "Supply.pressure": 7e6}
FOLLOWS = {"supply_pressure": "Supply.pressure", "nominal_pressure": 7e6}
SQUARE_ROOT = {"square_root_flow": {"supply": 1e6}}


def simulation(effects: dict[str, Any], **plant: Any) -> SimulationConfig:
    document = {
        "plants": {"motor": {**PLANT, **plant, "effects": effects}},
        "constants": CONSTANTS,
        "watchdog_s": 10.0,
    }
    return SimulationConfig.model_validate_json(json.dumps(document))


def read(effects: dict[str, Any], ticks: int = 2000) -> list[tuple[float, float, float]]:
    """Tick time, reading and its stamp at 1 kHz, on a plant that moves at 1.7 rad/s."""
    clock = [100.0]
    options = VirtualOptions(kind="virtual", realtime=False, simulation=simulation(effects))
    driver = VirtualDriver(options, lambda: clock[0])
    driver.open(["Encoder.angle"], ["Valve.voltage"])
    driver.start()
    rows = []
    for _ in range(ticks):
        (sample,) = driver.read(clock[0])
        rows.append((clock[0], sample.value, sample.t))
        driver.write(clock[0], [0.1])
        clock[0] += 1e-3
    driver.close()
    return rows


def test_a_missing_sample_is_the_one_before_with_its_old_stamp() -> None:
    rows = read({"missing_samples": {"rate": 0.2, "length": 3.0}})
    first = next(k for k, (t, _, stamp) in enumerate(rows) if t == stamp)
    assert all(math.isnan(value) and stamp == -math.inf for _, value, stamp in rows[:first])
    repeated = 0
    for (_, value, stamp), (t, next_value, next_stamp) in pairwise(rows[first:]):
        if next_stamp != t:
            assert (next_value, next_stamp) == (value, stamp)
            repeated += 1
    assert 0.1 < repeated / len(rows) < 0.3


def test_a_jittering_sample_is_off_by_its_speed_and_its_stamps_run_evenly() -> None:
    rows, exact = read({"timing_jitter": {"deviation": 5e-5}}), read({})
    late = [t - stamp for t, _, stamp in rows]
    assert max(late) == pytest.approx(min(late)) == pytest.approx(1.5e-4)
    slope = 17.0 * 0.1
    off = [
        y - (true - slope * behind) for (_, y, _), (_, true, _), behind in zip(rows, exact, late, strict=True)
    ][1000:]
    assert math.sqrt(sum(e * e for e in off) / len(off)) == pytest.approx(slope * 5e-5, rel=0.1)


def test_outliers_stand_out_and_the_rest_is_untouched() -> None:
    struck, exact = read({"outliers": {"rate": 0.02, "size": 5.0}}), read({})
    off = [y - true for (_, y, _), (_, true, _) in zip(struck, exact, strict=True) if y != true]
    assert 20 < len(off) < 70
    assert max(map(abs, off)) > 5.0


def test_a_missing_sample_is_a_frame_that_never_comes_but_is_counted() -> None:
    dbc = str(Path(__file__).parents[2] / "configs" / "motor.dbc")
    codec = CanCodec(CanOptions.model_validate({"kind": "can", "channel": "none", "dbc": dbc}))
    rig = SimulatedRig(simulation({"missing_samples": {"rate": 0.3}}), 0.0)
    encoder, supply = sensor_messages(codec, rig, 1000.0)
    frames = [encoder.frame(k * 1e-3, frozen=False) for k in range(1000)]
    assert 200 < frames.count(None) < 400
    for k, frame in enumerate(frames):
        if frame is not None:
            decoded = codec.decode(frame.frame_id, frame.extended, frame.data)
            assert decoded.counter == k % codec.counter_period("Encoder")
    assert all(supply.frame(1.0, frozen=False) for _ in range(100))  # carries no plant's output


def test_the_speed_and_the_truth_follow_the_supply_pressure() -> None:
    rig = SimulatedRig(simulation(SQUARE_ROOT, measures="velocity", **FOLLOWS), 0.0)
    rig.apply(0.0, {"Valve.voltage": 0.5})
    before, K_L = rig.measure(1.0)["Encoder.angle"], rig.truth()["motor"]["K_L"]
    rig.set_constant(1.0, "Supply.pressure", 7e6 / 4.0)
    assert rig.measure(1.0)["Encoder.angle"] == pytest.approx(before)  # it begins there
    assert rig.measure(2.0)["Encoder.angle"] == pytest.approx(0.5 * before, rel=1e-3)
    assert rig.truth()["motor"]["K_L"] == pytest.approx(0.5 * K_L)
    assert rig.measure(2.0)["Supply.pressure"] == 7e6 / 4.0


def test_it_begins_at_the_pressure_of_its_constant() -> None:
    rig = SimulatedRig(simulation(SQUARE_ROOT, **{**FOLLOWS, "nominal_pressure": 14e6}), 0.0)
    assert rig.truth()["motor"]["K_L"] == pytest.approx(17.0 * math.sqrt(0.5))


@pytest.mark.parametrize("pressure", [0.0, -1.0])
def test_no_pressure_is_refused_and_nothing_changes(pressure: float) -> None:
    rig = SimulatedRig(simulation(SQUARE_ROOT, **FOLLOWS), 0.0)
    with pytest.raises(ValueError, match=r"Supply\.pressure is a supply pressure"):
        rig.set_constant(0.0, "Supply.pressure", pressure)
    assert rig.constants["Supply.pressure"] == 7e6


def test_effects_are_switched_on_and_off_by_name() -> None:
    rig = SimulatedRig(simulation({"null_shift": {"voltage": 0.1}}, measures="velocity"), 0.0)
    motor = rig.actuators["motor"]
    rig.apply(0.0, {"Valve.voltage": 0.5})
    assert rig.measure(1.0)["Encoder.angle"] == pytest.approx(17.0 * 0.4)
    motor.change(1.0, {"effects": {"valve_deadband": {"half_width": 0.1}}})
    assert rig.measure(2.0)["Encoder.angle"] == pytest.approx(17.0 * 0.3)
    motor.change(2.0, {"effects": {"null_shift": {}}})
    assert rig.measure(3.0)["Encoder.angle"] == pytest.approx(17.0 * 0.4)
    with pytest.raises(ValueError, match="half_widht"):
        motor.change(3.0, {"effects": {"valve_deadband": {"half_widht": 0.1}}})
    assert motor.config.effects["valve_deadband"] == {"half_width": 0.1}


def test_a_truth_that_is_none_is_null() -> None:
    stuck = {"square_root_flow": {"supply": 100.0}, "load_bias": {"acceleration": 200.0}}
    rig = SimulatedRig(simulation(stuck), 0.0)
    assert rig.truth() == {"motor": {"K_L": None, "omega_n": None, "zeta": None}}
