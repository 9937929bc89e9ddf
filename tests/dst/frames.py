"""What is in the frames between this computer and the rig."""

from __future__ import annotations

import struct

ENCODER, SUPPLY, VALVE = 257, 258, 513
VOLTS = 0.0005


def crc8(data: bytes) -> int:
    """CRC-8 of SAE J1850, bit by bit."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D) & 0xFF if crc & 0x80 else crc << 1 & 0xFF
    return crc ^ 0xFF


CRC = bytes(crc8(bytes([byte])) ^ 0xFF for byte in range(256))
"""State after one byte, from 0xFF on, by that byte: the table is made of the definition."""


def checksum(data: bytes) -> int:
    """As `crc8`, by a table."""
    crc = 0xFF
    for byte in data:
        crc = CRC[crc ^ byte ^ 0xFF]
    return crc ^ 0xFF


def encoder_frame(angle: float, run: bool, counter: int) -> bytes:
    """Data of message 257: angle [1e-6 rad], run enable, counter, checksum."""
    head = struct.pack("<iBBB", round(angle * 1e6), run, counter & 0xFF, 0)
    return head + bytes([checksum(head)])


def supply_frame(counter: int) -> bytes:
    """Data of message 258: 7 MPa, 40 degC."""
    return struct.pack("<HbB", 7000, 40, counter & 0xF)


def valve_frame(volts: float, counter: int) -> bytes:
    """Data of message 513."""
    head = struct.pack("<hB", round(volts / VOLTS), counter & 0xF)
    return head + bytes([checksum(head)])


def sensed(data: bytes) -> tuple[bool, bool, int]:
    """Run enable of an encoder frame, whether it is sound, and its counter."""
    return bool(data[4] & 1), data[7] == checksum(data[:7]), data[5]


class Valve:
    """A command, understood; `sound` where it is not damaged."""

    def __init__(self, data: bytes) -> None:
        raw, counter = struct.unpack_from("<hB", data)
        self.volts = raw * VOLTS
        self.counter = counter & 0xF
        self.sound = len(data) == 4 and data[3] == checksum(data[:3])
