"""`seod check`: the bus load, and what a careful person would ask about."""

from __future__ import annotations

import pytest

from drivers.can_load import Bus, Frame, bits, classic_bits, fd_bits
from drivers.serial_load import Line
from seod.config.check import Report, check
from seod.config.load import load_text
from seod.files.shipped import configs_dir
from tests.unit.rig_texts import can_at_2_khz

VIRTUAL = (configs_dir() / "virtual.yaml").read_text()
CAN = can_at_2_khz()


def report(text: str, *edits: tuple[str, str]):
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return check(load_text(text, "x.yaml", configs_dir()))


def bus_of(found: Report) -> Bus:
    assert found.connection is not None
    assert isinstance(found.connection.traffic, Bus)
    return found.connection.traffic


@pytest.mark.parametrize(
    ("length", "extended", "longest"),
    [
        # 34 + 8 n + 13 and a stuff bit after each four of the first 34 + 8 n: 47 + 8; 79 + 16; 111 + 24
        (0, False, 55),
        (4, False, 95),
        (8, False, 135),
        # 54 + 8 n + 13: 67 + 13; 131 + 29; the last is the familiar 160 bits
        (0, True, 80),
        (8, True, 160),
    ],
)
def test_classic_frames_have_the_published_worst_case_length(
    length: int, extended: bool, longest: int
) -> None:
    assert classic_bits(length, extended) == longest


@pytest.mark.parametrize(
    ("length", "extended", "nominal", "data"),
    [
        # head 17 + 4 stuffed + 13; ESI and DLC 5, stuffed up to (22 - 1) // 4 = 5 in all, CRC field 27
        (0, False, 34, 5 + 1 + 27),
        # 5 + 64 of body, (86 - 1) // 4 = 21 stuff bits less the 4 in the head
        (8, False, 34, 69 + 17 + 27),
        (16, False, 34, 133 + 33 + 27),
        # beyond 16 bytes the CRC has 21 bits and 7 fixed stuff bits
        (20, False, 34, 165 + 41 + 32),
        (64, False, 34, 517 + 129 + 32),
        # head 36 + 8 stuffed + 13; (36 + 69 - 1) // 4 = 26 stuff bits less 8
        (8, True, 57, 69 + 18 + 27),
    ],
)
def test_fd_frames_counted_by_hand(length: int, extended: bool, nominal: int, data: int) -> None:
    assert fd_bits(length, extended) == (nominal, data)


def test_load_is_the_part_of_the_time_that_the_bus_is_busy() -> None:
    classic = Bus("c", 500_000, None, (Frame("a", 8, 1000), Frame("b", 0, 500)))
    assert classic.load() == pytest.approx((135 * 1000 + 55 * 500) / 500_000)
    fd = Frame("a", 8, 2000, fd=True)
    assert bits(fd) == (34, 113)
    assert Bus("d", 1_000_000, 5_000_000, (fd,)).load() == pytest.approx(2000 * (34e-6 + 113 / 5e6))
    assert Bus("d", 1_000_000, None, (fd,)).load() == pytest.approx(2000 * 147e-6)


def test_the_example_fits_its_bus_with_sensors_commands_and_known_rates() -> None:
    found = report(CAN)
    assert [(f.name, f.length, f.rate_hz) for f in bus_of(found).frames] == [
        ("Encoder", 8, 2000.0), ("Supply", 4, 100.0), ("Valve", 4, 2000.0),
    ]  # fmt: skip
    assert bus_of(found).load() == pytest.approx((135 * 2000 + 95 * 100 + 95 * 2000) / 1e6)
    assert (found.ok, found.exit_status, found.warnings) == (True, 0, ())
    assert "Encoder                      8   135      2000   27.0%" in str(found)
    assert str(found).endswith("verdict: ok")


def test_ticks_and_heartbeats_are_counted() -> None:
    sync = (
        "tick_frames: [{id: 0x80}]\n  heartbeat: [{id: 0x701, data: '05', period_s: 0.1, extended: true}]\n  "
    )
    found = report(CAN, ("max_in_flight: 3 ", sync + "max_in_flight: 3 "))
    assert [(f.name, f.length, f.rate_hz, f.extended) for f in bus_of(found).frames[:2]] == [
        ("0x80", 0, 2000.0, False), ("0x701", 1, 10.0, True),
    ]  # fmt: skip


def test_sensors_of_unknown_rate_are_taken_at_the_loop_rate_and_others_are_named() -> None:
    rates = CAN[CAN.index("  messages:\n") : CAN.index("  # start_frames")]
    found = report(CAN, (rates, ""), ("rate_hz: 2000\n  pace", "rate_hz: 1000\n  pace"))
    assert [(f.name, f.rate_hz) for f in bus_of(found).frames] == [("Encoder", 1000.0), ("Valve", 1000.0)]
    assert found.warnings == (
        "message Supply is not counted in the bus load: give driver.messages.Supply.rate_hz",
    )


@pytest.mark.parametrize(
    ("bitrate", "ok", "word"), [(600_000, True, "ok"), (580_000, True, "late"), (460_000, False, "refused")]
)
def test_a_full_bus_is_warned_of_and_an_overfull_one_refused(bitrate: int, ok: bool, word: str) -> None:
    found = report(CAN, ("bitrate: 1000000", f"bitrate: {bitrate}"))
    assert (found.ok, found.exit_status) == (ok, 0 if ok else 1)
    assert word in str(found)
    assert bool(found.refusals or found.warnings) == (word != "ok")


def test_a_sensor_slower_than_the_stale_limit_is_refused() -> None:
    found = report(CAN, ("rate_hz: 2000                #", "rate_hz: 50 #"))
    assert found.refusals == (
        "sensors.angle comes each 0.02 s, guard.stale is 0.01 s: always stale; "
        "guard.stale must be at least two periods, 0.04 s",
        "guard.estop comes each 0.02 s, guard.stale is 0.01 s: always stale; "
        "guard.stale must be at least two periods, 0.04 s",
    )


@pytest.mark.parametrize(("stale", "fits"), [("10 ms", False), ("19.9 ms", False), ("20 ms", True)])
def test_stale_spans_two_periods_of_a_message(stale: str, fits: bool) -> None:
    found = report(
        CAN, ("rate_hz: 2000                #", "rate_hz: 100 #"), ("stale: 10 ms", f"stale: {stale}")
    )
    assert found.ok is fits
    board = report(
        SERIAL,
        ("  rate_hz: 2000                   # samples", "  rate_hz: 100 # samples"),
        ("stale: 50 ms", f"stale: {stale}"),
    )
    assert board.ok is fits


def test_a_polarity_pulse_has_room_for_five_samples_of_a_slow_sensor() -> None:
    slow = ("rate_hz: 2000                #", "rate_hz: 200 #")
    pulse = ("movement: 30 mrad", "movement: 30 mrad\n      duration: 24 ms")
    found = report(CAN, slow, pulse)
    assert found.refusals == (
        "axes.motor.polarity.duration is 0.024 s, it must be at least 0.025 s: "
        "5 samples of the sensor, or left out",
    )
    assert report(CAN, slow, ("movement: 30 mrad", "movement: 30 mrad\n      duration: 25 ms")).ok
    assert report(CAN, slow).ok


def test_fd_messages_of_the_dbc_are_fd_frames(tmp_path) -> None:
    dbc = (configs_dir() / "motor.dbc").read_text()
    form = 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD","ExtendedCAN_FD";\n'
    form += 'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";\nBA_ "VFrameFormat" BO_ 513 2;\n'
    (tmp_path / "motor.dbc").write_text(dbc + form)
    refusals = check(load_text(CAN, "x.yaml", tmp_path)).refusals
    assert refusals == ("Valve is an FD frame: set driver.fd: true, or make it classic in the DBC",)
    text = CAN.replace("dbc: motor.dbc", "dbc: motor.dbc\n  fd: true\n  data_bitrate: 4000000\n#")
    bus = bus_of(check(load_text(text, "x.yaml", tmp_path)))
    assert {frame.name: frame.fd for frame in bus.frames} == {
        "Encoder": False,
        "Supply": False,
        "Valve": True,
    }
    assert bus.data_bitrate == 4_000_000


def test_missing_safety_is_asked_about_on_a_bus() -> None:
    estop = CAN[CAN.index("  estop:\n") : CAN.index("server:\n")]
    found = report(
        CAN,
        (estop, ""),
        ("  rig_watchdog: 20 ms\n", ""),
        (
            "movement: 30 mrad",
            "movement: 1\n      enabled: no".replace("no", "false").replace("1", "30 mrad"),
        ),
    )
    assert [warning.split(" ")[0] for warning in found.warnings] == [
        "axes.motor.polarity", "guard.estop", "guard.rig_watchdog",
    ]  # fmt: skip
    assert found.ok
    assert str(found).endswith("verdict: ok, with warnings")


def test_a_recording_needs_neither_estop_nor_watchdog(tmp_path) -> None:
    (tmp_path / "run.mcap").touch()
    config = load_text(VIRTUAL, "x.yaml", configs_dir())
    guard = config.guard.model_copy(update={"rig_watchdog": None})
    driver = {"kind": "replay", "file": str(tmp_path / "run.mcap")}
    replayed = {"driver": driver, "guard": guard, "simulation": None}
    found = check(config.model_copy(update=replayed))
    assert (found.warnings, found.refusals) == ((), ())


def test_the_rig_inside_the_daemon_needs_neither_estop_nor_bus() -> None:
    found = report(VIRTUAL, ("  rig_watchdog: 20 ms ", "  # "))
    assert (found.connection, found.warnings) == (None, ())


def test_beliefs_that_differ_from_the_simulated_rig_are_told() -> None:
    found = report(
        VIRTUAL, ("watchdog_s: 0.02", "watchdog_s: 0.05"), ("K_L: 17                   #", "K_L: 20 #")
    )
    assert found.warnings == (
        "guard.rig_watchdog is 0.02 s, simulation.watchdog_s is 0.05 s",
        "axes.motor.K_L is 17 rad/s/V, the simulated plant has 20: zeta will be off",
    )


def test_a_simulated_rig_wired_the_wrong_way_round_is_told() -> None:
    found = report(VIRTUAL, ("unit: V\n", "unit: V\n    scale: -1\n"))
    assert found.warnings == (
        "axes.motor is wired the wrong way round to its simulated plant (scales below 0)",
    )


SERIAL = (configs_dir() / "serial.yaml").read_text()
UART = ("  usb: true ", "  baud: 1000000 #")


def test_the_serial_lines_load_is_that_of_its_bytes_each_way() -> None:
    told = report(SERIAL, UART)
    line = told.connection.traffic
    assert isinstance(line, Line)
    samples, commands = line.ways
    # type, sequence, 8 of time, status and acknowledgement, 5 of inputs, CRC of 4, COBS, end; 10 bits a byte
    assert (samples.length, samples.rate_hz) == (2 + 8 + 5 + 4 + 1 + 1, 2000.0)
    assert line.share(samples) == pytest.approx(21 * 10 * 2000 / 1e6)
    assert commands.length == 2 + 2 + 4 + 1 + 1
    assert told.ok
    assert "42.0%" in str(told)


def test_a_line_that_is_too_slow_is_refused_and_a_full_one_warned_of() -> None:
    slow = report(SERIAL, ("  usb: true ", "  baud: 115200 #"))
    assert [text.split(" would")[0] for text in slow.refusals] == ["samples", "commands"]
    full = report(SERIAL, ("  usb: true ", "  baud: 500000 #"))
    assert full.ok
    assert any("samples keep" in text and "84% of the time" in text for text in full.warnings)


def test_a_usb_line_has_no_load() -> None:
    told = report(SERIAL)
    assert told.ok
    assert told.warnings == ()
    assert "no bit rate limits it" in str(told)


def test_a_board_that_is_slower_than_the_loop_or_the_guard_is_told() -> None:
    slow = report(SERIAL, ("  rate_hz: 2000                   # samples", "  rate_hz: 15 # samples"))
    assert any("always stale" in text for text in slow.refusals)
    assert any("some ticks have no new sample" in text for text in slow.warnings)
    patient = report(SERIAL, ("  watchdog_s: 0.05                #", "  watchdog_s: 0.2 #"))
    assert any("allows the board 0.2 s" in text for text in patient.warnings)
