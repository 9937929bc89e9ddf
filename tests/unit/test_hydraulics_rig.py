"""`plant: hydraulic` where plants are used: live, in recordings, beside the rig, behind a crank."""

import json
import math
from random import Random

import numpy as np
import pytest
from test_hydraulics import MOTOR, ROD, merged, plant, run

from drivers import driver_class
from seod.cli import app
from seod.config.load import load_rig
from seod.config.truth import truth
from seod.diagnose.extend.model import Model
from seod.diagnose.extend.rig_file import into_config
from seod.files.shipped import configs_dir
from seod.model_monitor.models import linear_model
from sim.actuator import Actuator
from sim.can_rig import CanRig
from sim.config import SimulationConfig
from sim.hydraulics.live import HydraulicPlant
from sim.hydraulics.record import record_of
from sim.rig import SimulatedRig
from sim.sensor_config import AdcTruth
from sim.sensors import counted
from sim.serial_rig import SerialRig
from tests.command_line import CliRunner

SERVO = configs_dir() / "servo-hydraulic.yaml"


def test_live_and_recorded_are_the_same_movement():
    config = plant(effects={"transport_delay": {"time": 7e-4}})
    live = HydraulicPlant(record_of(config))
    t = np.arange(400) * 5e-4
    u = np.sign(np.sin(100 * t))
    seen = []
    for now, volts in zip(t.tolist(), u.tolist(), strict=True):
        seen.append(live.measured(now))
        live.command(now, volts)
    assert np.allclose(seen, run(config, t, u)[0], rtol=0, atol=1e-9)
    assert live.t == t[-1]


def test_an_actuator_takes_new_parts_and_its_watchdog_acts():
    actuator = Actuator(plant(), 0.02, Random(1), 0.0)
    for k in range(400):
        actuator.command(1e-3 * k, 1.0)
    fast = actuator.plant.velocity
    actuator.change(0.4, {"hydraulic": {"supply": {"pressure": 4e6}}})
    assert actuator.config.hydraulic["supply"]["pressure"] == 4e6
    assert actuator.config.hydraulic["load"] == MOTOR["load"]
    for k in range(400, 800):
        actuator.command(1e-3 * k, 1.0)
    assert actuator.plant.velocity == pytest.approx(fast * math.sqrt(0.5), rel=0.01)
    actuator.advance(2.0)
    assert actuator.tripped
    assert abs(actuator.plant.velocity) < 1e-3
    with pytest.raises(ValueError, match="cannot change"):
        actuator.change(2.0, {"plant": "reduced"})


def test_a_rig_follows_its_supply_pressure():
    config = plant(supply_pressure="ps", nominal_pressure=8e6)
    rig = SimulatedRig(SimulationConfig(plants={"m": config}, constants={"ps": 8e6}), 0.0)
    before = rig.truth()["m"]
    rig.set_constant(0.1, "ps", 4e6)
    after = rig.truth()["m"]
    assert after["K_L"] == pytest.approx(before["K_L"] * math.sqrt(0.5), rel=1e-3)
    assert after["omega_n"] < before["omega_n"]
    assert before["K_L"] == pytest.approx(config.K_L)


def test_truth_in_velocity_mode_is_that_about_the_reference():
    config = load_rig(SERVO)
    at_speed = truth(config)["motor"]["zeta"]
    assert at_speed > 2 * config.simulation.plants["motor"].zeta  # which is that at rest


@pytest.mark.slow
def test_simulate_writes_a_recording_and_its_truth(tmp_path):
    out = tmp_path / "run.csv"
    words = [
        "simulate",
        str(SERVO),
        "--out",
        str(out),
        "--duration",
        "1",
        "--effect",
        "coulomb_friction.level=50",
    ]
    first = CliRunner().invoke(app, words)
    assert first.exit_code == 0, first.output
    told = json.loads(first.stdout)
    assert told["truth"]["small_signal"]["zeta"] > 1.0
    assert told["truth"]["effects"]["coulomb_friction"] == {"level": 50.0}
    bytes_then = out.read_bytes()
    CliRunner().invoke(app, words)
    assert out.read_bytes() == bytes_then
    refused = CliRunner().invoke(app, [*words[:-1], "backlash.gap=0.1"])
    assert refused.exit_code != 0
    assert "backlash" in refused.output


def test_a_warm_start_moves_at_the_reference_from_the_first_row(tmp_path):
    out = tmp_path / "run.csv"
    words = ["simulate", str(SERVO), "--out", str(out), "--duration", "0.5", "--noise", "0"]
    assert CliRunner().invoke(app, words).exit_code == 0
    first = out.read_text().splitlines()[1].split(",")
    assert 25.0 < max(map(float, first[:3])) < 35.0


def test_the_model_beside_the_rig_is_the_reduced_one():
    model = linear_model(load_rig(SERVO), "motor")
    assert model is not None


def test_an_extended_rig_is_one_of_equation_1():
    config = load_rig(SERVO)
    text = into_config(SERVO.read_text(), config, "motor", Model(17.0, 60.0, 0.8, {}))
    assert "hydraulic:" not in text
    assert "plant: hydraulic" not in text
    assert "omega_n: 60" in text


def test_a_converter_counts_and_clips():
    adc = AdcTruth(bits=4, range=(-1.0, 2.0))
    assert [counted(adc, x) for x in (-5.0, 0.09, 0.11, 5.0)] == pytest.approx([-1.0, 0.0, 0.2, 2.0])
    assert counted(None, 0.123) == 0.123
    with pytest.raises(ValueError, match="rise"):
        AdcTruth(range=(1.0, 1.0))


def test_a_cylinder_behind_a_crank_moves_by_its_lever():
    crank = {"base": 0.43, "length": 0.35, "arm": 0.25}
    behind = plant(merged(ROD, {"cylinder": crank, "load": {"inertia": 20.0}}))
    straight = plant(merged(ROD, {"load": {"inertia": 20.0}}))
    corner = math.acos((0.43**2 + 0.25**2 - 0.35**2) / (2 * 0.43 * 0.25))
    lever = 0.43 * 0.25 * math.sin(corner) / 0.35
    assert pytest.approx(lever, rel=1e-6) == straight.K_L / behind.K_L
    t = np.arange(400) * 5e-4
    turned, moved = (run(each, t, np.full(len(t), 0.5))[1]["velocity"][-1] for each in (behind, straight))
    assert moved / turned == pytest.approx(lever, rel=0.05)


@pytest.mark.parametrize(("name", "end"), [("servo-can", CanRig), ("serial", SerialRig)])
def test_the_rig_at_the_other_end_of_a_line_takes_it(name, end):
    config = load_rig(configs_dir() / f"{name}.yaml")
    (was,) = config.simulation.plants.values()
    fields = {key: getattr(was, key) for key in ("input", "output", "sensor", "measures")}
    simulation = config.simulation.model_copy(update={"plants": {"motor": plant(**fields)}})
    assert simulation.kinds == ["hydraulic"]
    options = driver_class(config.driver["kind"]).Options.model_validate(config.driver)
    rig = end(options, simulation, clock=lambda: 0.0).rig
    for k in range(400):
        rig.apply(1e-3 * k, {was.input: 1.0})
    assert rig.actuators["motor"].plant.velocity > 5.0
    assert rig.state(0.4)["motor"]["pressure"] > 0.0
