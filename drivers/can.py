"""A rig on a CAN bus, by python-can on any interface and a DBC.

Every sample has the time at which the kernel took its frame, and every command is confirmed by the kernel's
echo of it. Interfaces without echo have no bound on commands in flight and no times of leaving; interfaces
whose stamps are not of CLOCK_REALTIME have the time of reading instead. What is not our echo and yet one of
our commands was sent by somebody else, and is told.
"""

from __future__ import annotations

import math
import os
import time
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from drivers import can_counters as count
from drivers.base import NO_SAMPLE, Channel, Driver, DriverError, DriverStateError, Sample
from drivers.can_codec import CanCodec, UnknownFrameError, WrongLengthError
from drivers.can_commands import CommandFrame
from drivers.can_config import CanOptions
from drivers.can_fixed import FixedFrames
from drivers.can_inputs import InputFrame
from drivers.can_interfaces import REALTIME_STAMPS, echo_of
from drivers.can_link import CanLink, filters_for
from drivers.can_outputs import CanOutputs
from drivers.can_traffic import can_connection
from drivers.clock import StampClock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    import can

    from drivers.connection import Connection, Demand

FRAMES_A_READ = 512
"""Frames taken in one read at most, so that a flood cannot hold a tick."""
CLOSE_TRIES, CLOSE_WAIT_S = 25, 0.002
"""How often, and how long each, `close` waits for room for a neutral command."""

Places = dict[str, list[tuple[str, int]]]
"""Message -> its signals that are wanted, each with its place among the inputs or outputs."""


class CanDriver(Driver):
    """Reads and writes signals of a DBC."""

    Options = CanOptions
    push = True
    counter_names: ClassVar[tuple[str, ...]] = count.COUNTER_NAMES
    peer = "sim.can_rig"
    bus_log = True

    def __init__(self, options: CanOptions, clock: Callable[[], float]) -> None:
        super().__init__(options, clock)
        self._codec = CanCodec(options)
        self._link = CanLink(options, self.counters)
        self._fixed = FixedFrames(options, self._link)
        self._stamps = StampClock(clock)
        self._outputs = self._make_outputs({}, ())
        self._state: Literal["closed", "open", "running"] = "closed"
        self._samples: list[Sample] = []
        self._inputs: dict[str, InputFrame] = {}
        self._first = ""

    @classmethod
    def channels(cls, options: CanOptions) -> tuple[Channel, ...]:
        """Every signal of the DBC that carries a quantity; what our node sends is an output."""
        return CanCodec(options).channels()

    @classmethod
    def connection(cls, options: CanOptions, demand: Demand) -> Connection:
        """The bus with its load."""
        return can_connection(options, demand)

    @classmethod
    def claims(cls, options: CanOptions, outputs: Sequence[str]) -> tuple[str, ...]:
        """Each message that we send to an actuator, on this interface."""
        codec = CanCodec(options)
        sent = {name.partition(".")[0]: None for name in outputs}
        where = os.path.realpath(options.channel) if options.channel.startswith("/") else options.channel
        messages = [codec.layout(name).message for name in sent]
        ids = [f"{m.frame_id:#x}" + " extended" * m.is_extended_frame for m in messages]
        return tuple(f"{options.interface} {where} id {each}" for each in ids)

    def open(
        self, inputs: Sequence[str], outputs: Sequence[str], neutral: Sequence[float] | None = None
    ) -> None:
        """Take the bus, with filters for the messages of these channels only."""
        if self._state != "closed":
            raise DriverStateError("open: the bus is open already; call close first")
        wanted, commanded = self._places(inputs, "input"), self._places(outputs, "output")
        self._samples = [NO_SAMPLE] * len(inputs)
        self._first = inputs[0].partition(".")[0] if inputs else ""
        self._inputs = {name: self._make_input(name, signals) for name, signals in wanted.items()}
        neutral = neutral or [0.0] * len(outputs)
        for name, signals in commanded.items():
            never = self._codec.never_sent(name, {signal: neutral[at] for signal, at in signals})
            if never:
                raise DriverError(never)
        self._outputs = self._make_outputs(commanded, neutral)
        self._stamps = StampClock(self.clock, trusted=self.options.interface in REALTIME_STAMPS)
        used = [self._codec.layout(name).message for name in (*wanted, *commanded)]
        queue = len(commanded) * (self.options.max_in_flight + 1) + len(self._fixed)
        self._link.open(filters_for([(each.frame_id, each.is_extended_frame) for each in used]), queue)
        self._state = "open"

    def _places(self, names: Iterable[str], direction: Literal["input", "output"]) -> Places:
        known = [channel.name for channel in self._codec.channels() if channel.direction == direction]
        places: Places = {}
        for place, name in enumerate(names):
            if name not in known:
                raise DriverError(f"no {direction} channel {name!r} in the DBC; there are {', '.join(known)}")
            message, _, signal = name.partition(".")
            if self._codec.layout(message).is_fd and not self.options.fd:
                raise DriverError(f"{message} is an FD message: set driver.fd: true")
            places.setdefault(message, []).append((signal, place))
        return places

    def _make_input(self, name: str, signals: Sequence[tuple[str, int]]) -> InputFrame:
        layout = self._codec.layout(name)
        return InputFrame(layout, list(signals), self._samples, self.counters)

    def _make_outputs(self, places: Places, neutral: Sequence[float]) -> CanOutputs:
        o = self.options
        echo = echo_of(o)
        commands = [
            CommandFrame(self._codec, name, signals, o.data_bitrate is not None, echo)
            for name, signals in places.items()
        ]
        return CanOutputs(o, self._link, commands, neutral, self._fixed, self.counters, self.clock)

    def start(self) -> None:
        """Send the opening frames; if the bus does not take them now, they go when it does."""
        if self._state != "open":
            first = "open" if self._state == "closed" else "close and open"
            raise DriverStateError(f"start: the bus is {self._state}; call {first} first")
        self._state = "running"
        self._stamps.drained()
        self._outputs.begin(self.clock())
        self._fixed.send_start()
        self._judge(self.clock())

    def wait(self, deadline: float) -> bool:
        """Block until a new sample of the first input's message came, or until `deadline` [s]."""
        if self._state != "running":
            raise self._not_running("wait")
        while (left := deadline - self.clock()) > 0.0:
            if not self._link.is_open:
                time.sleep(left)
                return False
            message = self._link.receive(left)
            if message is not None and self._take(message) == self._first:
                return True
            self._outputs.send_waiting()
        return False

    def read(self, t: float) -> Sequence[Sample]:
        """Send what is due at tick time `t` [s] and take all frames that came."""
        if self._state != "running":
            raise self._not_running("read")
        if not self._outputs.blocked:
            self._fixed.send_due(t)
        self._drain()
        self._judge(t)
        return tuple(self._samples)

    def _drain(self) -> None:
        receive, take = self._link.receive, self._take
        for _ in range(FRAMES_A_READ):
            message = receive()
            if message is None:
                self._stamps.drained()
                return
            take(message)

    def _take(self, message: can.Message) -> str:
        """Use one frame; the name of its message if that brought a new sample, else ""."""
        if message.is_error_frame:
            self._link.take_error_frame(message)
            return ""
        t = self._stamps.to_loop(message.timestamp)
        if message.is_remote_frame:
            self.counters[count.UNKNOWN_FRAMES] += 1
            return ""
        if self._outputs.confirm(message, t):
            return ""
        return self._use(message, t)

    def _use(self, message: can.Message, t: float) -> str:
        try:
            decoded = self._codec.decode(message.arbitration_id, message.is_extended_id, message.data)
        except WrongLengthError as error:
            self.counters[count.WRONG_LENGTH] += 1
            if error.message in self._inputs:
                self._inputs[error.message].refuse(count.WRONG_LENGTH)
            return ""
        except UnknownFrameError:
            self.counters[count.UNKNOWN_FRAMES] += 1
            return ""
        wanted = self._inputs.get(decoded.message)
        if wanted is None:  # it came before the filters were set
            self.counters[count.UNKNOWN_FRAMES] += 1
            return ""
        return decoded.message if wanted.accept(decoded, t) else ""

    def _judge(self, t: float) -> None:
        self._outputs.judge(t)
        self.trouble = self._outputs.trouble
        self.foreign_commands = self._outputs.foreign
        self.counters[count.CLOCK_STEPS] = self._stamps.steps
        for frame in self._inputs.values():
            if frame.untold:
                self.remarks += frame.remarks(t)

    def write(self, t: float, values: Sequence[float]) -> float:
        """One frame for each output message; nan if none left (too many in flight, or trouble)."""
        if self._state != "running":
            raise self._not_running("write")
        return self._sent(self._outputs.write(t, values))

    def untold_delay(self, tick: float) -> float:
        """By the slower of the loop and the first sensor's frames, where their rate is known."""
        first = self._codec.layout(self._first).rate_hz if self._first else None
        return super().untold_delay(max(tick, 1.0 / (first or math.inf)))

    def neutral(self, t: float) -> float:
        """As `write`, with one place more in the queue, and instead of anything that waits."""
        if self._state != "running":
            raise self._not_running("neutral")
        return self._sent(self._outputs.neutral(t))

    def _sent(self, left: float) -> float:
        self.trouble = self._outputs.trouble
        self.commands_sent = self._outputs.sent()
        return left

    def why_old(self, place: int) -> str:
        """Why the newest frames of an input's message were not used; "" if none came."""
        frames = self._inputs.values()
        return next((f.why_old() for f in frames if place in [at for _, at in f.signals]), "")

    def tell_foreign(self) -> str:
        """The newest command of somebody else, for people."""
        return self._outputs.tell_foreign()

    def left(self) -> Sequence[float]:
        """When each output's last command was on the bus [s], once it is confirmed; nan before."""
        return self._outputs.left()

    def close(self) -> None:
        """Give the bus back, after a moment for a neutral command that found no room."""
        for _ in range(CLOSE_TRIES if self._state == "running" else 0):
            if not self._outputs.neutral_waits or self.trouble:
                break
            message = self._link.receive(CLOSE_WAIT_S)
            if message is not None:
                self._take(message)
            self._outputs.send_waiting()
        self._state = "closed"
        self._link.close()

    def neutral_recipe(self) -> Mapping[str, Any]:
        """Neutral frames with every value of the sequence counters, for another process' own socket."""
        o = self.options
        if o.interface != "socketcan":
            return {"kind": "none", "why": f"{o.interface} channels belong to the process that opened them"}
        if self._state == "closed":
            raise DriverStateError("neutral_recipe: the outputs are not known yet; call open first")
        frames = self._outputs.neutral_cycle()
        return {"kind": "socketcan", "channel": o.channel, "fd": o.fd, "frames": frames}

    def _not_running(self, call: str) -> DriverStateError:
        first = "open and start" if self._state == "closed" else "start"
        return DriverStateError(f"{call}: the bus is {self._state}, not running; call {first} first")
