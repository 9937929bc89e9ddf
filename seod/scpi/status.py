"""Status as IEEE 488.2 and SCPI-1999 (volume 1, chapter 9) have it: registers, error queue, the SRQ bit."""

from __future__ import annotations

from collections import deque
from enum import IntFlag
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from seod.scpi.errors import ScpiError

QUEUE: Final = 16
"""Errors that are kept; the last one says that more came."""


class Event(IntFlag):
    """Standard event status register."""

    OPERATION_COMPLETE = 1
    QUERY_ERROR = 4
    DEVICE_ERROR = 8
    EXECUTION_ERROR = 16
    COMMAND_ERROR = 32
    POWER_ON = 128


class Byte(IntFlag):
    """Status byte."""

    ERRORS = 4
    QUESTIONABLE = 8
    MESSAGE = 16
    EVENTS = 32
    SERVICE = 64
    """The master summary, what an instrument on a GPIB asks for service with."""
    OPERATION = 128


class Operation(IntFlag):
    """Bits of STATus:OPERation."""

    MEASURING = 16
    """An axis is excited."""
    ARMED = 32
    HOLDING = 256
    """Bit 8: an axis goes back to where it began."""


class Questionable(IntFlag):
    """Bits of STATus:QUEStionable."""

    FAULT = 512
    """Bit 9: an axis is in fault."""
    QUALITY = 1024
    """Bit 10: an axis is excited and its estimate is not to be believed."""
    STALE = 2048
    """Bit 11: no rows come from the loop."""


class Register:
    """A condition, its changes to 1 since they were last read, and which of these are summed up."""

    def __init__(self) -> None:
        self.condition = 0
        self.event = 0
        self.enable = 0

    def update(self, condition: int) -> None:
        """Take the present condition."""
        self.event |= condition & ~self.condition
        self.condition = condition

    def read_event(self) -> int:
        """What has changed to 1; it is forgotten with that."""
        event, self.event = self.event, 0
        return event

    @property
    def summary(self) -> bool:
        """Whether anything that is enabled has changed."""
        return bool(self.event & self.enable)


class Status:
    """All registers of one client."""

    def __init__(self) -> None:
        self.events = int(Event.POWER_ON)
        self.events_enable = 0
        self.service_enable = 0
        self.operation, self.questionable = Register(), Register()
        self._errors: deque[tuple[int, str]] = deque()

    def error(self, error: ScpiError) -> None:
        """Keep an error, and set the bit of its class."""
        self.events |= bit_of(error.number)
        if len(self._errors) < QUEUE:
            self._errors.append((error.number, error.text))
        else:
            self._errors[-1] = (-350, "Queue overflow")

    @property
    def errors(self) -> int:
        """How many wait."""
        return len(self._errors)

    def next_error(self) -> str:
        """The oldest error, which is forgotten with that."""
        number, text = self._errors.popleft() if self._errors else (0, "No error")
        return f'{number},"{text.replace(chr(34), chr(39))}"'

    def read_events(self) -> int:
        """The standard event register, which is 0 after that."""
        events, self.events = self.events, 0
        return events

    def byte(self, message: bool = False) -> int:
        """The status byte.

        Args:
            message: An answer waits.
        """
        byte = Byte.ERRORS if self._errors else Byte(0)
        byte |= Byte.QUESTIONABLE if self.questionable.summary else Byte(0)
        byte |= Byte.MESSAGE if message else Byte(0)
        byte |= Byte.EVENTS if self.events & self.events_enable else Byte(0)
        byte |= Byte.OPERATION if self.operation.summary else Byte(0)
        return int(byte | (Byte.SERVICE if byte & self.service_enable else Byte(0)))

    def clear(self) -> None:
        """`*CLS`: events and errors; what is enabled stays."""
        self.events = self.operation.event = self.questionable.event = 0
        self._errors.clear()

    def preset(self) -> None:
        """`STATus:PRESet`."""
        self.operation.enable = self.questionable.enable = 0


def bit_of(number: int) -> int:
    """The bit of the standard event register for an error's class."""
    if -200 < number <= -100:
        return int(Event.COMMAND_ERROR)
    if -300 < number <= -200:
        return int(Event.EXECUTION_ERROR)
    return int(Event.QUERY_ERROR if number <= -400 else Event.DEVICE_ERROR)
