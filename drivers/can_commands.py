"""Command frames: how many may wait for the bus, and which of them have left. Does no input or output.

A frame is in flight from `send` until the interface hands it back as sent. While too many are in flight
nothing more is queued, and only the newest command is remembered: after a stop no stale command can leave.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import can

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.can_codec import CanCodec
    from drivers.can_interfaces import Echo

GIVEN_UP = 32
"""Frames that are no longer waited for and may still come back, at most."""
KEPT = 256
"""Frames whose data are kept: a relay's two commands and neutral take 48, with a counter of 4 bits."""


class CommandFrame:
    """One message that is written.

    Attributes:
        message: The python-can message, used again for each frame.
        period: Number of values of its sequence counter, 0 for none.
        sent: Frames sent so far; the sequence counter goes with it.
        confirmed_at: When the last confirmed frame left [s]; nan before the first.
        waiting: Newest values that could not be sent; None for none.
        places: Of its signals among the values.

    Args:
        codec: Of the DBC.
        name: Message in the DBC.
        signals: Signals written, each with its place in the values.
        bit_rate_switch: Send FD frames with the faster data phase.
        echo: How the interface hands frames back; where it does not, nothing is ever in flight.
    """

    def __init__(
        self,
        codec: CanCodec,
        name: str,
        signals: Sequence[tuple[str, int]],
        bit_rate_switch: bool,
        echo: Echo,
    ) -> None:
        layout = codec.layout(name)
        dbc = layout.message
        self.message = can.Message(
            arbitration_id=dbc.frame_id,
            is_extended_id=dbc.is_extended_frame,
            is_fd=layout.is_fd,
            bitrate_switch=layout.is_fd and bit_rate_switch,
            is_rx=False,
        )
        self.period = layout.period
        self.sent = 0
        self.confirmed_at = math.nan
        self.waiting: Sequence[float] | None = None
        self._in_flight: deque[tuple[bytes, float]] = deque()
        self._given_up: deque[bytes] = deque(maxlen=GIVEN_UP)
        self._codec = codec
        self._name = name
        self._signals = signals
        self.places = tuple(at for _, at in signals)
        self._echo = echo
        self._kept: dict[tuple[float, ...], bytes] = {}

    def encode(self, values: Sequence[float], counter: int) -> bytes:
        """Data of the frame for the outputs' values.

        Raises:
            CodecError: A value is not finite.
        """
        chosen = [values[at] for at in self.places]
        key = (counter % (self.period or 1), *chosen)
        data = self._kept.get(key)
        if data is None:
            named = {name: value for (name, _), value in zip(self._signals, chosen, strict=True)}
            data = self._codec.encode(self._name, named, counter)
            self._keep(key, data)
        return data

    def _keep(self, key: tuple[float, ...], data: bytes) -> None:
        if len(self._kept) >= KEPT:  # commands that vary, such as a sine's
            self._kept.clear()
        self._kept[key] = data

    def load(self, values: Sequence[float]) -> can.Message:
        """The next frame."""
        data = self.encode(values, self.sent)
        self.message.data = data  # type: ignore[assignment]  # python-can only ever reads it; bytes are cheaper
        self.message.dlc = len(data)
        return self.message

    def mark_sent(self, t: float) -> None:
        """The loaded frame was taken by the interface at `t`."""
        self.sent += 1
        self.waiting = None
        if self._echo != "none":
            self._in_flight.append((bytes(self.message.data), t))

    def confirm(self, message: can.Message, t: float) -> bool:
        """A frame with this identifier was on the bus at `t`; False if somebody else sent it.

        Each of our frames comes back once: one more than those, or one with other data, is not ours, unless
        the interface vouches for it.
        """
        if message.is_rx and self._echo != "plain":
            return False
        return self._came_back(message.data, t) or self._echo in ("ours", "none")

    def _came_back(self, data: bytearray, t: float) -> bool:
        for position, (sent, _) in enumerate(self._in_flight):
            if sent == data:
                for _ in range(position):  # the bus keeps their order: earlier ones have left, too
                    self._given_up.append(self._in_flight.popleft()[0])
                self._in_flight.popleft()
                self.confirmed_at = t
                return True
        if data in self._given_up:
            self._given_up.remove(bytes(data))
            return True
        return False

    def tell(self, data: bytes | bytearray) -> str:
        """What a frame with this identifier says, for people."""
        return self._codec.tell(self._name, data)

    @property
    def in_flight(self) -> int:
        """Frames sent and not yet confirmed."""
        return len(self._in_flight)

    def overdue(self, t: float, timeout: float) -> bool:
        """Whether a frame has been in flight for longer than `timeout` s."""
        return bool(self._in_flight) and t - self._in_flight[0][1] > timeout

    def forget(self) -> None:
        """The interface has dropped what it held, or nothing of it shall follow."""
        self._given_up.extend(data for data, _ in self._in_flight)
        self._in_flight.clear()
        self.waiting = None
