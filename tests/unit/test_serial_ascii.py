"""The ASCII form of the serial line (docs/serial.md)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.serial_ascii import Line, board_version, command, opened, read_command, seal
from drivers.serial_frame import BoardSample, CrcError, FrameError

FULL = Line(("time", "sequence", "status", "ack", "age", "angle", "ps"), ("angle", "ps"))
FINITE = st.floats(allow_nan=False, allow_infinity=False, width=32)


def test_the_published_check_of_a_sentence() -> None:
    # NMEA 0183's own kind of checksum: the exclusive or of what is before the star
    assert (
        seal("GPGLL,5300.97914,N,00259.98174,E,125926,A") == b"GPGLL,5300.97914,N,00259.98174,E,125926,A*28\n"
    )


def test_a_line_that_a_simple_board_prints() -> None:
    line = Line(("angle",), ("angle",))
    assert line.read(b"  512\r") == BoardSample(None, None, 0, None, None, [512.0])


@pytest.mark.parametrize("text", [b"12,5,0.25", b"12 5\t0.25", b"12; 5 ,0.25\r"])
def test_any_gap_will_do(text: bytes) -> None:
    sample = Line(("time", "sequence", "angle"), ("angle",)).read(text)
    assert sample == BoardSample(5, 12, 0, None, None, [0.25])


@pytest.mark.parametrize("text", [b"", b"\r", b"# seod 1 my board", b"   "])
def test_comments_and_empty_lines_are_no_samples(text: bytes) -> None:
    assert FULL.read(text) is None


def test_the_order_of_the_fields_is_the_rig_files() -> None:
    line = Line(("b", "time", "a"), ("a", "b"))
    assert line.read(b"2,99,1") == BoardSample(None, 99, 0, None, None, [1.0, 2.0])


@pytest.mark.parametrize(
    "text",
    [b"1,2,3", b"1,2,x", b"-1,2,3", b"1,256,3", b"1.5,2,3", b"1,2,nan", b"1,2,inf", b"1,2,3,4", b"1,2,\xff"],
)
def test_what_is_no_sample_is_refused(text: bytes) -> None:
    line = Line(("time", "sequence", "angle"), ("angle",))
    if text == b"1,2,3":
        assert line.read(text) is not None
        return
    with pytest.raises(FrameError):
        line.read(text)


def test_a_wrong_checksum_is_told_from_none() -> None:
    line = Line(("angle",), ("angle",), sealed=True)
    assert line.read(seal("1.5").rstrip(b"\n")) is not None
    with pytest.raises(CrcError):
        line.read(b"1.5*00")
    with pytest.raises(FrameError, match="no checksum"):
        line.read(b"1.5")
    with pytest.raises(FrameError, match="unreadable"):
        line.read(b"1.5*0")


@given(st.integers(0, 255), st.integers(0, (1 << 32) - 1), st.integers(0, 65534), FINITE, FINITE)
def test_every_sample_comes_back(number: int, time_us: int, age: int, angle: float, ps: float) -> None:
    s = BoardSample(number, time_us, 3, 9, age, [angle, ps])
    read = FULL.read(FULL.write(s).rstrip(b"\n"))
    assert read is not None
    assert read[:5] == s[:5]
    assert read.numbers == pytest.approx(s.numbers, rel=1e-8)


@given(st.integers(0, 1000), st.lists(FINITE, min_size=1, max_size=3))
def test_every_command_comes_back(number: int, values: list[float]) -> None:
    sequence, read = read_command(opened(command(number, values).rstrip(b"\n"), sealed=True), len(values))
    assert sequence == number % 256
    assert read == pytest.approx(values, rel=1e-8)


@pytest.mark.parametrize("text", ["x 1 2", "u 1", "u 1 2 3", "u 300 2", "u 1 two", "u", "u 1 nan", "", " "])
def test_what_is_no_command_is_refused(text: str) -> None:
    with pytest.raises(FrameError):
        read_command(text, 1)


@given(st.binary(max_size=60))
def test_any_bytes_are_a_sample_nothing_or_a_frame_error(data: bytes) -> None:
    try:
        sample = FULL.read(data)
    except FrameError:
        return
    assert sample is None or len(sample.numbers) == 2


def test_the_version_in_a_comment() -> None:
    assert board_version(b"# seod 1 ready") == 1
    assert board_version(b"#seod 12") == 12
    assert board_version(b"# hello") is None
    assert board_version(b"1,2,3") is None
