"""Commands in mA, and gains with their unit: read everywhere, told in the right one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
import typer

from seod.commands.over_tcp import read_assignments
from seod.commands.quantity import Gain
from seod.config.check import check
from seod.config.load import ConfigErrors, load_text
from seod.config.model import RigConfig
from seod.config.settings import refusal
from seod.files.shipped import configs_dir
from seod.processes.ring import AxisState
from seod.terminal.text import settings
from tests.unit.loop_bench import Bench

if TYPE_CHECKING:
    from pathlib import Path

VIRTUAL = (configs_dir() / "virtual.yaml").read_text()
AMPERES = (
    ("    channel: amplifier\n    unit: V\n", "    channel: amplifier\n    unit: mA\n"),
    ("\n    K_L: 17 ", "\n    K_L: 1.7 rad/s/mA "),
    ("e_a: 0.5 V", "e_a: 5 mA"),
    ("bias: 0 V", "bias: 0 mA"),
    ("output: 2 V", "output: 20 mA"),
    ("pulse: 0.5 V", "pulse: 5 mA"),
    ("\n      K_L: 17 ", "\n      K_L: 1.7 "),
)
"""The shipped rig behind a servo valve of 20 mA: its simulated plant takes the number of mA."""


def text(*edits: tuple[str, str]) -> str:
    found = VIRTUAL
    for old, new in (*AMPERES, *edits):
        assert found.count(old) == 1, old
        found = found.replace(old, new)
    return found


def load(*edits: tuple[str, str]) -> RigConfig:
    return load_text(text(*edits), "x.yaml", configs_dir())


def test_currents_and_gains_become_si_and_agree_with_the_simulated_plant() -> None:
    config = load()
    axis = config.axes["motor"]
    assert (axis.relay.e_a, axis.limits.output, axis.K_L) == pytest.approx((0.005, 0.02, 1700.0))
    assert (axis.command_unit, axis.gain_unit) == ("A", "rad/s/A")
    assert check(config).warnings == ()
    assert RigConfig.model_validate_json(config.model_dump_json()).axes["motor"].gain_unit == "rad/s/A"


@pytest.mark.parametrize(
    ("written", "unit", "si"),
    [
        ("50 mm/s/V", "m", 0.05),
        ("0.05", "m", 0.05),
        ("0.05 m/s/V", "m", 0.05),
        ("50 mm/s/mV", "m", 50.0),
        ("974.03 deg/s/V", "rad", 17.0),
        ("162.338 rpm/V", "rad", 17.0),
    ],
)
def test_gains_with_their_unit(written: str, unit: str, si: float) -> None:
    found = VIRTUAL.replace("    K_L: 17 ", f"    K_L: {written} ", 1)
    if unit == "m":
        found = found.replace("unit: rad", "unit: m").replace(" mrad", " mm").replace(" deg", " mm")
        found = found.replace("60 rad/s", "60 m/s").replace("0.45 rad", "50 mm")
    axis = load_text(found, "x.yaml", configs_dir()).axes["motor"]
    assert pytest.approx(si, rel=1e-5) == axis.K_L
    assert axis.gain_unit == f"{unit}/s/V"


@pytest.mark.parametrize(
    ("old", "new", "key", "told"),
    [
        ("e_a: 5 mA", "e_a: 0.5 V", "axes.motor.relay.e_a", "output 'valve' is in mA: must be in A, mA"),
        ("pulse: 5 mA", "pulse: 5 mV", "axes.motor.polarity.pulse", "must be in A, mA"),
        ("slew: null", "slew: 5 V/s", "axes.motor.limits.slew", "must be in A/s, mA/s"),
        ("1.7 rad/s/mA", "1.7 rad/s/V", "axes.motor.K_L", "must be in rad/s/A, rad/s/mA"),
        ("1.7 rad/s/mA", "1.7 mm/s/mA", "axes.motor.K_L", "the sensor measures angle: must be in rad/s/A"),
        (
            "e_a: 5 mA",
            "e_a: 25 mA",
            "axes.motor.relay.e_a",
            "0.025 A is above limits.output = 0.02 A",
        ),
    ],
)
def test_volts_among_amperes_are_refused(old: str, new: str, key: str, told: str) -> None:
    with pytest.raises(ConfigErrors) as caught:
        load((old, new))
    assert any(error.key == key and told in str(error) for error in caught.value.errors), caught.value


def test_a_channel_in_milliamperes_is_not_taken_for_volts(tmp_path: Path) -> None:
    dbc = (configs_dir() / "motor.dbc").read_text().replace('[-10|10] "V"', '[-10|10] "mA"')
    (tmp_path / "motor.dbc").write_text(dbc)
    with pytest.raises(ConfigErrors, match="is in mA, and scale 1 leaves it so"):
        load_text((configs_dir() / "can.yaml").read_text(), "can.yaml", tmp_path)


def test_an_axis_that_is_commanded_by_a_current_runs_and_says_so() -> None:
    gain = {"K_L": 1700.0, "relay": {"e_a": 0.005}, "limits": {"output": 0.02}}
    plant = {"K_L": 1.7}
    changes: dict[str, Any] = {
        "axes": {"motor": gain},
        "outputs": {"valve": {"channel": "motor.valve", "unit": "mA"}},
        "simulation": {"plants": {"motor": plant}},
    }
    rig = Bench(changes)
    try:
        rig.call("start")
        rig.run(1.0)
        assert rig.state is AxisState.EXCITING
        assert abs(rig.volts) == pytest.approx(5.0)  # mA at the channel
        (polarity,) = rig.take("polarity")
        assert "+0.005 A for" in polarity["why"]
        error = rig.call("set", axis=0, e_a=0.03)
        assert error is not None
        assert "0.03 A is over limits.output = 0.02 A" in error
    finally:
        rig.close()


def test_settings_are_told_with_their_units() -> None:
    axis = load().axes["motor"]
    assert axis.setting_units == {"e_a": "A", "bias": "A", "hysteresis": "rad", "K_L": "rad/s/A"}
    values = {"e_a": 0.005, "K_L": 1700.0, "method": "wave"}
    assert settings(values, axis.setting_units) == "e_a = 0.005 A, K_L = 1700 rad/s/A, method = wave"
    assert "A is over" in str(refusal(axis, {"e_a": 0.005, "bias": 0.0}, {"e_a": 1.0}))


def test_clients_may_write_units() -> None:
    assert read_assignments(
        ["motor", "K_L=50 mm/s/V", "e_a=5 mA", "method=wave", "trim=true", "bias=0.1"]
    ) == (
        "motor",
        {
            "K_L": "50 mm/s/V",  # by the daemon, which knows those of the axis
            "e_a": "5 mA",
            "method": "wave",
            "trim": True,
            "bias": 0.1,
        },
    )
    with pytest.raises(typer.BadParameter, match="K_L: wrong unit 'mm'"):
        read_assignments(["K_L=50 mm"])
    assert (Gain()("17"), Gain()("50 mm/s/V")) == pytest.approx((17.0, 0.05))
    with pytest.raises(typer.BadParameter, match="wrong unit"):
        Gain()("50 mm")
