"""Rig files: what is wrong is told all at once, with file, line, key and what would be right."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from drivers import driver_class
from seod.config.load import ConfigErrors, load_rig, load_text
from seod.config.model import RigConfig
from seod.config.token_field import WITH_TOKENS
from seod.files.shipped import configs_dir
from tests.unit.rig_texts import can_at_2_khz

if TYPE_CHECKING:
    from pathlib import Path

VIRTUAL = (configs_dir() / "virtual.yaml").read_text()
CAN = can_at_2_khz()


def edited(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{old!r} is {text.count(old)} times in the example"
    return text.replace(old, new)


def errors_of(text: str) -> list[tuple[int, str, str]]:
    with pytest.raises(ConfigErrors) as caught:
        load_text(text, "x.yaml", configs_dir())
    return [
        (error.line, error.key.removeprefix("axes.motor."), f"{error.message}; {error.right}")
        for error in caught.value.errors
    ]


def line_of(text: str, mark: str) -> int:
    return text[: text.index(mark)].count("\n") + 1


def assert_only_error(text: str, mark: str, key: str, *fragments: str) -> None:
    """The only mistake stands on the line where `mark` is."""
    errors = errors_of(text)
    assert [(line, where) for line, where, _ in errors] == [(line_of(text, mark), key)], errors
    for fragment in fragments:
        assert fragment in errors[0][2], errors[0][2]


@pytest.mark.parametrize("name", ["virtual.yaml", "can.yaml"])
def test_the_examples_load_and_survive_the_way_to_another_process(name: str) -> None:
    config = load_rig(configs_dir() / name)
    again = RigConfig.model_validate_json(config.model_dump_json())
    assert again == config
    options = driver_class(again.driver["kind"]).Options
    assert options.model_validate(again.driver) == options.model_validate(config.driver)


def test_units_and_numbers_become_si() -> None:
    text = edited(VIRTUAL, "e_a: 0.5 V ", "e_a: 5.0e2 mV ")
    text = edited(text, "travel: [-60 deg, 60 deg]", "travel: [-0.25 rev, 1e0]")
    text = edited(text, "excitation: 3600 s", "excitation: 8e2")
    axis = load_text(text, "x.yaml", configs_dir()).axes["motor"]
    assert axis.relay.e_a == 0.5
    assert axis.limits.travel == (pytest.approx(-1.5707963), 1.0)
    assert axis.limits.excitation == 800.0


def test_the_dbc_is_found_from_the_rig_files_folder() -> None:
    config = load_rig(configs_dir() / "can.yaml")
    assert config.driver["dbc"] == str(configs_dir() / "motor.dbc")


def test_a_driver_section_is_handed_on_as_given_because_a_written_null_means_something() -> None:
    text = edited(CAN, "    Supply:\n", "    Supply:\n      counter: null\n")
    messages = load_text(text, "x.yaml", configs_dir()).driver["messages"]
    assert messages == {"Encoder": {"rate_hz": 2000.0}, "Supply": {"counter": None, "rate_hz": 100.0}}


SHAPE = [
    ("rate_hz: 2000 ", "rate_hz: 50 Hz ", "loop.rate_hz", 'must be >= 100, got "50 Hz"'),
    ("rate_hz: 2000 ", "rate_hz: .nan ", "loop.rate_hz", "must be"),
    ("rate_hz: 2000 ", "rate_hz: fast ", "loop.rate_hz", 'Hz, kHz), got "fast"'),
    ("rate_hz: 2000 ", "rate_hz: 2 kV ", "loop.rate_hz", "wrong unit 'kV': must be one of Hz, kHz"),
    ("rate_hz: 2000 ", "rat_hz: 2000 ", "loop.rat_hz", "did you mean 'rate_hz'? known keys here: cpu,"),
    ("priority: 50 ", "priority: 99 ", "loop.priority", "must be <= 98, got 99"),
    ("priority: 50 ", "priority: 50.5 ", "loop.priority", "must be a whole number, got 50.5"),
    ("priority: 50 ", "priority: true ", "loop.priority", "must be a whole number, got true"),
    ("priority: 50 ", "priority: ", "loop.priority", "must be a whole number, got nothing"),
    ("pace: timer", "pace: tiemr", "loop.pace", "must be 'timer' or 'sensor', got \"tiemr\""),
    ("realtime: true", "realtime: yes", "driver.realtime", 'must be true or false, got "yes"'),
    ("realtime: true", "realtim: true", "driver.realtim", "did you mean 'realtime'?"),
    ("rig: virtual-motor", "rig: virtual motor", "rig", "must match"),
    ("unit: rad\n", "unit: degs\n", "sensors.angle.unit", "unknown unit 'degs'; did you mean 'deg"),
    ("unit: V\n", "unit: kV\n", "outputs.valve.unit", "must be 'V', 'mV', 'A' or 'mA'"),
    ("unit: V\n", "unit: V\n    scale: 0\n", "outputs.valve.scale", "must not be 0"),
    ("unit: V\n", "unit: V\n    offset: .inf\n", "outputs.valve.offset", "must be a finite number"),
    ("e_a: 0.5 V ", "e_a: -0.5 V ", "relay.e_a", 'must be > 0, got "-0.5 V"'),
    ("e_a: 0.5 V ", "e_a: 0 ", "relay.e_a", "must be > 0, got 0"),
    ("e_a: 0.5 V ", "e_a: 1" + "0" * 400 + " ", "relay.e_a", "finite"),
    ("e_a: 0.5 V ", "e_a: 1e400 ", "relay.e_a", "finite"),
    ("e_a: 0.5 V ", "e_a: 30 deg ", "relay.e_a", "wrong unit 'deg': must be one of V, mV"),
    ("hysteresis: 4 mrad", "hysteresis: -4 mrad", "relay.hysteresis", "must be >= 0"),
    ("travel: [-60 deg, 60 deg]", "travel: [-60 deg]", "limits.travel", "has too few entries, got ["),
    ("travel: [-60 deg, 60 deg]", "travel: 60 deg", "limits.travel", "must be a list"),
    ("travel: [-60 deg, 60 deg]", "travel: [-60 deg, x]", "limits.travel[1]", 'got "x"'),
    ("travel: [-60", "K_L: [20, 10]\n      travel: [-60", "limits.K_L", "must come first"),
    ("mode: position ", "mode: speed ", "mode", "must be 'position' or 'velocity'"),
    ("movement: 30 mrad", "motion: 30 mrad", "polarity.motion", "unknown key"),
    ("K_L: 17                     #", "K_L: '17' #", "K_L", "must be a number"),
    ("port: 7600", "port: 70000", "server.port", "must be <= 65535, got 70000"),
    ("window: 100 ms}", "window: 100 ms, for: 1}", "guard.overruns.for", "known keys here: count, window"),
    ("count: 20,", "count: 0,", "guard.overruns.count", "must be >= 1"),
    ("zeta: 0.21", "zeta: 0", "simulation.plants.motor.zeta", "must be > 0"),
    ("stops: [-1.5, 1.5]", "stops: [0.5, 1.5]", "simulation.plants.motor", "must lie between the stops"),
    ("hang_timeout: 50 ms", "hang_timeout: 1e300", "loop.hang_timeout", "must be <= 1e+06, got"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "fragment"), SHAPE)
def test_a_wrong_value_is_told_with_its_place(old: str, new: str, key: str, fragment: str) -> None:
    text = edited(VIRTUAL, old, new)
    errors = errors_of(text)
    found = [(line, words) for line, where, words in errors if where == key]
    assert found, errors
    assert fragment in found[0][1]
    last_key = key.partition("[")[0].rpartition(".")[2]
    assert f"{last_key}:" in text.splitlines()[found[0][0] - 1]


NUMBERS = [
    ("e_a: 0.5 V ", "e_a: 1.9 V # ", "relay.e_a", "e_a + |bias| = 2.2 V is above limits.output = 2 V"),
    ("hysteresis: 4 mrad", "hysteresis: 1", "relay.hysteresis", "below limits.amplitude = 0.45, got 1"),
    ("pulse: 0.5 V", "pulse: 3 V", "polarity.pulse", "at most limits.output = 2 V"),
    ("movement: 30 mrad", "movement: 1", "polarity.movement", "below limits.amplitude"),
    ("timeout: 3 s", "output: 3 V", "hold.output", "at most limits.output"),
    ("timeout: 3 s", "tolerance: 0.5", "hold.tolerance", "below limits.amplitude"),
    ("travel: [-60 deg, 60 deg]", "travel: [60 deg, -60 deg]", "limits.travel", "lower end must come first"),
    ("travel: [-60 deg, 60 deg]", "travel: [1, 1]", "limits.travel", "lower end must come first"),
    ("amplitude: 0.45 rad", "amplitude: 2 rad", "limits.amplitude", "at most half of limits.travel, 1.0472"),
    ("excitation: 3600 s", "excitation: 0.05 s", "limits.excitation", "longer than excitation.entry"),
    ("duration: 50 ms ", "duration: 0.6 ms ", "polarity.duration", "5 periods of the loop, 0.0025 s"),
    ("cycles: 4 ", "lowpass: 1 kHz #", "estimator.lowpass", "below half the loop rate, 1000 Hz"),
    ("    hold:", "    filter: 1 kHz\n    hold:", "filter", "below half the loop rate"),
    ("stale: 10 ms", "stale: 0.4 ms", "guard.stale", "at least one period of the loop, 0.0005 s"),
    ("frozen: 250 ms", "frozen: 0.4 ms", "guard.frozen", "at least one period"),
    ("rig_watchdog: 20 ms", "rig_watchdog: 0.4 ms", "guard.rig_watchdog", "at least one period"),
    ("# dead_man: 1 s  ", "dead_man: 0.1 ms # ", "guard.dead_man", "at least one period"),
    ("count: 20, window", "count: 201, window", "guard.overruns.count", "200 ticks fit into guard"),
    ("hang_timeout: 50 ms", "hang_timeout: 0.9 ms", "loop.hang_timeout", "at least two periods of the loop"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "fragment"), NUMBERS)
def test_numbers_that_do_not_fit_each_other_are_told(old: str, new: str, key: str, fragment: str) -> None:
    text = edited(edited(VIRTUAL, old, new), "bias: 0 V ", "bias: -0.3 V ")
    where = next(part for part in new.split("\n") if part.strip() != "hold:").strip()
    assert_only_error(text, where, key, fragment)


def test_numbers_exactly_at_their_bounds_are_right() -> None:
    text = edited(edited(VIRTUAL, "e_a: 0.5 V ", "e_a: 1.5 V "), "bias: 0 V ", "bias: -0.5 V ")
    text = edited(edited(text, "count: 20,", "count: 200,"), "stale: 10 ms", "stale: 0.5 ms")
    text = edited(edited(text, "hang_timeout: 50 ms", "hang_timeout: 1 ms"), "pulse: 0.5 V", "pulse: 1.5 V")
    load_text(text, "x.yaml", configs_dir())


def test_the_allowed_excitation_has_room_for_a_burst() -> None:
    text = edited(VIRTUAL, "kind: continuous", "kind: burst\n      duration: 0.8 s")
    text = edited(text, "excitation: 3600 s", "excitation: 0.84 s")
    fragment = "must be longer than one burst (entry + duration = 0.05 s + 0.8 s)"
    assert_only_error(text, "excitation: 0.84", "limits.excitation", fragment)


WIRING = [
    ("sensor: angle\n", "sensor: angel\n", "sensor", "no 'angel' under sensors; did you mean 'angle'?"),
    ("output: valve\n", "output: vavle\n", "output", "no 'vavle' under outputs; did you mean 'valve'?"),
    ("channel: Encoder.angle", "channel: Encoder.angel", "sensors.angle.channel", "mean 'Encoder.angle'?"),
    ("channel: Encoder.angle", "channel: Encodr.angle", "sensors.angle.channel", "no channel 'Encodr.angle'"),
    ("channel: Encoder.angle", "channel: Valve.voltage #", "sensors.angle.channel", "is an output of"),
    ("channel: Valve.voltage", "channel: Encoder.angle #", "outputs.valve.channel", "is an input of"),
    ("channel: Encoder.run_enable", "channel: Encoder.enable", "guard.estop.channel", "input channels: Enc"),
    ("unit: rad\n", "unit: deg\n", "sensors.angle.unit", "is in rad, and scale 1 leaves it so"),
    ("unit: V\n", "unit: mV\n", "outputs.valve.unit", "'Valve.voltage' is in V, and scale 1 leaves it so"),
    ("output: 2 V\n", "output: 12 V\n", "limits.output", "'Valve.voltage', which carries only -10 to 10"),
    ("Encoder.run_enable: 1\n", "Encoder.run: 1\n", "simulation.constants.Encoder.run", "no input channel"),
    ("dbc: motor.dbc ", "dbc: moter.dbc ", "driver.dbc", "moter.dbc"),
    ("node: seod ", "node: soed ", "driver.node", "seod"),
    ("    Supply:\n", "    Suply:\n", "driver.messages", "Supply"),
    ("kind: can\n", "kind: cna\n", "driver.kind", "known kinds: can, replay, serial, virtual"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "fragment"), WIRING)
def test_wrong_references_and_channels_are_told(old: str, new: str, key: str, fragment: str) -> None:
    text = edited(CAN, old, new)
    found = {where: words for _, where, words in errors_of(text)}
    assert key in found, found
    assert fragment in found[key]


@pytest.mark.parametrize(
    ("old", "new", "key", "right"),
    [
        ("hysteresis: 4 mrad", "hysteresis: 4 mm", "relay.hysteresis", "rad, mrad, deg, rev"),
        (
            "travel: [-60 deg, 60 deg]",
            "travel: [-60 deg, 1 m]",
            "limits.travel[1]",
            "rad, mrad, deg, rev",
        ),
        ("speed: 60 rad/s", "speed: 60 m/s", "limits.speed", "rad/s, deg/s"),
        ("amplitude: 0.45 rad", "amplitude: 0.45 m", "limits.amplitude", "rad, mrad, deg, rev"),
        ("movement: 30 mrad", "movement: 30 mm", "polarity.movement", "rad, mrad, deg, rev"),
        ("timeout: 3 s", "tolerance: 1 mm", "hold.tolerance", "rad, mrad, deg, rev"),
    ],
)
def test_a_length_does_not_pass_where_the_sensor_measures_an_angle(
    old: str, new: str, key: str, right: str
) -> None:
    text = edited(VIRTUAL, old, new)
    assert_only_error(text, new, key, "sensor 'angle' measures angle", f"must be in {right}")


def test_position_control_needs_a_position() -> None:
    errors = errors_of(edited(VIRTUAL, "unit: rad\n", "unit: bar\n"))
    assert ("sensor", "sensor 'angle' measures pressure; position control needs a position") in [
        (key, words.partition("; a sensor in")[0]) for _, key, words in errors
    ]


def second_axis(text: str, output: str, **renamed: str) -> str:
    start, end = text.index("  motor:\n"), text.index("guard:\n")
    axis = text[start:end].replace("  motor:\n", "  other:\n").replace("output: valve", f"output: {output}")
    for old, new in renamed.items():
        axis = axis.replace(f"{old}: angle", f"{old}: {new}")
    return text[:end] + axis + text[end:]


def test_two_axes_cannot_drive_one_channel_even_by_two_names() -> None:
    assert ("axes.other.output", "channel 'amplifier' is already driven by axis 'motor'") in [
        (key, words.partition(";")[0]) for _, key, words in errors_of(second_axis(VIRTUAL, "valve"))
    ]
    text = edited(VIRTUAL, "  valve:\n", "  again:\n    channel: amplifier\n  valve:\n")
    assert "axes.other.output" in [key for _, key, _ in errors_of(second_axis(text, "again"))]


def test_an_axis_must_close_its_loop_over_one_simulated_plant() -> None:
    plant = "    second:\n      {input: amp2, output: enc2, K_L: 1, omega_n: 50, zeta: 1}\n"
    text = edited(VIRTUAL, "  seed: 1 ", plant + "  seed: 1 ")
    crossed = edited(text, "channel: encoder", "channel: enc2")
    fragment = "channel 'amplifier' moves the plant behind 'encoder', not 'enc2'"
    assert_only_error(crossed, "sensor: angle", "sensor", fragment)


def test_the_virtual_rig_needs_a_simulation() -> None:
    text = VIRTUAL[: VIRTUAL.index("simulation:\n")]
    assert_only_error(text, "kind: virtual", "driver.kind", "a `simulation:` section at the top level")


def test_the_simulation_stands_at_the_top_level_only() -> None:
    text = edited(VIRTUAL, "  kind: virtual", "  simulation: {plants: {}}\n  kind: virtual")
    assert_only_error(text, "simulation: {plants", "driver.simulation", "stands at the top level")


def test_a_driver_that_must_be_asked_cannot_pace_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    text = edited(VIRTUAL, "pace: timer", "pace: sensor")
    load_text(text, "x.yaml", configs_dir())
    monkeypatch.setattr(driver_class("virtual"), "push", False)
    assert_only_error(text, "pace: sensor", "loop.pace", "has to be asked for samples; pace: timer")


def test_a_travel_that_the_sensor_cannot_see_is_refused() -> None:
    text = edited(CAN, "travel: [-60 deg, 60 deg]", "travel: [-2 rad, 3000 rad]")
    assert_only_error(text, "travel: [-2", "limits.travel", "reads only -2147.48 to 2147.48")


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.0.5", "rig.example", ""])
def test_other_machines_are_let_in_only_with_tls_and_tokens(host: str) -> None:
    errors = errors_of(edited(VIRTUAL, "host: 127.0.0.1", f"host: '{host}'"))
    assert [key for _, key, _ in errors] == ["server.host"]
    if host:
        assert "which needs tls and read_token and command_token" in errors[0][2]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_needs_neither(host: str) -> None:
    load_text(edited(VIRTUAL, "host: 127.0.0.1", f"host: '{host}'"), "x.yaml", configs_dir())


SECURE = "host: 0.0.0.0\n  tls: {certificate: c.pem, key: k.pem}\n  read_token: %s\n  command_token: %s\n#"


def test_certificates_are_found_from_the_rig_files_folder(tmp_path: Path) -> None:
    for name in ("c.pem", "k.pem"):
        (tmp_path / name).write_text("pem")
    text = edited(VIRTUAL, "host: 127.0.0.1", SECURE % ("r" * 16, "c" * 16))
    config = load_text(text, "x.yaml", tmp_path)
    assert config.server.tls is not None
    assert config.server.tls.certificate == str(tmp_path / "c.pem")
    assert RigConfig.model_validate_json(config.model_dump_json(context=WITH_TOKENS)) == config


def test_missing_certificates_and_weak_or_equal_tokens_are_told(tmp_path: Path) -> None:
    text = edited(VIRTUAL, "host: 127.0.0.1", SECURE % ("t" * 16, "t" * 16))
    with pytest.raises(ConfigErrors) as caught:
        load_text(text, "x.yaml", tmp_path)
    assert [error.key for error in caught.value.errors] == [
        "server.tls.certificate", "server.tls.key", "server.command_token",
    ]  # fmt: skip
    weak = edited(VIRTUAL, "port: 7600", "port: 7600\n  read_token: abc")
    assert_only_error(weak, "read_token: abc", "server.read_token", "at least 16 characters")


def test_a_token_is_never_repeated_in_a_message() -> None:
    weak = edited(VIRTUAL, "port: 7600", "port: 7600\n  read_token: hushhush")
    assert "hushhush" not in str(errors_of(weak))


@pytest.mark.parametrize("version", ["2", "'1'", "1.0", "true", ""])
def test_another_version_is_one_clear_error(version: str) -> None:
    text = edited(VIRTUAL, "version: 1 ", f"version: {version} ").replace("rate_hz", "rate")
    assert_only_error(text, "version:", "version", "this seod reads version 1, the file has")


def test_all_mistakes_are_told_at_once_in_the_order_of_the_lines() -> None:
    text = edited(VIRTUAL, "version: 1 ", "versoin: 1 ")
    text = edited(text, "rate_hz: 2000 ", "rate_hz: -1 ")
    text = edited(text, "channel: encoder", "channel: encodr")
    text = edited(text, "e_a: 0.5 V ", "e_a: 12 deg ")
    text = edited(text, "speed: 60 rad/s", "speed: 60 mm/s")
    text = edited(text, "stale: 10 ms", "stale: 10 ms\n  stale: 20 ms")
    text = edited(text, "host: 127.0.0.1", "host: 0.0.0.0")
    errors = errors_of(text)
    assert [key for _, key, _ in errors] == [
        "version", "versoin", "loop.rate_hz", "sensors.angle.channel", "sensor", "relay.e_a",
        "limits.speed", "guard.stale", "server.host",
    ]  # fmt: skip
    assert [line for line, _, _ in errors] == sorted(line for line, _, _ in errors)


def test_the_text_names_file_line_key_and_what_is_wrong(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(edited(VIRTUAL, "port: 7600", "port: -1"))
    with pytest.raises(ConfigErrors) as caught:
        load_rig(file)
    line = line_of(file.read_text(), "port: -1")
    assert str(caught.value) == f"{file}:{line}: server.port: must be >= 0, got -1"


def test_names_become_words_in_commands_so_they_are_checked() -> None:
    text = edited(VIRTUAL, "axes:\n  motor:\n", "axes:\n  my motor:\n")
    assert "cannot be used as a name; letters, digits, _ and -" in errors_of(text)[0][2]


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("", "the file is empty"),
        ("# nothing\n", "the file is empty"),
        ("- a\n- b\n", "must be a mapping of keys to values, got "),
        ("just text", "must be a mapping"),
        ("a: [", "is never closed"),
    ],
)
def test_what_is_no_rig_file_at_all_is_one_error(text: str, fragment: str) -> None:
    errors = errors_of(text)
    assert len(errors) == 1
    assert fragment in errors[0][2]


NONSENSE = ("", "5", "[]", "text", "{}", "{a: }", "{a: {}}", "{a: [{}]}", ".nan")


@pytest.mark.parametrize(
    "section", ["driver", "loop", "sensors", "outputs", "axes", "guard", "server", "simulation"]
)
def test_any_nonsense_in_a_section_is_told_not_raised(section: str) -> None:
    lines = [line for line in VIRTUAL.splitlines() if line and not line.startswith("#")]
    start = next(i for i, line in enumerate(lines) if line == f"{section}:")
    end = next((i for i in range(start + 1, len(lines)) if not lines[i].startswith(" ")), len(lines))
    for value in NONSENSE:
        text = "\n".join([*lines[:start], f"{section}: {value}", *lines[end:]])
        if section in ("loop", "guard", "server") and value == "{}":
            load_text(text, "x.yaml", configs_dir())
        else:
            assert any(key.startswith(section) or section in words for _, key, words in errors_of(text))


@pytest.mark.parametrize("data", [b"\xff\xfe", b"a: 1\nb: \x80\n", b"a: 1\n" * 300_000])
def test_bytes_that_are_no_text_are_told(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.yaml").write_bytes(data)
    with pytest.raises(ConfigErrors, match=r"UTF-8|larger than"):
        load_rig(tmp_path / "x.yaml")


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_bytes(b"\xef\xbb\xbf" + VIRTUAL.encode())
    assert load_rig(tmp_path / "x.yaml").rig == "virtual-motor"


@pytest.mark.parametrize("name", ["missing.yaml", "", "a\0b"])
def test_a_file_that_cannot_be_read_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigErrors, match=r"cannot be read|is a folder, not a file"):
        load_rig(f"{tmp_path}/{name}")
