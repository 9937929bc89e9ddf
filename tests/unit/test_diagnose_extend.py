"""The extended rig file: `seod simulate` takes it as it is, and it swings as the recording did."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.can_config import CanOptions
from seod.cli import app
from seod.config.load import load_rig, load_text
from seod.data import read
from seod.diagnose.extend.can_rig import DBC, checked, dbc, on_can
from seod.diagnose.extend.model import Model
from seod.diagnose.extend.references import moved
from seod.diagnose.extend.rig_file import into_config, new_rig_file
from seod.diagnose.extend.seen import seen
from seod.files.shipped import configs_dir
from seod.simulate.view import AxisView
from sim.can_rig import CanRig
from tests.command_line import CliRunner

EFFECTS = {"coulomb_friction": {"level": 400.0}, "valve_deadband": {"half_width": 0.05}}
VIRTUAL = configs_dir() / "virtual.yaml"


def simulate(config, out, *words):
    result = CliRunner().invoke(app, [str(word) for word in ("simulate", config, "--out", out, *words)])
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def limit_cycle(path):
    """Frequency [Hz] and amplitude of the settled half of a recording under a relay."""
    data = read(path)
    half = slice(len(data.t) // 2, None)
    rows = np.flatnonzero(np.diff(np.sign(data.u[half] - np.mean(data.u[half]))) > 0)
    t, y = data.t[half], data.y[half]
    periods = len(rows) - 1
    swings = [np.ptp(y[a:b]) / 2.0 for a, b in pairwise(rows)]
    return periods / (t[rows[-1]] - t[rows[0]]), float(np.median(swings))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "relay.csv"
    words = [
        w
        for name, group in EFFECTS.items()
        for of, x in group.items()
        for w in ("--effect", f"{name}.{of}={x}")
    ]
    simulate(VIRTUAL, path, "--duration", 3, *words)
    return path


@pytest.mark.slow
def test_a_new_rig_swings_as_the_recording(recorded, tmp_path):
    found = seen(read(recorded, units="y=rad"), speed=False)
    assert (found.relay, found.e_a, found.bias) == (True, 0.5, 0.0)
    assert found.hysteresis == pytest.approx(4e-3, rel=0.03)
    path = tmp_path / "extended.yaml"
    path.write_text(new_rig_file(Model(17.0, 117.0, 0.21, EFFECTS, 1e-3), found, False, recorded.name))
    simulate(path, tmp_path / "again.csv", "--duration", 3)
    frequency, amplitude = limit_cycle(recorded)
    again = limit_cycle(tmp_path / "again.csv")
    assert again[0] == pytest.approx(frequency, rel=0.005)
    assert again[1] == pytest.approx(amplitude, rel=0.02)


def test_a_relay_is_seen_between_rest_polarity_and_other_amplitudes(recorded):
    relay = read(recorded, units="y=rad")
    rest, pulse = np.zeros(9000), np.repeat([0.0, 0.3, 0.0, -0.3, 0.0], 200)
    before, after = np.r_[rest, pulse], np.r_[0.2 * relay.u[:2000], rest, np.nan]
    u = np.r_[before, relay.u, after]
    y = np.r_[0.0 * before, relay.y, 0.2 * relay.y[:2000], 0.0 * rest, 0.0]
    found = seen(replace(relay, t=np.arange(len(u)) / 2000.0, u=u, y=y, t_u=None), speed=False)
    plain = seen(relay, speed=False)
    assert (found.relay, found.e_a, found.bias) == (True, 0.5, 0.0)
    assert found.hysteresis == pytest.approx(plain.hysteresis, rel=0.02)


@pytest.mark.parametrize(
    "u",
    [
        0.5 * np.sin(np.arange(4000) / 30.0),
        np.random.default_rng(1).normal(size=4000),
        np.repeat(np.random.default_rng(2).uniform(-1.0, 1.0, 80), 50),
        np.repeat([0.0, 0.5, 0.0], 1000),
        np.zeros(4000),
    ],
)
def test_anything_else_is_no_relay(u, recorded):
    t = np.arange(len(u)) / 1000.0
    found = seen(replace(read(recorded), t=t, u=u, y=np.sin(t)), speed=False)
    assert (found.relay, found.hysteresis) == (False, 0.0)
    assert found.e_a == pytest.approx(0.5 * np.max(np.abs(u)))


@pytest.mark.parametrize("zeta", [0.03, 0.21, 1.5])
def test_the_limits_leave_room_for_the_limit_cycle(zeta, recorded, tmp_path):
    path, again = tmp_path / "extended.yaml", tmp_path / "again.csv"
    path.write_text(new_rig_file(Model(17.0, 117.0, zeta), seen(read(recorded), False), False, "x.csv"))
    simulate(path, again, "--duration", 5, "--noise", 0)
    data, limits = read(again), load_rig(path).axes["axis"].limits
    assert 2.0 * np.max(np.abs(np.gradient(data.y, data.t))) < limits.speed
    assert np.ptp(data.y) < limits.amplitude


@pytest.mark.slow
@pytest.mark.parametrize("zeta", [0.02, 0.8])
def test_so_do_those_of_a_speed(zeta, tmp_path):
    out, path = tmp_path / "speed.csv", tmp_path / "extended.yaml"
    simulate(configs_dir() / "servo-virtual.yaml", out, "--duration", 2, "--noise", 0)
    found = seen(read(out, units="y=rad/s"), speed=True)
    path.write_text(new_rig_file(Model(17.434, 60.0, zeta), found, True, out.name))
    simulate(path, tmp_path / "again.csv", "--duration", 5, "--noise", 0)
    low, high = load_rig(path).axes["axis"].limits.travel
    assert 2.0 * np.max(np.abs(read(tmp_path / "again.csv").y)) < min(-low, high)


def test_it_matters_that_the_effects_are_in(recorded, tmp_path):
    path = tmp_path / "bare.yaml"
    path.write_text(new_rig_file(Model(17.0, 117.0, 0.21), seen(read(recorded), False), False, "x.csv"))
    simulate(path, tmp_path / "again.csv", "--duration", 3, "--noise", 1e-3)
    assert limit_cycle(tmp_path / "again.csv")[1] > 1.1 * limit_cycle(recorded)[1]


def test_into_the_users_own_file_with_its_comments():
    text, config = VIRTUAL.read_text(), load_rig(VIRTUAL)
    model = Model(16.0, 110.0, 0.25, EFFECTS | {"valve_saturation": {"limit": np.inf}}, 2e-3)
    after = into_config(text, config, "motor", model)
    plant = load_text(after, "after", VIRTUAL.parent).simulation.plants["motor"]
    assert (plant.K_L, plant.omega_n, plant.zeta, plant.noise) == (16.0, 110.0, 0.25, 2e-3)
    assert plant.effects == EFFECTS
    assert "# The truth of the simulated rig, in SI units" in after
    assert after.split("simulation:")[0] == text.split("simulation:")[0].replace("port: 7600", "port: 7610")


def test_neither_form_takes_the_port_of_a_daemon_that_runs(recorded):
    text = new_rig_file(Model(17.0, 117.0, 0.21), seen(read(recorded), False), False, "x.csv")
    own = into_config(VIRTUAL.read_text(), load_rig(VIRTUAL), "motor", Model(17.0, 117.0, 0.21))
    for each in (text, own, on_can(text, 500.0)):
        assert "\n  port: 7610" in each
    new = load_text(text, "new", VIRTUAL.parent)
    assert (new.server.port, new.simulation.control_port) == (7610, 7611)


def test_units_and_volts_of_the_plant_are_its_own():
    valve = {"valve_deadband": {"half_width": 0.1}, "valve_rate_limit": {"rate": 20.0}}
    own = Model(2.0, 100.0, 0.5, valve | {"coulomb_friction": {"level": 3.0}}, 0.01)
    got = own.in_units_of(slope=0.5, per_volt=4.0)
    assert (got.K_L, got.noise) == (1.0, 0.02)
    assert got.effects == {
        "valve_deadband": {"half_width": 0.4},
        "valve_rate_limit": {"rate": 80.0},
        "coulomb_friction": {"level": 6.0},
    }


def test_an_actuator_wired_the_other_way_round_is_turned():
    turned = Model(
        -3.0, 50.0, 0.4, {"asymmetric_gain": {"ratio": 0.2}, "load_bias": {"acceleration": 5.0}}
    ).upright()
    assert turned.K_L == 3.0
    assert turned.effects == {"asymmetric_gain": {"ratio": -0.2}, "load_bias": {"acceleration": 5.0}}


@pytest.mark.parametrize("name", sorted(path.name for path in configs_dir().glob("*-virtual.yaml")))
def test_every_shipped_rig_takes_its_own_model_back(name):
    """Written in the axis' units, the plant comes out as it was."""
    path = configs_dir() / name
    config = load_rig(path)
    for axis in config.axes:
        view = AxisView(config, axis)
        plant = view.plant
        model = Model(plant.K_L, plant.omega_n, plant.zeta, plant.effects).in_units_of(
            1.0 / view.slope, 1.0 / view.per_volt
        )
        after = load_text(into_config(path.read_text(), config, axis, model), name, path.parent)
        again = AxisView(after, axis).plant
        assert (again.K_L, again.omega_n, again.zeta) == pytest.approx((plant.K_L, plant.omega_n, plant.zeta))
        assert set(again.effects) == set(plant.effects)


def test_what_a_moved_rig_file_names_is_still_found(tmp_path):
    text = VIRTUAL.read_text().replace(
        "server:\n", "server:\n  tls: {certificate: rig.pem, key: ../own/rig.key}\n", 1
    )
    source = tmp_path / "etc" / "rig.yaml"
    for name in ("etc/rig.pem", "own/rig.key", "etc/rig.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "found").mkdir()
    there = load_text(moved(text, load_rig(source), source, tmp_path / "found"), "moved", tmp_path / "found")
    assert there.server.tls.certificate == str(tmp_path / "etc" / "rig.pem")
    assert Path(there.server.tls.key).samefile(tmp_path / "own" / "rig.key")


def test_a_speed_becomes_velocity_mode(tmp_path):
    out = tmp_path / "speed.csv"
    simulate(configs_dir() / "servo-virtual.yaml", out, "--duration", 2, "--noise", 0)
    found = seen(read(out, units="y=rad/s"), speed=True)
    path = tmp_path / "extended.yaml"
    path.write_text(new_rig_file(Model(17.434, 60.0, 0.8), found, True, out.name))
    simulate(path, tmp_path / "again.csv", "--duration", 2, "--noise", 0)
    frequency, amplitude = limit_cycle(out)
    again = limit_cycle(tmp_path / "again.csv")
    assert again == pytest.approx((frequency, amplitude), rel=0.02)


def test_the_same_rig_on_a_bus_moves_under_the_commands_of_the_bus(recorded, tmp_path):
    """`seod rig`'s end of it, on python-can's `virtual` interface."""
    found = seen(read(recorded, units="y=rad"), speed=False)
    text = new_rig_file(Model(17.0, 117.0, 0.21, EFFECTS), found, False, recorded.name)
    (tmp_path / DBC).write_text(dbc(load_text(text, "new", tmp_path)))
    path = tmp_path / "extended-can.yaml"
    path.write_text(checked(on_can(text, 2000.0), tmp_path))
    config = load_rig(path)
    simulate(path, tmp_path / "again.csv", "--duration", 3)
    assert limit_cycle(tmp_path / "again.csv") == pytest.approx(limit_cycle(recorded), rel=0.05)
    options = CanOptions.model_validate(config.driver | {"interface": "virtual", "channel": "extended"})
    rig = CanRig(options, config.simulation)
    assert rig.rig.constants == {}
    assert [message.name for message in rig.messages] == ["Sensor"]


def test_a_supply_pressure_of_0_is_none_of_the_rigs(recorded):
    there = replace(read(recorded), ps=np.full(len(read(recorded).t), 7e6))
    assert seen(there, speed=False).supply_pressure == 7e6
    assert seen(replace(there, ps=0.0 * there.ps), speed=False).supply_pressure is None
