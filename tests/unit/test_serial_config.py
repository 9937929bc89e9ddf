"""The `driver:` section of a board on a serial line: what is refused, and with which words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.serial_codec import BinaryCodec, make_codec, numbers_of
from drivers.serial_config import CODES, FieldOptions, SerialOptions
from drivers.serial_counters import COUNTER_NAMES
from seod.config.errors import ConfigErrors
from seod.config.load import load_text
from seod.files.shipped import configs_dir
from tests.unit.serial_bench import make_options

SERIAL = (configs_dir() / "serial.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "place", "says"),
    [
        ("type: int32", "type: int64", "driver.inputs", "float32"),
        ("scale: 1.0e-5", "scale: 0", "driver.inputs", "scale must not be 0"),
        ("name: run_enable", "name: angle", "driver", "angle is there twice"),
        ("name: run_enable", "name: time", "driver.inputs", "a field of the line itself"),
        ("format: binary", "format: text", "driver.format", "ascii"),
        ("format: binary", "format: binary\n  fields: [angle]", "driver", "belong to format: ascii"),
        ("format: binary", "format: ascii\n  fields: [angle]", "driver", "each input once"),
        ("format: binary", "format: ascii\n  fields: [age, angle, run_enable]", "driver", "age needs ack"),
        ("  usb: true", "  bauds: 3\n  usb: true", "driver.bauds", "baud"),
        ("port: /tmp/seod-board", 'port: ""', "driver.port", "1"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(old: str, new: str, place: str, says: str) -> None:
    assert SERIAL.count(old) >= 1
    with pytest.raises(ConfigErrors) as refused:
        load_text(SERIAL.replace(old, new, 1), "x.yaml", configs_dir())
    assert place in str(refused.value)
    assert says in str(refused.value)


def test_blocks_that_no_frame_carries_are_refused() -> None:
    many = [{"name": f"x{k}"} for k in range(60)]
    with pytest.raises(ValueError, match="inputs take 240 bytes: a frame carries 238"):
        make_options(inputs=many)


@given(st.sampled_from(sorted(CODES)), st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.floats(-1e6, 1e6))
def test_values_keep_within_what_their_type_carries(
    kind: str, offset: float, scale: float, value: float
) -> None:
    field = FieldOptions.model_validate({"name": "x", "type": kind, "scale": scale, "offset": offset})
    low, high = field.limits
    (number,) = numbers_of([field], [value])
    assert field.numbers[0] <= number <= field.numbers[1]
    if low < value < high:
        assert number * scale + offset == pytest.approx(value, rel=1e-9, abs=1e-6)


def test_a_negative_scale_turns_the_limits_round() -> None:
    field = FieldOptions.model_validate({"name": "x", "type": "uint8", "scale": -2.0, "offset": 10.0})
    assert field.limits == (-500.0, 10.0)


@pytest.mark.parametrize("form", ["binary", "ascii"])
def test_no_frame_is_longer_than_the_load_reckons(form: str) -> None:
    options: SerialOptions = make_options(format=form)
    codec = make_codec(options, [0] * len(COUNTER_NAMES))
    longest = max(len(codec.command(n, [volts])) for n in (0, 255) for volts in (0.0, -12.3456789, 1e-5 / 3))
    assert longest <= codec.command_bytes()
    if isinstance(codec, BinaryCodec):
        assert longest == codec.command_bytes()
