"""The binary form of the serial line (docs/serial.md): known bytes, any bytes, hostile bytes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.serial_frame import (
    ASK,
    COMMAND,
    HELLO,
    LARGEST,
    SAMPLE,
    Block,
    BoardSample,
    Frame,
    FrameError,
    Splitter,
    decode,
    encode,
    hello,
    read_hello,
    read_sample,
    sample,
)

BODIES = st.binary(max_size=LARGEST - 6)


def crc32_by_bits(data: bytes) -> int:
    """Ethernet's CRC, written apart: a shift register, bit by bit."""
    register = 0xFFFFFFFF
    for byte in data:
        for bit in range(8):
            feedback = (register ^ (byte >> bit)) & 1
            register = (register >> 1) ^ (0xEDB88320 if feedback else 0)
    return register ^ 0xFFFFFFFF


def uncobs(encoded: bytes) -> bytes:
    """COBS decoded by its definition, written apart."""
    out, rest = bytearray(), encoded
    while rest:
        block, rest = rest[: rest[0]], rest[rest[0] :]
        out += block[1:]
        if rest:
            out.append(0)
    return bytes(out)


def test_the_bytes_of_a_command_counted_by_hand() -> None:
    content = bytes([0x83, 7, 0x10, 0x00])  # int16 16, little-endian
    content += crc32_by_bits(content).to_bytes(4, "little")
    frame = encode(COMMAND, 7, Block("h").pack([16]))
    assert frame[-1:] == b"\0"
    assert frame.count(0) == 1
    assert uncobs(frame[:-1]) == content


def test_the_published_check_value_of_the_crc() -> None:
    assert crc32_by_bits(b"123456789") == 0xCBF43926


@given(kind=st.integers(0, 255), sequence=st.integers(0, 1000), body=BODIES)
def test_every_frame_comes_back(kind: int, sequence: int, body: bytes) -> None:
    frame = encode(kind, sequence, body)
    assert frame.index(0) == len(frame) - 1 == len(body) + 7
    assert decode(frame[:-1]) == Frame(kind, sequence % 256, body)
    content = uncobs(frame[:-1])
    assert content[-4:] == crc32_by_bits(content[:-4]).to_bytes(4, "little")


def test_a_body_that_is_too_long_is_refused() -> None:
    with pytest.raises(FrameError, match="252"):
        encode(SAMPLE, 0, bytes(LARGEST - 5))


@given(body=BODIES, at=st.integers(0, 300), change=st.integers(1, 255))
def test_no_changed_byte_passes(body: bytes, at: int, change: int) -> None:
    frame = bytearray(encode(SAMPLE, 3, body)[:-1])
    frame[at % len(frame)] ^= change
    for part in bytes(frame).split(b"\0"):
        with pytest.raises(FrameError):
            decode(part)


@given(st.binary(max_size=300))
def test_garbage_raises_nothing_else(data: bytes) -> None:
    for part in data.split(b"\0"):
        with pytest.raises(FrameError):
            decode(part)


@given(st.lists(st.binary(min_size=1, max_size=40)), st.data())
def test_frames_are_found_however_the_bytes_are_cut(bodies: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(encode(SAMPLE, 0, body) for body in bodies)
    splitter, found = Splitter(b"\0", LARGEST + 1), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        found += splitter.feed(stream[:size])
        stream = stream[size:]
    assert [decode(each).body for each in found] == bodies
    assert splitter.thrown == 0


@given(garbage=st.binary(max_size=2000), cuts=st.integers(1, 300))
def test_after_any_garbage_the_next_whole_frame_is_found(garbage: bytes, cuts: int) -> None:
    splitter, found = Splitter(b"\0", LARGEST + 1), []
    stream = garbage + b"\0" + encode(SAMPLE, 0, b"good")
    for start in range(0, len(stream), cuts):
        found += splitter.feed(stream[start : start + cuts])
    assert decode(found[-1]).body == b"good"


def test_bytes_without_an_end_do_not_pile_up_and_are_counted() -> None:
    splitter = Splitter(b"\n", 100)
    for _ in range(50):
        assert splitter.feed(b"12345678" * 10) == []
    assert splitter.feed(b"42\nu 1\n") == [b"u 1"]  # the tail of an overlong line could be read as a number
    assert splitter.thrown == 50 * 80 + 2


@given(st.text(max_size=40), st.sampled_from(["iB/h", "f/f", "bBhHiIf/hh"]), st.integers(1, 60000))
def test_a_hello_comes_back(name: str, layout: str, watchdog_ms: int) -> None:
    frame = decode(hello(1, layout, 2000.0, watchdog_ms / 1000.0, name)[:-1])
    assert frame.type == HELLO
    read = read_hello(frame.body)
    assert (read.version, read.layout, read.rate_hz, read.name) == (1, layout, 2000.0, name)
    assert read.watchdog_s == pytest.approx(watchdog_ms / 1000.0)


@pytest.mark.parametrize("body", [b"", b"\1\0\0", b"\1\0" + bytes(6) + b"\xff/h\0x"])
def test_a_hello_that_is_none_is_refused(body: bytes) -> None:
    with pytest.raises(FrameError):
        read_hello(body)


def test_a_sample_says_what_was_acknowledged_and_when() -> None:
    block = Block("iB")
    for age, heard in ((0, (7, 0)), (65534, (7, 65534)), (65535, (None, None)), (None, (None, None))):
        s = BoardSample(200, (1 << 32) - 1, 5, 7, age, (-123456, 1))
        read = read_sample(block, decode(sample(block, s)[:-1]))
        assert read == s._replace(ack=heard[0], age_us=heard[1])


def test_a_block_of_another_length_is_refused() -> None:
    with pytest.raises(FrameError, match="4 bytes instead of 5"):
        Block("iB").unpack(b"1234")
    with pytest.raises(FrameError):
        read_sample(Block("iB"), Frame(SAMPLE, 0, b""))


@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=4))
def test_whole_numbers_are_rounded_and_floats_kept(values: list[float]) -> None:
    block = Block("i" * len(values))
    assert block.unpack(block.pack(values)) == tuple(round(value) for value in values)
    single = Block("f" * len(values))
    assert single.unpack(single.pack(values)) == pytest.approx(values, rel=1e-6)


def test_what_the_daemon_sends_first() -> None:
    from drivers.serial_frame import START, ask, start

    assert decode(ask()[:-1]) == Frame(ASK, 0, b"\1")
    assert decode(start()[:-1]) == Frame(START, 0, b"\1")
