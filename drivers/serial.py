"""A board on a serial or USB-CDC line that pushes samples and takes commands (`docs/serial.md`).

A loop at 2 kHz cannot ask and wait for an answer over USB: the board samples by its own timer, and its time
stamps say when. All bytes that came are read at once, never waiting.
"""

from __future__ import annotations

import math
import os
import time
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from drivers.base import Channel, Driver, DriverError, DriverStateError, Sample, StampError
from drivers.serial_codec import make_codec
from drivers.serial_config import SerialOptions
from drivers.serial_counters import COUNTER_NAMES
from drivers.serial_frame import Hello
from drivers.serial_handshake import Handshake
from drivers.serial_inputs import SerialInputs
from drivers.serial_link import SerialLink
from drivers.serial_load import serial_connection
from drivers.serial_outputs import SerialOutputs

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivers.connection import Connection, Demand
    from drivers.serial_config import FieldOptions

TOLD_AGAIN_S = 30.0
"""What is odd about a board's samples is told again after this: who connects later has not heard it."""
NEUTRAL_SEQUENCES = (0x00, 0x40, 0x80, 0xC0)
"""Of the neutral commands that another process sends: the board ignores one at most, as a repeat."""


class SerialDriver(Driver):
    """Reads and writes the channels of one board."""

    Options = SerialOptions
    push = True
    counter_names: ClassVar[tuple[str, ...]] = COUNTER_NAMES
    peer = "sim.serial_rig"

    def __init__(self, options: SerialOptions, clock: Callable[[], float]) -> None:
        super().__init__(options, clock)
        self._link = SerialLink(options, self.counters)
        self._codec = make_codec(options, self.counters)
        self._handshake = Handshake(options, self.counters)
        self._state: Literal["closed", "open", "running"] = "closed"
        self._inputs, self._outputs = self._make((), (), ())
        self._tell_at = -math.inf

    @classmethod
    def channels(cls, options: SerialOptions) -> tuple[Channel, ...]:
        """The inputs and outputs of the two blocks."""
        return (
            *(_channel(field, "input") for field in options.inputs),
            *(_channel(field, "output") for field in options.outputs),
        )

    @classmethod
    def connection(cls, options: SerialOptions, demand: Demand) -> Connection:
        """The line with its load."""
        return serial_connection(options, demand)

    @classmethod
    def claims(cls, options: SerialOptions, outputs: Sequence[str]) -> tuple[str, ...]:  # noqa: ARG003 - the whole port
        """The port, by whatever name; pyserial's own lock on it ends with the loop."""
        return (f"serial port {os.path.realpath(options.port)}",)

    def open(
        self, inputs: Sequence[str], outputs: Sequence[str], neutral: Sequence[float] | None = None
    ) -> None:
        """Take the port and ask the board what it is; it stays silent and at neutral."""
        if self._state != "closed":
            raise DriverStateError("open: the port is open already; call close first")
        self._check(inputs, "input", self.options.inputs)
        self._check(outputs, "output", self.options.outputs)
        self._inputs, self._outputs = self._make(inputs, outputs, neutral or [0.0] * len(outputs))
        self._link.open()
        self._codec.clear()
        try:
            self._greet()
        except DriverError:
            self._link.close()
            raise
        self._state = "open"

    @staticmethod
    def _check(names: Sequence[str], direction: str, block: Sequence[FieldOptions]) -> None:
        known = [field.name for field in block]
        for name in names:
            if name not in known:
                place, there = f"driver.{direction}s", ", ".join(known)
                raise DriverError(f"no {direction} channel {name!r} in {place}; there are {there}")

    def _make(
        self, inputs: Sequence[str], outputs: Sequence[str], neutral: Sequence[float]
    ) -> tuple[SerialInputs, SerialOutputs]:
        o = self.options
        line_s = 0.0 if o.usb else self._codec.sample_bytes() * 10.0 / o.baud
        taken = SerialInputs(o, inputs, line_s, self.counters)
        places = [outputs.index(field.name) if field.name in outputs else None for field in o.outputs]
        sent = SerialOutputs(
            o, self._link, self._codec, places, neutral, taken.clock, self.counters, self.clock
        )
        return taken, sent

    def _greet(self) -> None:
        """Wait for the board's HELLO.

        Raises:
            DriverError: None came, or it is not the rig file's board.
        """
        self._handshake.begin(self.clock())
        while self._handshake.state == "asking":
            now = self.clock()
            self._raise_from(self._handshake.trouble(now, self._codec.complaint) or self._link.down)
            self._shake(now)
            if self._link.is_open and self._link.wait(0.01):
                self._drain()
        self._raise_from(self._handshake.refusal)

    @staticmethod
    def _raise_from(trouble: str) -> None:
        if trouble:
            raise DriverError(f"driver: {trouble}")

    def start(self) -> None:
        """Have the board sample; it is told again until samples come."""
        if self._state != "open":
            first = "open" if self._state == "closed" else "close and open"
            raise DriverStateError(f"start: the port is {self._state}; call {first} first")
        self._state = "running"
        self._handshake.begin(self.clock())
        self._handshake.state = "starting"
        self._shake(self.clock())

    def _shake(self, t: float) -> None:
        """Send what the handshake wants now."""
        due = self._handshake.due(t)
        if due:
            self._inputs.restart()
            self._link.send(self._codec.break_ + (self._codec.ask if due == "ask" else self._codec.start))

    def wait(self, deadline: float) -> bool:
        """Block until a new sample came, or until `deadline` [s]."""
        self._must_run("wait")
        before = self._inputs.taken
        while (left := deadline - self.clock()) > 0.0:
            if not self._link.is_open:
                time.sleep(left)
                return False
            if self._link.wait(left):
                self._drain()
                if self._inputs.taken != before:
                    return True
        return False

    def read(self, t: float) -> Sequence[Sample]:
        """Take all that came, at tick time `t` [s]."""
        self._must_run("read")
        if self._link.reopen(t):
            self._codec.clear()
            self._handshake.begin(t)
        self._drain()
        self._link.flush()
        self._shake(t)
        self._judge(t)
        return tuple(self._inputs.samples)

    def _drain(self) -> None:
        data = self._link.read()
        now = self.clock()
        self._handshake.heard(data)
        for message in self._codec.feed(data):
            if isinstance(message, Hello):
                self._handshake.greeted(message)
            elif self._handshake.sampled(now) and self._inputs.take(message, now):
                self._outputs.acknowledge(message)
        self._inputs.looked(now)

    def _judge(self, t: float) -> None:
        self._outputs.judge(t)
        silent = self._handshake.trouble(t, self._codec.complaint)
        self.trouble = self._link.down or silent or self._outputs.trouble
        self._tell(t)

    def _tell(self, t: float) -> None:
        """What is odd about the samples, now and then while it lasts, and that it is over."""
        notice = self._inputs.notice
        if notice and t >= self._tell_at:
            self._tell_at = t + TOLD_AGAIN_S
            self.remarks.append(("line", notice))
        elif not notice and self._tell_at > -math.inf:
            self._tell_at = -math.inf
            self.remarks.append(("line", "the board's samples are in order again"))

    def write(self, t: float, values: Sequence[float]) -> float:
        """One command; nan if it could not leave (too many unacknowledged, or trouble)."""
        self._must_run("write")
        return self._sent(self._outputs.write, t, values)

    def untold_delay(self, tick: float) -> float:
        """By the slower of loop and board."""
        return super().untold_delay(max(tick, 1.0 / self.options.rate_hz))

    def neutral(self, t: float) -> float:
        """As `write`, instead of anything that has not left yet."""
        self._must_run("neutral")
        return self._sent(self._outputs.neutral, t)

    def _sent(self, send: Callable[..., float], *arguments: Any) -> float:
        if self._link.is_open and self._handshake.state in ("asking", "refused"):
            return math.nan  # who knows what is on the other end
        left = send(*arguments)
        self._judge(self.clock())
        self.commands_sent = self._outputs.sent
        return left

    def left(self) -> Sequence[float]:
        """When the board set its outputs by the last command [s]: see `SerialOutputs.left`."""
        return self._outputs.left()

    def stamp_error(self) -> StampError:
        """From the scatter of the board's times against their arrival: see `drivers.stamp_jitter`."""
        return self._inputs.stamp_error()

    def close(self) -> None:
        """Have the board go to neutral and be silent, and give the port back."""
        if self._state != "closed" and self._link.is_open:
            self._link.drop_output()
            self._link.send(self._codec.break_ + self._codec.ask)
        self._link.close()
        self._state = "closed"

    def neutral_recipe(self) -> Mapping[str, Any]:
        """Neutral commands for another process that opens the same port."""
        if self._state == "closed":
            raise DriverStateError("neutral_recipe: the outputs are not known yet; call open first")
        frames = b"".join(self._outputs.neutral_bytes(sequence) for sequence in NEUTRAL_SEQUENCES)
        o = self.options
        return {"kind": "serial", "port": o.port, "baud": o.baud, "data": (self._codec.break_ + frames).hex()}

    def _must_run(self, call: str) -> None:
        if self._state != "running":
            first = "open and start" if self._state == "closed" else "start"
            raise DriverStateError(f"{call}: the port is {self._state}, not running; call {first} first")


def _channel(field: FieldOptions, direction: Literal["input", "output"]) -> Channel:
    return Channel(field.name, direction, field.unit, *field.limits)
