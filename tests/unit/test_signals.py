"""Enable and fixed signals, validity bits and several e-stop lines: in the rig file and on the way out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cantools
import pytest

from drivers.base import Sample
from drivers.can import CanDriver
from drivers.can_config import CanOptions
from drivers.serial import SerialDriver
from seod.config.channels import input_channels, neutral_values, output_channels
from seod.config.check import check
from seod.config.load import ConfigErrors, load_text
from seod.config.model import RigConfig
from seod.files.shipped import configs_dir
from seod.loop.process import make_driver
from seod.processes.ring import AxisState
from tests.unit.amp_rig import RIG, folder
from tests.unit.loop_bench import PERIOD, Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

ENABLE = {
    "outputs": {
        "valve": {
            "channel": "motor.valve",
            "enable": {"channel": "motor.enable"},
            "fixed": {"motor.mode": 2.0},
        }
    },
    "simulation": {"plants": {"motor": {"enabled_by": {"motor.enable": 1.0, "motor.mode": 2.0}}}},
}


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(changes: dict[str, Any]) -> Bench:
        made.append(Bench(changes))
        return made[-1]

    yield make
    for each in made:
        each.close()


def load(directory: Path, *edits: tuple[str, str]) -> RigConfig:
    text = RIG
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return load_text(text, "amp.yaml", folder(directory))


def mistakes(directory: Path, *edits: tuple[str, str]) -> list[str]:
    with pytest.raises(ConfigErrors) as caught:
        load(directory, *edits)
    return [str(error) for error in caught.value.errors]


def test_an_output_that_no_axis_uses_is_refused_with_what_would_be_right(tmp_path: Path) -> None:
    extra = ("outputs:\n", "outputs:\n  enable: {channel: AmpCmd.Enable, offset: 1}\n")
    (told,) = mistakes(
        tmp_path, extra, ("    enable: {channel: AmpCmd.Enable, on: 1, off: 0, drop_on_fault: true}\n", "")
    )
    line = RIG.splitlines().index("outputs:") + 2
    assert told.startswith(f"amp.yaml:{line}: outputs.enable: no axis uses this output")
    assert "enable: {channel: AmpCmd.Enable, on: 1, off: 0}" in told
    assert "fixed: {AmpCmd.Enable: 1}" in told


def test_check_lists_every_signal_of_the_command_with_its_value(tmp_path: Path) -> None:
    report = check(load(tmp_path))
    (command,) = report.connection.commands
    assert {signal.name: signal.value for signal in command.signals} == {
        "Current": "axis ram: -10 to 10, neutral 0",
        "Enable": "1 while ram moves, else 0 (enable)",
        "Mode": "2 (fixed)",
        "Reserve": "0 (fixed)",
        "Key": "90 (fixed)",
        "counter": "counts frames, 0 to 15",
        "checksum": "checksum xor8",
    }
    assert all(f"  {signal.name:<24} {signal.value}" in str(report) for signal in command.signals)
    assert report.warnings == ()


def test_signals_that_nothing_sets_are_warned_of(tmp_path: Path) -> None:
    report = check(load(tmp_path, (", AmpCmd.Reserve: 0", "")))
    assert "0: nothing sets it (no start value in the DBC)" in str(report)
    assert (
        [w for w in report.warnings if "Reserve" in w]
        == [w for w in report.warnings if "nothing sets" in w]
        != []
    )


@pytest.mark.parametrize(
    ("old", "new", "key", "told"),
    [
        ("on: 1, off: 0", "on: 4", "outputs.valve.enable.on", "carries only 0 to 3"),
        ("on: 1, off: 0", "on: 0, off: 0", "outputs.valve.enable", "must differ"),
        ("AmpCmd.Mode: 2", "AmpCmd.Mode: 9", "outputs.valve.fixed.AmpCmd.Mode", "carries only 0 to 7"),
        (
            "AmpCmd.Mode: 2",
            "AmpCmd.Node: 2",
            "outputs.valve.fixed.AmpCmd.Node",
            "did you mean 'AmpCmd.Mode'?",
        ),
        (
            "AmpCmd.Mode: 2",
            "AmpCmd.Enable: 2",
            "outputs.valve.fixed.AmpCmd.Enable",
            "already the enable signal",
        ),
        (
            "AmpCmd.Mode: 2",
            "AmpCmd.Current: 2",
            "outputs.valve.fixed.AmpCmd.Current",
            "already driven by axis",
        ),
        ("AmpStat.PosValid", "AmpCmd.Mode", "sensors.position.valid.channel", "an input is needed here"),
        ("AmpStat.Panel", "AmpStat.Panik", "guard.estop[1].channel", "did you mean 'AmpStat.Panel'?"),
        ("is: 1", "was: 1", "sensors.position.valid.was", "known keys here: channel, is"),
    ],
)
def test_mistakes_are_told_at_their_keys(tmp_path: Path, old: str, new: str, key: str, told: str) -> None:
    found = mistakes(tmp_path, (old, new))
    assert any(f" {key}: " in text and told in text for text in found), found


def frames_of(recipe: dict[str, Any], directory: Path) -> list[dict[str, Any]]:
    """The supervisor's frames as another decoder of the DBC reads them."""
    database = cantools.database.load_file(directory / "amp.dbc")
    found = [frame for frames in recipe["frames"] for frame in frames]
    return [database.decode_message(f["id"], bytes.fromhex(f["data"])) for f in found]


@pytest.mark.parametrize(("drop", "enable"), [("true", 0), ("false", 1)])
def test_neutral_frames_of_the_supervisor_carry_enable_mode_and_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drop: str, enable: int
) -> None:
    config = load(tmp_path, ("drop_on_fault: true", f"drop_on_fault: {drop}"))
    driver = CanDriver(CanOptions.model_validate(config.driver), lambda: 0.0)
    monkeypatch.setattr(driver._link, "open", lambda *_: None)
    driver.open(input_channels(config), output_channels(config), neutral_values(config))
    frames = frames_of(dict(driver.neutral_recipe()), tmp_path)
    assert [frame["counter"] for frame in frames] == list(range(16))
    for frame in frames:
        told = (frame["Current"], frame["Enable"], frame["Mode"], frame["Key"], frame["Reserve"])
        assert told == (0, enable, 2, 90, 0)
    driver.close()


def test_the_loop_process_opens_the_driver_with_all_signals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Any] = []
    monkeypatch.setattr(CanDriver, "open", lambda self, *arguments: opened.extend(arguments))
    monkeypatch.setattr(CanDriver, "start", lambda self: None)
    make_driver(load(tmp_path), lambda: 0.0)
    inputs, outputs, neutral = opened
    assert inputs == ["AmpStat.Position", "AmpStat.PosValid", "AmpStat.Chain", "AmpStat.Panel"]
    assert outputs == ["AmpCmd.Current", "AmpCmd.Enable", "AmpCmd.Mode", "AmpCmd.Key", "AmpCmd.Reserve"]
    assert neutral == [0.0, 0.0, 2.0, 90.0, 0.0]


def test_serial_commands_carry_the_signals_too(monkeypatch: pytest.MonkeyPatch) -> None:
    text = (configs_dir() / "serial.yaml").read_text()
    valve = "  - {name: valve, type: int16, scale: 1.0e-3, unit: V}\n"
    assert valve in text
    text = text.replace(
        valve, "  - {name: enable_out, type: uint8}\n  - {name: spare, type: uint8}\n" + valve
    )
    config = load_text(text, "serial.yaml", configs_dir())
    report = check(config)
    assert [(s.name, s.is_set) for s in report.connection.commands[0].signals] == [
        ("enable_out", False),
        ("spare", False),
        ("valve", True),
    ]
    text = text.replace(
        "    channel: valve\n    unit: V\n",
        "    channel: valve\n    enable: {channel: enable_out, on: 7}\n    fixed: {spare: 3}\n",
    )
    config = load_text(text, "serial.yaml", configs_dir())
    assert check(config).connection.commands[0].unset == []
    driver = make_unopened_serial(config)
    inputs, sent = driver._make(input_channels(config), output_channels(config), neutral_values(config))
    assert inputs is not None
    body = sent.neutral_bytes(0)
    from drivers.serial_frame import Block, Splitter, decode

    (encoded,) = [part for part in Splitter(b"\0", 300).feed(body) if part]
    assert list(Block("BBh").unpack(decode(encoded).body)) == [0, 3, 0]


def make_unopened_serial(config: RigConfig) -> SerialDriver:
    return SerialDriver(SerialDriver.Options.model_validate(config.driver), lambda: 0.0)


def test_the_enable_signal_is_on_from_start_to_standstill_and_off_after_a_fault(
    bench: Callable[..., Bench],
) -> None:
    rig = bench(ENABLE)
    sent: list[list[float]] = []
    write = rig.driver.write
    rig.driver.write = lambda t, values: (sent.append(list(values)), write(t, values))[1]  # type: ignore[method-assign]
    rig.run(0.01)
    assert {tuple(values[1:]) for values in sent} == {(0.0, 2.0)}
    rig.call("start")
    rig.run(1.0)
    assert rig.state is AxisState.EXCITING
    assert sent[-1][1:] == [1.0, 2.0]
    rig.call("stop")
    rig.run(0.02)
    assert (rig.state, sent[-1][1]) == (AxisState.HOLDING, 1.0)
    rig.run(3.0)
    assert (rig.state, sent[-1][1]) == (AxisState.IDLE, 0.0)
    rig.call("start")
    rig.run(0.5)
    rig.call("estop")
    assert (rig.state, sent[-1][1:]) == (AxisState.FAULT, [0.0, 2.0])


def test_times_of_leaving_are_those_of_the_axes_and_not_of_the_signals(bench: Callable[..., Bench]) -> None:
    rig = bench(ENABLE)
    rig.driver.left = lambda: [rig.pacer.now(), 7e9, 8e9]  # type: ignore[method-assign]
    rig.run(0.01)
    rows = rig.rows()
    assert len(rows) == 19
    assert all(0.0 < row["t_u"] - row["tick_time"] < 2 * PERIOD for row in rows)


def test_without_its_enable_signal_the_simulated_rig_stands_still_and_the_fault_names_it(
    bench: Callable[..., Bench],
) -> None:
    rig = bench({"simulation": {"plants": {"motor": {"enabled_by": {"motor.enable": 1.0}}}}})
    rig.call("start")
    rig.run(1.0)
    (fault,) = rig.take("fault")
    assert fault["code"] == "polarity"
    assert "outputs.valve.enable" in fault["why"]


def test_an_enable_signal_of_two_axes_falls_with_a_fault_of_either() -> None:
    from seod.config.outputs import EnableConfig
    from seod.loop.signals import Enable

    class Course:
        state, active = AxisState.IDLE, False

    class Axis:
        def __init__(self) -> None:
            self.course = Course()

    a, b = Axis(), Axis()
    enable = Enable(EnableConfig(channel="x", on=3.0, off=1.0), [a, b])  # type: ignore[list-item]
    assert enable.value() == 1.0
    a.course.active = True
    assert enable.value() == 3.0
    b.course.state = AxisState.FAULT
    assert enable.value() == 1.0


def test_readings_that_are_called_invalid_are_stale_and_told_as_such(bench: Callable[..., Bench]) -> None:
    rig = bench(
        {
            "sensors": {
                "angle": {"channel": "motor.angle", "unit": "rad", "valid": {"channel": "ok", "is": 2.0}}
            },
            "simulation": {"constants": {"ok": 2.0}},
        }
    )
    rig.call("start")
    rig.run(1.0)
    assert rig.state is AxisState.EXCITING
    rig.driver.rig.constants["ok"] = 0.0
    rig.run(0.005)
    assert rig.state is AxisState.EXCITING  # guard.stale is 10 ms: a flicker is no fault
    rig.driver.rig.constants["ok"] = 2.0
    rig.run(0.1)
    rig.driver.rig.constants["ok"] = 0.0
    rig.run(0.015)
    (fault,) = rig.take("fault")
    assert fault["code"] == "stale_sample"
    assert "newest valid sample" in fault["why"]
    assert "ok reads 0: readings are valid at 2" in fault["why"]
    rig.call("reset")
    error = rig.call("start")
    assert error is not None
    assert "ok reads 0" in error


def test_an_invalid_pressure_counts_as_silent(bench: Callable[..., Bench]) -> None:
    rig = bench(
        {
            "sensors": {
                "ps": {
                    "channel": "ps",
                    "unit": "Pa",
                    "kind": "pressure",
                    "valid": {"channel": "ps_ok", "is": 1.0},
                }
            },
            "axes": {
                "motor": {"supply_pressure": "ps", "K_L": {"table": {"ps": [1e6, 9e6], "K_L": [17.0, 17.1]}}}
            },
            "simulation": {"constants": {"ps": 7e6, "ps_ok": 0.0}},
        }
    )
    rig.run(0.1)
    error = rig.call("start")
    assert error is not None
    assert "K_L is not known" in error
    rig.driver.rig.constants["ps_ok"] = 1.0
    rig.run(2 * PERIOD)
    assert rig.call("start") is None


def test_any_e_stop_line_stops_the_rig_and_each_open_one_is_named(bench: Callable[..., Bench]) -> None:
    lines = [{"channel": "chain"}, {"channel": "panel", "run": 0.0}, {"channel": "door"}]
    rig = bench(
        {"guard": {"estop": lines}, "simulation": {"constants": {"chain": 1.0, "panel": 0.0, "door": 1.0}}}
    )
    rig.call("start")
    rig.run(0.5)
    assert rig.state is AxisState.EXCITING
    rig.driver.rig.constants.update(panel=1.0, door=0.0)
    rig.run(2 * PERIOD)
    (fault,) = rig.take("fault")
    assert fault["code"] == "estop"
    assert "panel reads 1, movement is allowed at 0" in fault["why"]
    assert "door reads 0, movement is allowed at 1" in fault["why"]
    assert "chain" not in fault["why"]


def test_a_silent_e_stop_line_tells_its_age_and_the_key() -> None:
    from seod.config.guard import EstopConfig
    from seod.loop import guard

    lines = [
        (EstopConfig(channel="chain"), Sample(1.0, 99.938)),
        (EstopConfig(channel="panel"), Sample(1.0, 100.0)),
    ]
    trip = guard.estop_open(lines, 100.0, 0.05)
    assert trip is not None
    assert trip.why == "e-stop: the channel chain has been silent for 62.0 ms (guard.stale is 50.0 ms)"
    assert trip.numbers["age_s"] == pytest.approx(0.062)


def test_a_rig_file_with_all_of_it_survives_the_way_to_the_loop_process(tmp_path: Path) -> None:
    config = load(tmp_path)
    assert RigConfig.model_validate_json(config.model_dump_json()) == config
    assert '"is":1.0' in config.model_dump_json()
