"""The reference firmware, built with gcc under sanitizers, against the daemon's own frames."""

from __future__ import annotations

import random
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

from drivers.serial_frame import (
    ASK,
    COMMAND,
    HELLO,
    NEUTRAL,
    SAMPLE,
    START,
    Block,
    CrcError,
    Frame,
    FrameError,
    Splitter,
    ask,
    command,
    decode,
    encode,
    read_hello,
    read_sample,
    start,
)

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "drivers" / "firmware"
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"]
INPUTS, OUTPUTS = Block("iB"), Block("h")


@pytest.fixture(scope="module")
def codec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("gcc") is None:
        pytest.fail("no gcc: `apt-get install gcc libc6-dev`")
    target = tmp_path_factory.mktemp("firmware") / "codec"
    sources = [FIRMWARE / "seod_frame.c", FIRMWARE / "seod_board.c", ROOT / "tests" / "firmware" / "codec.c"]
    line = [
        "gcc",
        "-std=c99",
        "-O1",
        *WARNINGS,
        *SANITIZERS,
        f"-I{FIRMWARE}",
        *map(str, sources),
        "-o",
        str(target),
    ]
    subprocess.run(line, check=True)
    return target


def run(codec: Path, mode: str, data: bytes) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([codec, mode], input=data, capture_output=True, check=True, timeout=60)


def random_frames(count: int) -> list[Frame]:
    chance = random.Random(1)
    sizes = [0, 1, 2, 244, 245, 246, *(chance.randrange(247) for _ in range(count))]
    return [Frame(chance.randrange(256), chance.randrange(256), body(chance, size)) for size in sizes]


def body(chance: random.Random, size: int) -> bytes:
    """Random, all zeros, without zeros."""
    return chance.choice([chance.randbytes(size), bytes(size), chance.randbytes(size).replace(b"\0", b"\1")])


@pytest.mark.slow
def test_both_encode_alike(codec: Path) -> None:
    frames = random_frames(2000)
    lines = "".join(f"{f.type} {f.sequence} {f.body.hex()}\n" for f in frames)
    answers = run(codec, "encode", lines.encode()).stdout.split()
    assert [bytes.fromhex(each.decode()) for each in answers] == [encode(*frame) for frame in frames]


def test_the_firmware_refuses_a_body_that_is_too_long(codec: Path) -> None:
    assert run(codec, "encode", b"1 2 " + b"00" * 247 + b"\n").stdout == b"-\n"


def hostile(chance: random.Random) -> bytes:
    """Frames that are whole, damaged, cut, doubled, stuffed with garbage."""
    frame = encode(
        chance.choice([SAMPLE, COMMAND, ASK, 0]), chance.randrange(256), body(chance, chance.randrange(60))
    )
    match chance.randrange(7):
        case 0:
            at = chance.randrange(len(frame))
            return frame[:at] + bytes([chance.randrange(256)]) + frame[at + 1 :]
        case 1:
            return frame[: chance.randrange(len(frame))]
        case 2:
            return chance.randbytes(chance.randrange(400))
        case 3:
            return chance.randbytes(chance.randrange(2, 600)).replace(b"\0", b"\7")
        case 4:
            return b"\0" * chance.randrange(4)
    return frame


def python_decodes(stream: bytes) -> list[str]:
    found = []
    *parts, _ = stream.split(b"\0")
    for part in parts:
        if not part:
            continue
        try:
            frame = decode(part)
            found.append(f"{frame.type} {frame.sequence} {frame.body.hex()}")
        except FrameError:
            found.append("broken")
    return found


@pytest.mark.parametrize("seed", range(5))
def test_both_decode_hostile_streams_alike(codec: Path, seed: int) -> None:
    chance = random.Random(seed)
    stream = b"".join(hostile(chance) for _ in range(3000))
    told = run(codec, "decode", stream).stdout.decode().splitlines()
    assert [line.strip() for line in told] == [line.strip() for line in python_decodes(stream)]
    assert 300 < sum(line == "broken" for line in told) < len(told) - 300


def answers(codec: Path, data: bytes) -> tuple[list[Frame], list[str]]:
    """What the board sent, and what it did with its output."""
    done = run(codec, "board", data)
    frames = [decode(each) for each in Splitter(b"\0", 300).feed(done.stdout) if each]
    return frames, done.stderr.decode().split()


def test_the_board_says_what_it_is_and_stays_neutral(codec: Path) -> None:
    frames, output = answers(codec, ask())
    assert [frame.type for frame in frames] == [HELLO]
    told = read_hello(frames[0].body)
    assert (told.version, told.layout, told.rate_hz, told.name) == (1, "iB/h", 2000.0, "test")
    assert told.watchdog_s == pytest.approx(0.05)
    assert output == ["neutral", "neutral"]


def test_the_board_takes_commands_only_after_start_and_each_once(codec: Path) -> None:
    one, two = command(OUTPUTS, 7, [1000]), command(OUTPUTS, 8, [-2000])
    _, output = answers(codec, one + start() + one + one + two + encode(COMMAND, 9, b"abc"))
    assert output == ["neutral", "1000", "-2000", "neutral"]  # the last by its watchdog


def test_the_board_samples_and_acknowledges(codec: Path) -> None:
    idle = b"\0" * 50  # half a millisecond
    frames, _ = answers(codec, start() + idle * 3 + command(OUTPUTS, 7, [1000]) + idle * 3)
    samples = [read_sample(INPUTS, frame) for frame in frames]
    assert [s.sequence for s in samples] == list(range(len(samples)))
    assert len(samples) >= 6
    assert {s.numbers for s in samples} == {(0x12345678, 1)}
    steps = {(b.time_us - a.time_us) % (1 << 32) for a, b in pairwise(samples[1:-1])}
    assert steps == {500}
    acks = [(s.ack, bool(s.status & NEUTRAL)) for s in samples[:-1]]
    assert acks[0] == (None, True)
    assert acks[-1] == (7, False)
    ages = [s.age_us for s in samples[:-1] if s.age_us is not None]
    assert ages == sorted(ages)
    assert ages[0] < 500
    assert samples[-1].status & NEUTRAL  # after the silence
    assert samples[-1].ack is None


def test_start_of_another_version_is_ignored(codec: Path) -> None:
    frames, output = answers(codec, encode(START, 0, b"\2") + bytes(200) + command(OUTPUTS, 1, [5]))
    assert frames == []
    assert output == ["neutral"]


@pytest.mark.parametrize("seed", range(8))
def test_the_board_survives_anything(codec: Path, seed: int) -> None:
    chance = random.Random(seed)
    parts = [hostile(chance) for _ in range(2000)]
    for at in range(0, len(parts), 50):
        parts[at] = chance.choice(
            [ask(), start(), b"\0" + start() + command(OUTPUTS, chance.randrange(256), [7])]
        )
    frames, output = answers(codec, b"".join(parts))
    assert output[-1] == "neutral"
    assert {frame.type for frame in frames} == {HELLO, SAMPLE}


def test_a_wrong_checksum_is_told_from_other_damage() -> None:
    damaged = bytearray(encode(SAMPLE, 1, b"\1\2\3")[:-1])
    damaged[3] ^= 0x10
    with pytest.raises(CrcError):
        decode(bytes(damaged))


def test_the_sketch_is_one_that_a_compiler_takes() -> None:
    sketch = FIRMWARE / "arduino" / "seod_board" / "seod_board.ino"
    board = ROOT / "tests" / "firmware" / "arduino"
    options = ["-std=c++17", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", f"-I{FIRMWARE}", f"-I{board}"]
    subprocess.run(["g++", *options, "-include", "Arduino.h", "-x", "c++", str(sketch)], check=True)
