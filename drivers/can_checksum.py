"""Checksums of one byte that DBC messages carry."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def _crc_table(polynomial: int) -> bytes:
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = ((crc << 1) ^ (polynomial if crc & 0x80 else 0)) & 0xFF
        table.append(crc)
    return bytes(table)


_J1850 = _crc_table(0x1D)


def xor8(data: bytes | bytearray) -> int:
    """Exclusive or of all bytes."""
    result = 0
    for byte in data:
        result ^= byte
    return result


def sum8(data: bytes | bytearray) -> int:
    """Sum of all bytes modulo 256."""
    return sum(data) & 0xFF


def crc8_j1850(data: bytes | bytearray) -> int:
    """CRC-8 of SAE J1850: polynomial 0x1D, start and final exclusive or 0xFF, nothing reflected."""
    crc = 0xFF
    for byte in data:
        crc = _J1850[crc ^ byte]
    return crc ^ 0xFF


CHECKSUMS: dict[str, Callable[[bytes | bytearray], int]] = {
    "xor8": xor8,
    "sum8": sum8,
    "crc8_j1850": crc8_j1850,
}
