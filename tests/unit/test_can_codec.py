"""Frames to values and back: against cantools itself, published CRC values, and with broken frames."""

from __future__ import annotations

import math
from pathlib import Path

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.can_checksum import crc8_j1850, sum8, xor8
from drivers.can_codec import CanCodec, CodecError, UnknownFrameError, WrongLengthError
from drivers.can_config import CanOptions

CONFIGS = Path(__file__).parents[2] / "configs"
ENCODER, VALVE = 257, 513


def options(directory: Path = CONFIGS, **changes: object) -> CanOptions:
    section = {"kind": "can", "channel": "can0", "dbc": "motor.dbc", **changes}
    return CanOptions.model_validate(section, context={"directory": directory})


def write_dbc(directory: Path, *messages: str, trailer: str = "") -> CanCodec:
    text = 'VERSION ""\nNS_ :\nBS_:\nBU_: seod rig\n\n' + "\n\n".join(messages) + "\n\n" + trailer
    (directory / "rig.dbc").write_text(text)
    return CanCodec(options(directory, dbc="rig.dbc"))


CODEC = CanCodec(options())
DATABASE = cantools.database.load_file(CONFIGS / "motor.dbc")


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        ("00000000", 0x59),
        ("F20183", 0x37),
        ("0FAA0055", 0x79),
        ("00FF5511", 0xB8),
        ("332255AABBCCDDEEFF", 0xCB),
    ],
)
def test_crc8_gives_the_check_values_of_the_autosar_specification(data: str, crc: int) -> None:
    assert crc8_j1850(bytes.fromhex(data)) == crc


def test_the_simple_checksums() -> None:
    assert xor8(bytes([0x0F, 0xF0, 0x01])) == 0xFE
    assert sum8(bytes([0xFF, 0x02, 0x10])) == 0x11


@given(volts=st.floats(-10, 10), counter=st.integers(0, 1000))
def test_a_command_comes_back_as_it_was_sent(volts: float, counter: int) -> None:
    decoded = CODEC.decode(VALVE, False, CODEC.encode("Valve", {"voltage": volts}, counter))
    assert decoded.message == "Valve"
    assert decoded.values["voltage"] == pytest.approx(volts, abs=0.0005 / 2 + 1e-12)
    assert decoded.counter == counter % 16
    assert decoded.checksum_ok


@given(angle=st.floats(-2147, 2147), run=st.integers(0, 1), counter=st.integers(0, 255))
def test_frames_are_those_of_cantools(angle: float, run: int, counter: int) -> None:
    data = CODEC.encode("Encoder", {"angle": angle, "run_enable": run}, counter)
    content = DATABASE.decode_message("Encoder", data)
    assert isinstance(content, dict)
    assert content["angle"] == pytest.approx(angle, abs=0.5e-6 + 1e-9)
    assert content["run_enable"] == run
    assert content["counter"] == counter
    assert content["checksum"] == crc8_j1850(data[:7])


@given(angle=st.floats(-10, 10), counter=st.integers(0, 255), bit=st.integers(0, 63))
def test_no_flipped_bit_passes_the_checksum(angle: float, counter: int, bit: int) -> None:
    data = bytearray(CODEC.encode("Encoder", {"angle": angle, "run_enable": 1}, counter))
    data[bit // 8] ^= 1 << bit % 8
    assert not CODEC.decode(ENCODER, False, data).checksum_ok


@given(frame_id=st.integers(0, 0x7FF), extended=st.booleans(), data=st.binary(max_size=64))
def test_whatever_arrives_is_decoded_or_refused_by_its_own_error(
    frame_id: int, extended: bool, data: bytes
) -> None:
    try:
        decoded = CODEC.decode(frame_id, extended, data)
    except (UnknownFrameError, WrongLengthError):
        return
    assert len(data) == CODEC.layout(decoded.message).message.length
    assert all(math.isfinite(value) for value in decoded.values.values())


@pytest.mark.parametrize("length", [0, 7, 9, 12])
def test_a_frame_of_another_length_is_refused(length: int) -> None:
    with pytest.raises(WrongLengthError, match=f"Encoder has 8 bytes, the frame {length}"):
        CODEC.decode(ENCODER, False, bytes(length))


def test_an_extended_identifier_is_not_the_standard_one() -> None:
    with pytest.raises(UnknownFrameError, match="0x101"):
        CODEC.decode(ENCODER, True, bytes(8))


def test_values_beyond_the_range_are_clipped() -> None:
    for volts, sent in ((25.0, 10.0), (-25.0, -10.0)):
        values = CODEC.decode(VALVE, False, CODEC.encode("Valve", {"voltage": volts}, 0)).values
        assert values["voltage"] == pytest.approx(sent)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_never_sent(value: float) -> None:
    with pytest.raises(CodecError, match=r"Valve\.voltage: cannot send"):
        CODEC.encode("Valve", {"voltage": value}, 0)


def test_unknown_names_are_answered_with_the_close_ones() -> None:
    with pytest.raises(CodecError, match=r"'Valv'.*Valve"):
        CODEC.encode("Valv", {}, 0)
    with pytest.raises(CodecError, match=r"'voltag'.*voltage"):
        CODEC.encode("Valve", {"voltag": 1.0}, 0)


def test_channels_have_direction_unit_and_range_and_leave_out_counters() -> None:
    channels = {channel.name: channel for channel in CODEC.channels()}
    assert set(channels) == {
        "Encoder.angle",
        "Encoder.run_enable",
        "Supply.pressure",
        "Supply.temperature",
        "Valve.voltage",
    }
    valve = channels["Valve.voltage"]
    assert (valve.direction, valve.unit, valve.minimum, valve.maximum) == ("output", "V", -10, 10)
    assert channels["Encoder.angle"].direction == "input"


def test_big_endian_signals_and_a_checksum_in_the_first_byte(tmp_path: Path) -> None:
    codec = write_dbc(
        tmp_path,
        'BO_ 300 Motor: 4 rig\n SG_ checksum : 7|8@0+ (1,0) [0|0] "" seod\n'
        ' SG_ counter : 15|8@0+ (1,0) [0|0] "" seod\n SG_ speed : 23|16@0- (0.1,0) [0|0] "rad/s" seod',
        trailer='BA_DEF_ BO_ "ChecksumKind" STRING ;\nBA_DEF_DEF_ "ChecksumKind" "";\n'
        'BA_ "ChecksumKind" BO_ 300 "xor8";\n',
    )
    data = codec.encode("Motor", {"speed": -100.0}, 0x42)
    assert data == bytes([0x42 ^ 0xFC ^ 0x18, 0x42, 0xFC, 0x18])
    assert codec.decode(300, False, data) == (
        "Motor",
        {"checksum": 0xA6, "counter": 0x42, "speed": -100.0},
        66,
        True,
    )


def test_a_multiplexed_signal_is_there_only_when_its_switch_says_so(tmp_path: Path) -> None:
    codec = write_dbc(
        tmp_path,
        'BO_ 300 Many: 3 rig\n SG_ page M : 0|8@1+ (1,0) [0|0] "" seod\n'
        ' SG_ a m0 : 8|16@1+ (1,0) [0|0] "" seod\n SG_ b m1 : 8|16@1+ (1,0) [0|0] "" seod',
    )
    assert codec.decode(300, False, bytes([0, 7, 0])).values == {"page": 0, "a": 7}
    assert codec.decode(300, False, bytes([1, 7, 0])).values == {"page": 1, "b": 7}
    with pytest.raises(UnknownFrameError, match="Many cannot be decoded"):
        codec.decode(300, False, bytes([2, 7, 0]))


def test_fd_messages_are_padded_to_a_length_that_exists(tmp_path: Path) -> None:
    codec = write_dbc(tmp_path, 'BO_ 300 Long: 10 seod\n SG_ last : 72|8@1+ (1,0) [0|0] "" rig')
    data = codec.encode("Long", {"last": 9}, 0)
    assert data == bytes(9) + b"\x09" + bytes(2)
    assert codec.decode(300, False, data).values == {"last": 9}
    assert codec.decode(300, False, data[:10]).values == {"last": 9}


def test_counter_and_checksum_of_the_rig_file_win_over_those_of_the_dbc() -> None:
    messages = {"Encoder": {"counter": None, "checksum": None}, "Valve": {"checksum_kind": "sum8"}}
    codec = CanCodec(options(messages=messages))
    assert codec.counter_period("Encoder") == 0
    assert codec.decode(ENCODER, False, bytes(8)).counter is None
    assert codec.decode(ENCODER, False, bytes(8)).checksum_ok
    data = codec.encode("Valve", {"voltage": 1.0}, 5)
    assert data[3] == sum8(data[:3])


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"messages": {"Encodr": {}}}, "'Encodr'.*Encoder"),
        ({"messages": {"Valve": {"counter": "conter"}}}, r"Valve\.counter.*'conter'.*counter"),
        ({"messages": {"Encoder": {"checksum": "angle"}}}, "one whole byte"),
        ({"messages": {"Supply": {"checksum": "temperature"}}}, "checksum_kind must be one of xor8"),
        ({"messages": {"Valve": {"counter": "voltage"}}}, "cannot count frames"),
        ({"node": "sead"}, "'sead'.*seod"),
        ({"dbc": "moter.dbc"}, r"no such file: /.*moter\.dbc"),
        ({"start_frames": [{"id": 0, "data": "1"}]}, "pairs of hexadecimal digits"),
        ({"start_frames": [{"id": 0x800}]}, "extended: true"),
        ({"tick_frames": [{"id": 1, "data": "00" * 12}]}, "more than 8 need fd: true"),
        ({"data_bitrate": 2_000_000}, "needs fd: true"),
        ({"max_in_flight": 0}, "greater than or equal to 1"),
        ({"chanel": "can1"}, "Extra inputs"),
        ({"bitrate": "1000000"}, "valid integer"),
    ],
)
def test_mistakes_of_the_rig_file_say_what_would_be_right(changes: dict[str, object], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        options(**changes)


def test_a_file_that_is_no_dbc_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.dbc").write_text("BO_ what")
    with pytest.raises(ValidationError, match=r"bad\.dbc: cannot be read as a DBC"):
        options(tmp_path, dbc="bad.dbc")


def test_options_survive_the_way_to_another_process() -> None:
    before = options(start_frames=[{"id": 0, "data": "01 00"}], messages={"Encoder": {"rate_hz": 2000}})
    assert Path(before.dbc).is_absolute()
    assert CanOptions.model_validate(before.model_dump(mode="json")) == before
    assert before.start_frames[0].payload == b"\x01\x00"


def test_a_command_counter_too_wide_for_the_supervisor_is_refused(tmp_path: Path) -> None:
    with pytest.raises((CodecError, ValidationError), match=r"Valve\.counter.*8 bits"):
        write_dbc(tmp_path, 'BO_ 300 Valve: 4 seod\n SG_ counter : 0|16@1+ (1,0) [0|0] "" rig')
