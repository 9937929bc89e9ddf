"""Frames of a DBC to physical values and back, with sequence counters and checksums.

Pure: no sockets, no clocks. The simulated rig uses the same codec from the other side.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from cantools.database import Error as CantoolsError

from drivers.base import Channel
from drivers.can_dbc import CodecError, Layout, load_database, message_problems, unknown

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.can_config import CanOptions

__all__ = ["CanCodec", "CodecError", "Decoded", "UnknownFrameError", "WrongLengthError"]


class UnknownFrameError(CodecError):
    """No message of the DBC has this identifier."""


class WrongLengthError(CodecError):
    """A frame is not as long as its message.

    Attributes:
        message: Name in the DBC.
    """

    def __init__(self, message: str, why: str) -> None:
        super().__init__(why)
        self.message = message


class Decoded(NamedTuple):
    """One frame, understood.

    Attributes:
        message: Name in the DBC.
        values: Signal -> physical value in its DBC unit.
        counter: Raw sequence counter; None where the message has none.
        checksum_ok: False if it has a checksum and that is wrong.
    """

    message: str
    values: Mapping[str, float]
    counter: int | None
    checksum_ok: bool


class CanCodec:
    """Encodes and decodes the messages of one DBC.

    Raises:
        CodecError: The DBC cannot be used with these options.
    """

    def __init__(self, options: CanOptions) -> None:
        database = load_database(options.dbc)
        problems = message_problems(options.dbc, options.node, options.messages)
        if problems:
            raise CodecError("; ".join(problems))
        self.layouts = {
            message.name: Layout(message, options.node, options.messages.get(message.name))
            for message in database.messages
        }
        self._by_id = {
            (layout.message.frame_id, layout.message.is_extended_frame): layout
            for layout in self.layouts.values()
        }

    def layout(self, message: str) -> Layout:
        """The prepared message of this name.

        Raises:
            CodecError: No such message; names the close ones.
        """
        if message not in self.layouts:
            raise CodecError(unknown("message", message, list(self.layouts)))
        return self.layouts[message]

    def counter_period(self, message: str) -> int:
        """Number of values of a message's sequence counter; 0 where it has none."""
        return self.layout(message).period

    def encode(self, message: str, values: Mapping[str, float], counter: int) -> bytes:
        """The data of one frame.

        Values beyond what a signal can carry are clipped; signals left out have their start value in the DBC.

        Args:
            message: Name in the DBC.
            values: Signal -> physical value in its DBC unit.
            counter: Frames sent before; taken modulo the counter's period.

        Raises:
            CodecError: Unknown message or signal, or a value that is not finite.
        """
        layout = self.layout(message)
        content = dict(layout.idle)
        for name, value in values.items():
            if name not in content or not math.isfinite(value):
                raise CodecError(self._unencodable(layout, name, value))
            lowest, highest = layout.ranges[name]
            content[name] = lowest if value < lowest else highest if value > highest else value
        if layout.counter is not None:
            content[layout.counter] = counter % layout.period
        try:
            data = bytearray(layout.message.encode(content, strict=False))
        except CantoolsError as error:  # a multiplexer value that the DBC does not know
            raise CodecError(f"{message} cannot be sent: {error}; outputs.<name>.fixed sets it") from error
        data.extend(bytes(layout.length - len(data)))
        if layout.checksum is not None:
            data[layout.checksum_byte] = layout.checksum_of(data)
        return bytes(data)

    def _unencodable(self, layout: Layout, name: str, value: float) -> str:
        if name in layout.signals:
            return f"{layout.name}.{name}: cannot send {value}"
        return f"{layout.name}: {unknown('signal', name, list(layout.signals))}"

    def decode(self, frame_id: int, extended: bool, data: bytes | bytearray) -> Decoded:
        """The content of one frame.

        Raises:
            UnknownFrameError: No message has this identifier.
            WrongLengthError: The data are not as long as the message.
        """
        layout = self._by_id.get((frame_id, extended))
        if layout is None:
            raise UnknownFrameError(f"no message of the DBC has the id {frame_id:#x}")
        if len(data) not in layout.lengths:
            expected = f"{layout.name} has {layout.message.length} bytes, the frame {len(data)}"
            raise WrongLengthError(layout.name, expected)
        try:
            content: Any = layout.message.decode_simple(
                bytes(data[: layout.message.length]), decode_choices=False
            )
        except CantoolsError as error:  # a multiplexer value that the DBC does not know
            raise UnknownFrameError(f"{layout.name} cannot be decoded: {error}") from error
        values: Mapping[str, float] = content
        counter = int(values[layout.counter]) if layout.counter is not None else None
        ok = layout.checksum is None or data[layout.checksum_byte] == layout.checksum_of(data)
        return Decoded(layout.name, values, counter, ok)

    def never_sent(self, message: str, values: Mapping[str, float]) -> str:
        """Why a frame with these values would not carry all of them (a multiplexer selects others), or ""."""
        layout = self.layout(message)
        try:
            data = self.encode(message, values, 0)
            carried = self.decode(layout.message.frame_id, layout.message.is_extended_frame, data).values
        except CodecError as error:
            return str(error)
        for name in values:
            if name not in carried:
                signal = layout.signals[name]
                page, known = signal.multiplexer_signal, signal.multiplexer_ids or []
                wanted = " or ".join(map(str, known))
                set_it = f"outputs.<name>.fixed: {{{message}.{page}: {known[0]}}}" if known else "the DBC"
                return f"{message}.{name} is never sent: {page} must be {wanted} for it ({set_it})"
        return ""

    def tell(self, message: str, data: bytes | bytearray) -> str:
        """A frame of this message in words, such as `Valve (id 0x201): voltage 5 V`."""
        layout = self.layout(message)
        named = f"{message} (id {layout.message.frame_id:#x})"
        try:
            values = self.decode(layout.message.frame_id, layout.message.is_extended_frame, data).values
        except CodecError:
            return f"{named}: {len(data)} bytes {bytes(data).hex(' ')}"
        carried = [
            f"{s.name} {values[s.name]:g} {s.unit or ''}".rstrip()
            for s in layout.carries()
            if s.name in values
        ]
        return f"{named}: {', '.join(carried)}"

    def channels(self) -> tuple[Channel, ...]:
        """Each signal of the DBC that carries a quantity, as `Message.Signal`."""
        found = []
        for layout in self.layouts.values():
            for signal in layout.carries():
                lowest, highest = layout.ranges[signal.name]
                name = f"{layout.name}.{signal.name}"
                found.append(Channel(name, layout.direction, signal.unit or "", lowest, highest))
        return tuple(found)
