"""Which messages of a DBC the simulated rig sends and hears, and how its sensors fill them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivers.can_codec import CanCodec, CodecError
from sim.faults import Frame

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim.rig import SimulatedRig


class SensorMessage:
    """One message that the rig sends.

    Args:
        codec: Of the DBC.
        name: Message in the DBC.
        signals: Signal -> the sensor that fills it.
        every: It goes with each so many-th turn of the sensors.
        lost: Asked once for each frame: whether it never comes.
    """

    def __init__(
        self,
        codec: CanCodec,
        name: str,
        signals: dict[str, Callable[[float], float]],
        every: int,
        lost: Callable[[], bool],
    ) -> None:
        self.name = name
        self.lost = lost
        self.every = every
        self.sent = 0
        self._codec = codec
        self._signals = signals
        self._dbc = codec.layout(name).message
        self._readings: dict[str, float] = {}

    def frame(self, t: float, frozen: bool) -> Frame | None:
        """The next frame, with readings of `t` [s] or, frozen, of the frame before; None: it is lost."""
        if not (frozen and self._readings):
            self._readings = {signal: sensor(t) for signal, sensor in self._signals.items()}
        data = self._codec.encode(self.name, self._readings, self.sent)
        self.sent += 1
        if self.lost():
            return None
        return Frame(self.name, self._dbc.frame_id, self._dbc.is_extended_frame, data, self._dbc.is_fd)


def sensor_messages(codec: CanCodec, rig: SimulatedRig, rate_hz: float) -> list[SensorMessage]:
    """The messages that carry the rig's sensors; those with a rate of their own go with fewer turns.

    Args:
        codec: Of the DBC.
        rig: What is simulated.
        rate_hz: Turns of the sensors per second.
    """
    found: dict[str, dict[str, Callable[[float], float]]] = {}
    for channel in rig.sensor_channels():
        message, signal = channel.split(".", 1)
        found.setdefault(message, {})[signal] = rig.sensor(channel)
    messages = []
    for name, signals in found.items():
        every = max(1, round(rate_hz / (codec.layout(name).rate_hz or rate_hz)))
        channels = [f"{name}.{signal}" for signal in signals]
        messages.append(SensorMessage(codec, name, signals, every, partial(_any_missing, rig, channels)))
    return messages


def _any_missing(rig: SimulatedRig, channels: list[str]) -> bool:
    missing = [rig.missing(channel) for channel in channels]  # each is asked for its own sample
    return any(missing)


def check_channels(codec: CanCodec, rig: SimulatedRig) -> None:
    """Make sure that the DBC carries the whole simulation.

    Raises:
        CodecError: A channel is not in the DBC, or goes the wrong way.
    """
    known = {(channel.name, channel.direction) for channel in codec.channels()}
    wanted = [(channel, "output") for channel in rig.inputs()]
    wanted += [(channel, "input") for channel in rig.sensor_channels()]
    for name, direction in wanted:
        if (name, direction) not in known:
            there = ", ".join(sorted(n for n, d in known if d == direction))
            raise CodecError(f"simulation: no {direction} channel {name!r} in the DBC; there are {there}")


def identifiers(codec: CanCodec, sender: str | None = None) -> set[tuple[int, bool]]:
    """(identifier, extended) of all messages, or of those that `sender` sends."""
    messages = [layout.message for layout in codec.layouts.values()]
    return {(m.frame_id, m.is_extended_frame) for m in messages if sender is None or sender in m.senders}
