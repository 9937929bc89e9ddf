"""What a rig on a CAN bus sends and receives, as the rig file and the DBC say it; its bus load."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from drivers.can_codec import CanCodec
from drivers.can_interfaces import interface_warnings
from drivers.can_load import Bus, Frame
from drivers.connection import CommandMessage, CommandSignal, Connection

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from cantools.database.can import Signal

    from drivers.can_config import CanOptions
    from drivers.can_dbc import Layout
    from drivers.connection import Demand


class Traffic(NamedTuple):
    """A bus with its frames, and the messages of other nodes whose rate nobody tells."""

    bus: Bus
    unknown: tuple[str, ...]


def can_connection(options: CanOptions, demand: Demand) -> Connection:
    """The bus with all its frames, what each command carries, and what is to be said about both."""
    codec = CanCodec(options)
    bus, unknown = can_traffic(options, demand)
    commanded = dict.fromkeys(_message(channel) for channel in demand.outputs)
    rates = {frame.name: frame.rate_hz for frame in bus.frames}
    return Connection(
        traffic=bus,
        commands=tuple(_command(codec.layout(name), demand.sources) for name in commanded),
        rates={channel: rates[_message(channel)] for channel in demand.inputs},
        together="",
        refusals=(*_never_sent(codec, demand), *bus.refusals(), *_without_fd(options, bus)),
        warnings=(*bus.warnings(), *_uncounted(unknown), *interface_warnings(options)),
    )


def can_traffic(options: CanOptions, demand: Demand) -> Traffic:
    """All frames on the bus.

    Commands go at the loop rate, and so do sensor messages where neither the rig file nor the DBC
    (`GenMsgCycleTime`) says otherwise. Other messages of the DBC count if their rate is known.
    """
    commanded, read = _messages(demand.outputs), _messages(demand.inputs)
    frames, unknown = _fixed_frames(options, demand.tick_hz), []
    for name, layout in CanCodec(options).layouts.items():
        if options.node in layout.message.senders:
            rate = demand.tick_hz if name in commanded else None
        else:
            rate = _rate(layout) or (demand.tick_hz if name in read else None)
            unknown += [] if rate else [name]
        if rate is not None:
            frames.append(_frame(layout, rate))
    return Traffic(Bus(options.channel, options.bitrate, options.data_bitrate, tuple(frames)), tuple(unknown))


def _messages(channels: Iterable[str]) -> set[str]:
    return {_message(channel) for channel in channels}


def _message(channel: str) -> str:
    return channel.partition(".")[0]


def _rate(layout: Layout) -> float | None:
    """What is said about a message's rate [1/s]."""
    cycle_ms = layout.message.cycle_time
    return layout.rate_hz or (1000.0 / cycle_ms if cycle_ms else None)


def _frame(layout: Layout, rate_hz: float) -> Frame:
    message = layout.message
    return Frame(layout.name, layout.length, rate_hz, message.is_extended_frame, message.is_fd)


def _fixed_frames(options: CanOptions, tick_hz: float) -> list[Frame]:
    """Frames that never change: each tick, and as heartbeat."""
    timed = [(frame, tick_hz) for frame in options.tick_frames]
    timed += [(frame, 1.0 / frame.period_s) for frame in options.heartbeat]
    return [
        Frame(f"{frame.id:#x}", len(frame.payload), rate, frame.extended, len(frame.payload) > 8)
        for frame, rate in timed
    ]


def _never_sent(codec: CanCodec, demand: Demand) -> list[str]:
    """Why commands would not go out."""
    values: dict[str, dict[str, float]] = {}
    for channel, number in zip(demand.outputs, demand.neutral, strict=True):
        message, _, signal = channel.partition(".")
        values.setdefault(message, {})[signal] = number
    return [why for name, numbers in values.items() if (why := codec.never_sent(name, numbers))]


def _uncounted(messages: Iterable[str]) -> Iterator[str]:
    for name in messages:
        yield f"message {name} is not counted in the bus load: give driver.messages.{name}.rate_hz"


def _without_fd(options: CanOptions, bus: Bus) -> Iterator[str]:
    for frame in bus.frames:
        if frame.fd and not options.fd:
            yield f"{frame.name} is an FD frame: set driver.fd: true, or make it classic in the DBC"


def _command(layout: Layout, sources: Mapping[str, str]) -> CommandMessage:
    return CommandMessage(
        layout.name,
        tuple(
            _signal(layout, signal, sources.get(f"{layout.name}.{signal.name}"))
            for signal in layout.message.signals
        ),
    )


def _signal(layout: Layout, signal: Signal, source: str | None) -> CommandSignal:
    where = ""
    if signal.multiplexer_ids:
        values = ", ".join(map(str, signal.multiplexer_ids))
        where = f" (only where {signal.multiplexer_signal} is {values})"
    if signal.name == layout.counter:
        return CommandSignal(signal.name, f"counts frames, 0 to {layout.period - 1}{where}")
    if signal.name == layout.checksum:
        return CommandSignal(signal.name, f"checksum {layout.compute_checksum.__name__}{where}")
    if source is not None:
        return CommandSignal(signal.name, source + where)
    start = "start value of the DBC" if signal.initial is not None else "no start value in the DBC"
    value = f"{layout.idle[signal.name]:g}: nothing sets it ({start}){where}"
    return CommandSignal(signal.name, value, is_set=False)
