"""The contract between the loop and a rig: what every driver does, in which order, in which units.

A driver owns one connection to one rig. The loop calls it from one thread, in this order::

    driver = Driver(options, clock)
    driver.open(inputs, outputs)      # takes the hardware, sends nothing that moves it
    driver.start()                    # opening frames; from here on samples arrive
    each tick:  driver.wait(deadline) # only when the loop is paced by a sensor
                driver.read(t)  ->  driver.write(t, values) or driver.neutral(t)
    driver.neutral(t); driver.close()

A call in the wrong state raises `DriverStateError`, which says what to call first. A connection that fails
while it runs never raises: it is counted, and `trouble` says why until it works again.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from pydantic import BaseModel

    from drivers.connection import Connection, Demand

Clock = "Callable[[], float]"
"""Returns CLOCK_MONOTONIC in s (or simulated time): handed in, so that drivers are tested without waiting."""


class DriverError(Exception):
    """A driver could not do what was asked; the message names the place and what would be right."""


class DriverStateError(DriverError):
    """A call came in the wrong state, such as `read` before `open`."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One quantity that a driver carries.

    Attributes:
        name: As written in the rig file, for CAN `Message.Signal`.
        direction: `input` (sensor to loop) or `output` (loop to actuator).
        unit: Unit of the numbers that the driver exchanges ("rad", "V", "" where unknown).
        minimum: Smallest number that can be carried, in `unit`.
        maximum: Largest number that can be carried, in `unit`.
    """

    name: str
    direction: Literal["input", "output"]
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf


class Sample(NamedTuple):
    """The newest reading of one input: its value in the channel's unit and the time it was taken in s.

    A channel that has never been heard of is `(nan, -inf)`. A new sample is one with a new `t`.
    """

    value: float
    t: float


NO_SAMPLE = Sample(math.nan, -math.inf)


class StampError(NamedTuple):
    """How far the times of samples may be off, as standard deviations [s]; nan where a driver cannot know.

    Attributes:
        common: Of the error that all samples of a window share, against the times of commands: it acts as a
            delay that nobody told.
        scatter: Of the error of each sample beside that, independent of its neighbours': it acts as noise.

    What lies before a sample is stamped (the sensor's own delay) or after a command has left is not in it.
    """

    common: float
    scatter: float


UNKNOWN_STAMPS = StampError(math.nan, math.nan)

UNTOLD_PERIODS = 2.0
"""Periods for which a command or a reading may be under way unseen: one of each end's device."""


class Driver(ABC):
    """Base of all drivers; they are listed in `drivers.TABLE` or under the entry point `seod.drivers`."""

    Options: ClassVar[type[BaseModel]]
    """Strict pydantic model of the rig file's `driver:` section (with `kind`)."""

    push: ClassVar[bool]
    """True if samples arrive by themselves, so that `wait` can pace the loop."""

    counter_names: ClassVar[tuple[str, ...]]
    """Names of the health counters, fixed for a class, in the order of `counters`."""

    acts_on: ClassVar[Literal["rig", "simulation", "recording"]] = "rig"
    """What commands reach: a rig, one that is simulated in this process, or nothing at all."""

    peer: ClassVar[str] = ""
    """Module whose `run` plays the simulated rig on the other end; "" where there is no other end."""

    bus_log: ClassVar[bool] = False
    """True if all that travels can be logged beside the daemon, as on a bus."""

    commands_sent: int = 0
    """Command frames sent so far, where frames carry a sequence counter."""

    def __init__(self, options: Any, clock: Callable[[], float]) -> None:
        self.options = options
        self.clock = clock
        self.counters: list[int] = [0] * len(self.counter_names)
        self.trouble = ""
        """Why the rig cannot be reached now ("" when it can); the guard faults on it."""
        self.foreign_commands = 0
        """Commands to our actuators that somebody else sent, as far as the connection shows them."""
        self.remarks: list[tuple[str, str]] = []
        """Warnings, each a code and a sentence, for the loop to take away and to tell."""

    @classmethod
    @abstractmethod
    def channels(cls, options: Any) -> tuple[Channel, ...]:
        """All channels that these options offer, without opening anything (`seod check` uses it)."""

    @classmethod
    def claims(cls, options: Any, outputs: Sequence[str]) -> tuple[str, ...]:  # noqa: ARG003 - for those that can
        """What of the connection no other daemon may command, in words; locked before it is opened."""
        return ()

    @classmethod
    def connection(cls, options: Any, demand: Demand) -> Connection | None:  # noqa: ARG003 - for those that can be full
        """The connection as the rig file would use it, for `seod check`; None where nothing can be full."""
        return None

    @abstractmethod
    def open(
        self, inputs: Sequence[str], outputs: Sequence[str], neutral: Sequence[float] | None = None
    ) -> None:
        """Take the connection for these channels; `read` and `write` keep their order.

        Args:
            inputs: Names of the channels to read.
            outputs: Names of the channels to write.
            neutral: Each output's neutral value in the channel's unit; 0 where left out (a unipolar
                amplifier or a 4-20 mA valve stands still at another number).

        Raises:
            DriverError: The connection cannot be had, or a channel is unknown.
        """

    @abstractmethod
    def start(self) -> None:
        """Send the opening frames; samples arrive from here on."""

    def wait(self, deadline: float) -> bool:  # noqa: ARG002 - for those that push
        """Block until a new sample of the first input arrived (True) or until `deadline` in s (False)."""
        raise DriverStateError(f"{type(self).__name__} does not push samples: use pace: timer")

    @abstractmethod
    def read(self, t: float) -> Sequence[Sample]:
        """The newest sample of each input at tick time `t`; never blocks."""

    @abstractmethod
    def write(self, t: float, values: Sequence[float]) -> float:
        """Send one value for each output, never blocking; returns when they left, in s, or nan."""

    def left(self) -> Sequence[float]:
        """When each output's last value really left, in s, as the hardware confirmed it; nan before that.

        Where it confirms late, from the confirmations before. Empty where it confirms nothing.
        """
        return ()

    def tell_foreign(self) -> str:
        """The newest command that somebody else sent, for people."""
        return ""

    def why_old(self, place: int) -> str:  # noqa: ARG002 - for those that know
        """What speaks against the newest frames of the input at this place in `read`; "" if nothing does."""
        return ""

    def stamp_error(self) -> StampError:
        """How far the newest `Sample.t` may be off, as measured while the rig runs; called now and then."""
        return UNKNOWN_STAMPS

    def untold_delay(self, tick: float) -> float:
        """How long commands and readings may well be under way beside what their times tell [s].

        From a command's leaving to the actuator, and from a sensor's reading to its stamp: devices with
        periods of their own, frames that wait. Estimators begin with it as the delay's standard deviation.

        Args:
            tick: Period of the loop [s].
        """
        return UNTOLD_PERIODS * tick

    @abstractmethod
    def neutral(self, t: float) -> float:
        """Send each output's neutral value, instead of anything still waiting; returns as `write`."""

    @abstractmethod
    def close(self) -> None:
        """Give the connection back; may be called twice, and in any state."""

    def neutral_recipe(self) -> Mapping[str, Any]:
        """How another process can write neutral if this one dies (see `drivers.neutral`).

        Returns:
            A JSON-able mapping with `kind`; `{"kind": "none", "why": ...}` where no other process can.
        """
        return {"kind": "none", "why": f"{type(self).__name__} is reachable only from the loop process"}

    def truth(self) -> Mapping[str, Mapping[str, float | None]]:
        """True K_L, omega_n [rad/s] and zeta per plant, for simulated rigs; empty for real ones.

        None where a plant has no such value.
        """
        return {}
