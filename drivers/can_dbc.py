"""Messages of a DBC, prepared for coding: lengths, ranges, sequence counters and checksums."""

from __future__ import annotations

import math
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import cantools
from cantools.database import Error as CantoolsError
from cantools.database.can import Database

from drivers.base import DriverError
from drivers.can_checksum import CHECKSUMS, xor8

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cantools.database.can import Message, Signal

    from drivers.can_message import MessageOptions

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Lengths [bytes] that a frame can have; classic frames up to 8."""

COUNTER_NAME = "counter"
CHECKSUM_NAME = "checksum"
CHECKSUM_ATTRIBUTE = "ChecksumKind"
MAX_COUNTER_BITS = 16
MAX_COMMAND_COUNTER_BITS = 8
"""The supervisor must be able to send neutral with every value of the counter at once."""


class CodecError(DriverError):
    """A DBC, a message or values that cannot be used; the message says why."""


def load_database(path: str) -> Database:
    """The DBC at `path`, read once as long as the file stays as it is.

    Raises:
        CodecError: It cannot be read or is no DBC.
    """
    try:
        return _load(path, Path(path).stat().st_mtime_ns)
    except (OSError, UnicodeDecodeError, CantoolsError) as error:
        raise CodecError(f"{path}: cannot be read as a DBC: {error}") from error


@lru_cache(maxsize=8)
def _load(path: str, _mtime_ns: int) -> Database:
    database = cantools.database.load_file(path, database_format="dbc")
    if not isinstance(database, Database):
        raise CodecError(f"{path}: is no CAN database")
    return database


def unknown(what: str, name: str, known: list[str]) -> str:
    """A sentence about a name that does not exist and the ones like it."""
    close = get_close_matches(name, known, n=3, cutoff=0.4) or sorted(known)[:8]
    return f"no {what} {name!r} in the DBC; there is {', '.join(close) or 'none'}"


def check_node(path: str, node: str) -> None:
    """Make sure that the DBC knows our node, for else nothing would be an output.

    Raises:
        ValueError: It does not; names the close ones.
    """
    known = [entry.name for entry in load_database(path).nodes]
    if node not in known:
        raise ValueError(unknown("node", node, known))


def message_problems(path: str, node: str, options: Mapping[str, MessageOptions]) -> list[str]:
    """What is wrong with the `messages:` of a rig file, and with counters and checksums of the DBC itself."""
    database = load_database(path)
    known = {message.name: message for message in database.messages}
    problems = [unknown("message", name, list(known)) for name in options if name not in known]
    for name, message in known.items():
        try:
            Layout(message, node, options.get(name))
        except CodecError as error:
            problems.append(str(error))
    return problems


class Layout:
    """One message of the DBC, prepared: its signals, sequence counter and checksum.

    Attributes:
        name: Name in the DBC.
        message: The cantools message.
        is_fd: Goes in an FD frame.
        direction: `output` if our node sends it.
        length: Bytes on the wire: the DBC's, padded to a length that an FD frame can have.
        counter: Name of the counter signal or None; `period` is the number of its values.
        rate_hz: Nominal rate, None where unknown.

    Raises:
        CodecError: Signals that do not exist or cannot serve.
    """

    def __init__(self, message: Message, node: str, options: MessageOptions | None) -> None:
        self.message = message
        self.name = message.name
        self.is_fd = message.is_fd or message.length > 8  # not every DBC says so of its long messages
        self.direction: Literal["input", "output"] = "output" if node in message.senders else "input"
        self.length = next(length for length in FD_LENGTHS if length >= message.length)
        self.lengths = (message.length, self.length)
        self.signals = {signal.name: signal for signal in message.signals}
        self.rate_hz = options.rate_hz if options else None
        self.counter = self._role("counter", COUNTER_NAME, options)
        self.period = self._counter_period()
        self.checksum, self.compute_checksum = self._checksum(options)
        self.checksum_byte = self._checksum_byte()
        self.idle = {name: _initial(signal) for name, signal in self.signals.items()}
        self.ranges = {name: signal_range(signal) for name, signal in self.signals.items()}

    def _role(self, role: str, usual: str, options: MessageOptions | None) -> str | None:
        if options is None or role not in options.model_fields_set:
            return next((name for name in self.signals if name.lower() == usual), None)
        name: str | None = getattr(options, role)
        if name is not None and name not in self.signals:
            raise CodecError(f"{self.name}.{role}: {unknown('signal', name, list(self.signals))}")
        return name

    def _counter_period(self) -> int:
        if self.counter is None:
            return 0
        signal = self.signals[self.counter]
        plain = signal.scale == 1 and signal.offset == 0 and not signal.is_signed and not signal.is_float
        longest = MAX_COMMAND_COUNTER_BITS if self.direction == "output" else MAX_COUNTER_BITS
        if not plain or not 2 <= signal.length <= longest:
            raise CodecError(
                f"{self.name}.{self.counter} cannot count frames: expected an unsigned signal of 2 to "
                f"{longest} bits with scale 1 and offset 0"
            )
        return 1 << signal.length

    def _checksum(
        self, options: MessageOptions | None
    ) -> tuple[str | None, Callable[[bytes | bytearray], int]]:
        explicit = options is not None and options.checksum is not None
        kind: Any = options.checksum_kind if options else None
        if kind is None and self.message.dbc is not None:
            attribute = self.message.dbc.attributes.get(CHECKSUM_ATTRIBUTE)
            kind = attribute.value if attribute else None
        name = self._role("checksum", CHECKSUM_NAME, options)
        if name is None or (not kind and not explicit):
            return None, xor8
        if kind not in CHECKSUMS:
            raise CodecError(
                f"{self.name}: checksum_kind must be one of {', '.join(CHECKSUMS)}, got {kind!r}"
            )
        return name, CHECKSUMS[kind]

    def _checksum_byte(self) -> int:
        if self.checksum is None:
            return -1
        signal = self.signals[self.checksum]
        first_bit = signal.start % 8 == (0 if signal.byte_order == "little_endian" else 7)
        if signal.length != 8 or not first_bit:
            raise CodecError(f"{self.name}.{self.checksum} cannot be a checksum: expected one whole byte")
        return signal.start // 8

    def checksum_of(self, data: bytes | bytearray) -> int:
        """The checksum of a frame's data: over all bytes but its own."""
        at = self.checksum_byte
        return self.compute_checksum(data[:at] + data[at + 1 : self.message.length])

    def carries(self) -> list[Signal]:
        """Signals that are quantities: all but counter and checksum."""
        return [signal for name, signal in self.signals.items() if name not in (self.counter, self.checksum)]


def _initial(signal: Signal) -> float:
    """Start value in the DBC, else what is nearest to 0."""
    if signal.initial is not None:
        return float(cast("float", signal.initial))
    lowest, highest = signal_range(signal)
    return min(max(0.0, lowest), highest)


def signal_range(signal: Signal) -> tuple[float, float]:
    """Smallest and largest physical value: what the bits hold, within the range that the DBC allows."""
    if signal.is_float:
        lowest, highest = -math.inf, math.inf
    else:
        least = -(1 << (signal.length - 1)) if signal.is_signed else 0
        raw = (least, least + (1 << signal.length) - 1)
        lowest, highest = sorted(float(bound * signal.scale + signal.offset) for bound in raw)
    if signal.minimum is not None:
        lowest = max(lowest, float(signal.minimum))
    if signal.maximum is not None:
        highest = min(highest, float(signal.maximum))
    return lowest, highest
