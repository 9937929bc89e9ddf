"""What happens to files: each blow takes the bytes of one and a generator, and returns what is left."""

from __future__ import annotations

import gzip
import struct
import zlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random

_LONG_LINE = 300_000
"""Characters of a line that never ends."""


def flips(data: bytes, random: Random) -> bytes:
    """One bit, a few, or many."""
    damaged = bytearray(data)
    for _ in range(random.choice((1, 1, 3, 20, 200))):
        damaged[random.randrange(len(damaged))] ^= 1 << random.randrange(8)
    return bytes(damaged)


def cut_off(data: bytes, random: Random) -> bytes:
    """The end is missing."""
    return data[: random.randrange(len(data))]


def removed(data: bytes, random: Random) -> bytes:
    """A block is missing."""
    start, end = _block(data, random)
    return data[:start] + data[end:]


def doubled(data: bytes, random: Random) -> bytes:
    """A block stands there twice, or very often."""
    start, end = _block(data, random)
    return data[:end] + data[start:end] * random.choice((1, 1, 1, 30)) + data[end:]


def zeroed(data: bytes, random: Random) -> bytes:
    """A block is zeros, as after a power failure."""
    start, end = _block(data, random)
    return data[:start] + bytes(end - start) + data[end:]


def overwritten(data: bytes, random: Random) -> bytes:
    """A block is noise."""
    start, end = _block(data, random)
    return data[:start] + random.randbytes(end - start) + data[end:]


def swapped(data: bytes, random: Random) -> bytes:
    """Two halves of a part stand in the wrong order."""
    start, end = _block(data, random)
    middle = (start + end) // 2
    return data[:start] + data[middle:end] + data[start:middle] + data[end:]


def length_blown_up(data: bytes, random: Random) -> bytes:
    """A number that may be a length or a place says something else."""
    size = random.choice((2, 4, 4, 8, 8))
    places = _lengths(data, size, random) or [random.randrange(max(1, len(data) - size))]
    told = random.choice(
        (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**64 - 1, len(data), 1000 * len(data), 3 * 10**9)
    )
    damaged = bytearray(data)
    order = random.choice(("little", "little", "little", "big"))
    at = random.choice(places)
    damaged[at : at + size] = (told % 256**size).to_bytes(size, order)
    return bytes(damaged)


def digits_blown_up(data: bytes, random: Random) -> bytes:
    """A number of a text becomes very long, negative, or a word."""
    places = [at for at, byte in enumerate(data) if 48 <= byte <= 57] or [random.randrange(len(data))]
    at = random.choice(places)
    told = random.choice((b"9" * 30, b"9" * 5000, b"-", b"e999", b"nan", b"\0", b"\xff", b"1" * _LONG_LINE))
    return data[:at] + told + data[at + 1 :]


def unlined(data: bytes, random: Random) -> bytes:
    """Line ends, separators or quotes are lost or come where there were none."""
    byte = random.choice((b"\n", b",", b'"', b" ", b";"))
    if random.random() < 0.3:
        return data.replace(byte, b"")
    at = random.randrange(len(data))
    return data[:at] + byte * random.choice((1, 7, _LONG_LINE)) + data[at:]


BLOWS = (
    flips,
    cut_off,
    removed,
    doubled,
    zeroed,
    overwritten,
    swapped,
    length_blown_up,
    length_blown_up,
    digits_blown_up,
    unlined,
)


def damaged(data: bytes, random: Random) -> bytes:
    """One or two blows; inside of what is gzipped, if it is, as often as outside."""
    if data.startswith(b"\x1f\x8b") and random.random() < 0.5:
        return gzip.compress(damaged(gzip.decompress(data), random), 1, mtime=0)
    for _ in range(random.choice((1, 1, 2))):
        data = random.choice(BLOWS)(data or b"\0", random)
    return data


def bomb(line: bytes, size: int) -> bytes:
    """A gzip file of a few kilobytes that unpacks to `size` bytes of the same line."""
    packer = zlib.compressobj(9, wbits=31)
    piece = line * (1 + (1 << 20) // len(line))
    parts = [packer.compress(piece) for _ in range(size // len(piece))]
    return b"".join([*parts, packer.flush()])


def _block(data: bytes, random: Random) -> tuple[int, int]:
    start = random.randrange(len(data))
    length = random.choice((1, 4, 8, 64, 512, 4096, len(data)))
    return start, min(len(data), start + 1 + random.randrange(length))


def _lengths(data: bytes, size: int, random: Random) -> list[int]:
    """Some places of numbers that could be lengths: not 0, not longer than the file."""
    code = {2: "<H", 4: "<I", 8: "<Q"}[size]
    head = min(len(data) - size, 4096)
    tried = [random.randrange(max(1, len(data) - size)) for _ in range(200)] + list(range(0, max(0, head), 2))
    random.shuffle(tried)
    fits = (at for at in tried if at + size <= len(data))
    found = [at for at in fits if 0 < struct.unpack_from(code, data, at)[0] <= len(data)]
    return found[:50]
