"""How long frames take on a CAN bus, at worst. Pure arithmetic on bits; knows no driver.

Classic frames, after R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, "Controller Area Network (CAN)
schedulability analysis: Refuted, revisited and revised", Real-Time Systems 35 (2007): g + 8 n + 13 bits and
at most floor((g + 8 n - 1) / 4) stuff bits. g = 34 (11-bit identifier) or 54 (29-bit) bits besides the n
data bytes are open to stuffing; the 13 are CRC delimiter, acknowledge, end of frame and interframe space.

FD frames, counted from the frame format of ISO 11898-1:2015: 17 bits (11-bit identifier) or 36 (29-bit) up
to the bit-rate switch. Then ESI, 4 bits of length, the data, and a CRC field with fixed stuff bits, one
before the 4-bit stuff count and one after each fourth bit: 4 + 17 + 6 bits for up to 16 data bytes,
4 + 21 + 7 for more. Then 13 bits at the nominal rate as in a classic frame. Stuff bits before the CRC field
as in a classic frame, as many of them as possible in the slow part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.connection import REFUSE_LOAD, WARN_LOAD

if TYPE_CHECKING:
    from collections.abc import Iterator

TAIL_BITS = 13
"""CRC delimiter, acknowledge slot and delimiter, 7 of end of frame, 3 of interframe space."""

HEAD_BITS = {False: 17, True: 36}
"""FD: start of frame to BRS, without and with extended identifier."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame that is sent again and again.

    Attributes:
        name: For the report.
        length: Data bytes.
        rate_hz: How often it is sent [1/s].
        extended: 29-bit identifier.
        fd: In the FD format.
    """

    name: str
    length: int
    rate_hz: float
    extended: bool = False
    fd: bool = False


@dataclass(frozen=True, slots=True)
class Bus:
    """A bus and all that is sent on it.

    Attributes:
        name: For the report.
        bitrate: Nominal rate [bit/s].
        data_bitrate: Rate of the data phase of FD frames [bit/s]; None: they do not switch.
        frames: All frames, in both directions.
    """

    name: str
    bitrate: int
    data_bitrate: int | None
    frames: tuple[Frame, ...]

    def share(self, frame: Frame) -> float:
        """Part of the time that one frame takes, at worst."""
        nominal, data = bits(frame)
        return frame.rate_hz * (nominal / self.bitrate + data / (self.data_bitrate or self.bitrate))

    def load(self) -> float:
        """Part of the time that the bus is busy, at worst; above 1 it cannot be done."""
        return sum(self.share(frame) for frame in self.frames)

    def lines(self) -> Iterator[str]:
        """For people."""
        data = f", data {self.data_bitrate:,} bit/s" if self.data_bitrate else ""
        yield f"bus {self.name}, {self.bitrate:,} bit/s{data}; bits with worst-case stuffing:"
        yield f"  {'frame':<24} {'bytes':>5} {'bits':>5} {'frames/s':>9} {'share':>7}"
        for frame in self.frames:
            counts = f"{frame.length:>5} {sum(bits(frame)):>5} {frame.rate_hz:>9g}"
            yield f"  {frame.name:<24} {counts} {self.share(frame):>7.1%}"
        limits = f"warned from {WARN_LOAD:.0%}, refused from {REFUSE_LOAD:.0%}"
        yield f"  {'sum':<24} {'':>5} {'':>5} {'':>9} {self.load():>7.1%}  ({limits})"

    def refusals(self) -> Iterator[str]:
        """Why it cannot carry its frames."""
        if self.load() >= REFUSE_LOAD:
            remedy = "lower loop.rate_hz, or use a faster bus, CAN FD or shorter frames"
            yield f"{self._busy('would be')}: {remedy}"

    def warnings(self) -> Iterator[str]:
        """Why frames may come late."""
        if WARN_LOAD <= self.load() < REFUSE_LOAD:
            yield f"{self._busy('is')}: frames will be late"

    def _busy(self, verb: str) -> str:
        return f"the bus {self.name} {verb} {self.load():.0%} busy with worst-case bit stuffing"


def bits(frame: Frame) -> tuple[int, int]:
    """Bits of a frame with worst-case stuffing: at the nominal rate, and at that of the data phase."""
    if frame.fd:
        return fd_bits(frame.length, frame.extended)
    return classic_bits(frame.length, frame.extended), 0


def classic_bits(length: int, extended: bool) -> int:
    """Longest form of a classic frame of 0 to 8 data bytes, interframe space included."""
    stuffable = (54 if extended else 34) + 8 * length
    return stuffable + TAIL_BITS + (stuffable - 1) // 4


def fd_bits(length: int, extended: bool) -> tuple[int, int]:
    """Longest form of an FD frame of 0 to 64 data bytes: bits at the nominal rate, bits of the data phase."""
    head = HEAD_BITS[extended]
    body = 1 + 4 + 8 * length
    crc_field = 4 + 17 + 6 if length <= 16 else 4 + 21 + 7
    head_stuff = (head - 1) // 4
    body_stuff = (head + body - 1) // 4 - head_stuff
    return head + head_stuff + TAIL_BITS, body + body_stuff + crc_field
