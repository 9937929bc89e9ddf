"""What a driver tells of its connection before it is opened: how full it would be, what commands carry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

WARN_LOAD: Final = 0.8
"""From here on a bus is called full: with worst-case stuffing, and one sender's jitter delays all others.

One axis with 8-byte frames both ways and a SYNC at 2 kHz takes 65 % of 1 Mbit/s and stays below.
"""

REFUSE_LOAD: Final = 1.0
"""From here on the frames do not fit, and queues grow until something is lost."""


class Demand(NamedTuple):
    """What a rig file asks of a connection.

    Attributes:
        tick_hz: Commands per second [1/s].
        inputs: Names of the channels that are read.
        outputs: Names of the channels that are written, each with its neutral value and what sets it.
        neutral: In the channels' units, in the order of `outputs`.
        sources: What sets each of them, in words.
        rig_watchdog: Time after which the rig goes to neutral by itself [s]; None: not told.
    """

    tick_hz: float
    inputs: Sequence[str]
    outputs: Sequence[str]
    neutral: Sequence[float]
    sources: Mapping[str, str]
    rig_watchdog: float | None


class Traffic(Protocol):
    """All that travels on a bus or line, with its load."""

    def lines(self) -> Iterator[str]:
        """For people."""


@dataclass(frozen=True, slots=True)
class CommandSignal:
    """One signal.

    Attributes:
        name: Within its message.
        value: What it carries, in words.
        is_set: Whether the rig file, a counter or a checksum sets it.
    """

    name: str
    value: str
    is_set: bool = True


@dataclass(frozen=True, slots=True)
class CommandMessage:
    """A message that the daemon sends with each command, and all its signals."""

    name: str
    signals: tuple[CommandSignal, ...]

    def lines(self) -> Iterator[str]:
        """For people."""
        yield f"command {self.name}:"
        for signal in self.signals:
            yield f"  {signal.name:<24} {signal.value}"

    @property
    def unset(self) -> list[str]:
        """Names of the signals that nothing sets."""
        return [signal.name for signal in self.signals if not signal.is_set]


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection as a rig file would use it.

    Attributes:
        traffic: All that travels on it.
        commands: Its command messages with all their signals.
        rates: Samples per second of each input channel [1/s].
        together: What brings all inputs at once, in words; "": each has a message of its own.
        refusals: Why it cannot work.
        warnings: What should be looked at.
    """

    traffic: Traffic
    commands: tuple[CommandMessage, ...]
    rates: Mapping[str, float]
    together: str
    refusals: tuple[str, ...]
    warnings: tuple[str, ...]
