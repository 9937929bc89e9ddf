"""How full a serial line is, each way, and what is to be said about its board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.connection import REFUSE_LOAD, WARN_LOAD, CommandMessage, CommandSignal, Connection
from drivers.serial_codec import make_codec
from drivers.serial_counters import COUNTER_NAMES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.connection import Demand
    from drivers.serial_config import SerialOptions

BITS_A_BYTE = 10
"""Start bit, 8 data bits, stop bit."""


@dataclass(frozen=True, slots=True)
class Way:
    """One direction; they do not disturb each other.

    Attributes:
        name: For the report.
        length: The most bytes of a frame.
        rate_hz: Frames per second.
    """

    name: str
    length: int
    rate_hz: float


@dataclass(frozen=True, slots=True)
class Line:
    """A serial line with all that is sent on it.

    Attributes:
        name: The port.
        baud: [bit/s]; None: no bit rate limits it.
        ways: Both directions.
    """

    name: str
    baud: int | None
    ways: tuple[Way, Way]

    def share(self, way: Way) -> float:
        """Part of the time that the line is busy this way, at worst; above 1 it cannot be done."""
        return 0.0 if self.baud is None else way.length * BITS_A_BYTE * way.rate_hz / self.baud

    def lines(self) -> Iterator[str]:
        """For people."""
        rate = "no bit rate limits it" if self.baud is None else f"{self.baud:,} bit/s each way"
        yield f"line {self.name}, {rate}:"
        yield f"  {'frame':<24} {'bytes':>5} {'frames/s':>9} {'share':>7}"
        for way in self.ways:
            yield f"  {way.name:<24} {way.length:>5} {way.rate_hz:>9g} {self.share(way):>7.1%}"


def serial_connection(options: SerialOptions, demand: Demand) -> Connection:
    """The line with both its ways, what a command carries, and what is to be said about line and board."""
    line = serial_line(options, demand.tick_hz)
    return Connection(
        traffic=line,
        commands=(_command(options, demand),),
        rates=dict.fromkeys(demand.inputs, options.rate_hz),
        together="each sample of the board",
        refusals=tuple(_refusals(line)),
        warnings=tuple(_warnings(options, demand, line)),
    )


def serial_line(options: SerialOptions, tick_hz: float) -> Line:
    """A sample each turn of the board, a command each tick."""
    codec = make_codec(options, [0] * len(COUNTER_NAMES))
    ways = (
        Way("samples", codec.sample_bytes(), options.rate_hz),
        Way("commands", codec.command_bytes(), tick_hz),
    )
    return Line(options.port, None if options.usb else options.baud, ways)


def _command(options: SerialOptions, demand: Demand) -> CommandMessage:
    signals = (
        CommandSignal(field.name, demand.sources[field.name])
        if field.name in demand.sources
        else CommandSignal(field.name, "0: nothing sets it", is_set=False)
        for field in options.outputs
    )
    return CommandMessage("block", tuple(signals))


def _refusals(line: Line) -> Iterator[str]:
    for way in line.ways:
        if line.share(way) >= REFUSE_LOAD:
            busy = f"{way.name} would keep {line.name} busy for {line.share(way):.0%} of the time"
            yield f"{busy}: raise driver.baud, or lower driver.rate_hz or loop.rate_hz"


def _warnings(options: SerialOptions, demand: Demand, line: Line) -> Iterator[str]:
    for way in line.ways:
        if WARN_LOAD <= line.share(way) < REFUSE_LOAD:
            yield f"{way.name} keep {line.name} busy for {line.share(way):.0%} of the time: they will be late"
    if demand.rig_watchdog is not None and options.watchdog_s > demand.rig_watchdog:
        allowed = f"driver.watchdog_s allows the board {options.watchdog_s:g} s"
        yield f"{allowed}, guard.rig_watchdog is {demand.rig_watchdog:g} s"
    if options.rate_hz < demand.tick_hz:
        rates = f"{options.rate_hz:g} samples/s at {demand.tick_hz:g} ticks/s"
        yield f"{rates}: some ticks have no new sample"
