"""The simulated rig on the other end of a CAN bus, as a process of its own: `seod rig CONFIG`.

It decodes what the daemon encodes and the other way round, by the same options and DBC.
"""

from __future__ import annotations

import time
from random import Random
from typing import TYPE_CHECKING

import can

from drivers.can_codec import CanCodec, CodecError, UnknownFrameError, WrongLengthError
from drivers.can_counters import COUNTER_NAMES
from drivers.can_interfaces import REALTIME_STAMPS
from drivers.can_link import CanLink, filters_for
from drivers.clock import StampClock
from sim.can_messages import check_channels, identifiers, sensor_messages
from sim.faults import FaultLine
from sim.rig_end import RigEnd, compile_plant, serve

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.can_codec import Decoded
    from drivers.can_config import CanOptions
    from sim.config import SimulationConfig
    from sim.faults import Frame

DOWN_PAUSE_S = 0.005
"""How often a bus that is away is looked at."""

QUEUE = 64
"""Sensor frames that may wait in the socket."""

BURST = 64
"""Frames taken at once, at most, before the sensors have their turn."""

COUNTS = ("commands", "lost_commands", "repeated_commands", "bad_commands", "unknown_frames")


class CanRig(RigEnd):
    """The rig's end of the bus.

    Args:
        options: Of the daemon's driver; the rig takes the other side.
        simulation: What is simulated.
        clock: CLOCK_MONOTONIC [s].

    Raises:
        CodecError: A channel of the simulation is not in the DBC, or goes the wrong way.
    """

    def __init__(
        self,
        options: CanOptions,
        simulation: SimulationConfig,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(simulation, COUNTS, clock)
        self._options = options
        self._codec = CanCodec(options)
        check_channels(self._codec, self.rig)
        self.messages = sensor_messages(self._codec, self.rig, simulation.sensor_rate_hz)
        self.message_names = [message.name for message in self.messages]
        self._turn = 0
        self._last_counter: dict[str, int] = {}
        self._ticks = {(frame.id, frame.extended) for frame in options.tick_frames[:1]}
        self._awaited = {(frame.id, frame.extended, frame.payload) for frame in options.start_frames}
        self._wanted = self._ticks | {(number, extended) for number, extended, _ in self._awaited}
        self._wanted |= identifiers(self._codec, options.node)
        self.faults = FaultLine(Random(simulation.seed), self._wanted | identifiers(self._codec))  # noqa: S311
        self._link_counts = [0] * len(COUNTER_NAMES)
        self._link = CanLink(options, self._link_counts)
        self._stamps = StampClock(clock, trusted=options.interface in REALTIME_STAMPS)

    @property
    def started(self) -> bool:
        """Whether all start frames have come, or none are needed."""
        return not self._awaited

    def open(self) -> None:
        """Take the bus.

        Raises:
            DriverError: It cannot be had.
        """
        self._link.open(filters_for(sorted(self._wanted)), QUEUE)
        self._begin()

    def _begin(self) -> None:
        if self.started and not self._ticks:
            self._begin_turns()

    def close(self) -> None:
        """Give the bus back."""
        self._link.close()

    def _receive(self, now: float, until: float) -> float:
        self._link.reopen(now)
        for taken in range(BURST):
            left = self._patience(now, until)
            if left and (self._link.down or not self._link.is_open):
                time.sleep(min(left, DOWN_PAUSE_S))
                left = 0.0
            message = self._link.receive(left)
            now = self._clock()
            if message is None:
                if taken:
                    self._stamps.drained()
                break
            if not message.is_error_frame and not message.is_remote_frame:
                self._take(self._stamps.to_loop(message.timestamp), message)
        return now

    def _take(self, t: float, message: can.Message) -> None:
        key = (message.arbitration_id, message.is_extended_id)
        if key in self._ticks and self.started:
            self._measure(self._clock())
            return
        start = (*key, bytes(message.data))
        if start in self._awaited:
            self._awaited.discard(start)
            self._begin()
            return
        try:
            self._command(t, self._codec.decode(*key, bytes(message.data)))
        except (UnknownFrameError, WrongLengthError):
            self.counts["unknown_frames"] += 1

    def _command(self, t: float, decoded: Decoded) -> None:
        if not decoded.checksum_ok:
            self.counts["bad_commands"] += 1
            return
        self._check_sequence(decoded)
        self.counts["commands"] += 1
        self.rig.apply(t, {f"{decoded.message}.{name}": value for name, value in decoded.values.items()})

    def _check_sequence(self, decoded: Decoded) -> None:
        if decoded.counter is None:
            return
        last = self._last_counter.get(decoded.message)
        self._last_counter[decoded.message] = decoded.counter
        if last is not None:
            step = (decoded.counter - last) % self._codec.counter_period(decoded.message)
            self.counts["repeated_commands" if step == 0 else "lost_commands"] += 1 if step == 0 else step - 1

    def _measure(self, t: float) -> None:
        for message in self.messages:
            if self._turn % message.every == 0:
                frame = message.frame(t, self.faults.hits("freeze", message.name))
                if frame is not None:
                    self.faults.put(t, frame)
        self._turn += 1

    def _put_on_line(self, frame: Frame) -> None:
        self._link.send(
            can.Message(
                arbitration_id=frame.frame_id,
                is_extended_id=frame.extended,
                is_fd=frame.fd,
                bitrate_switch=frame.fd and self._options.data_bitrate is not None,
                data=frame.data,
            )
        )

    def state(self) -> dict[str, object]:
        """What goes on at this end of the bus: counters, and why it cannot be reached if so."""
        link = {name: n for name, n in zip(COUNTER_NAMES, self._link_counts, strict=True) if n}
        return {"started": self.started, "trouble": self._link.down, "counts": self.counts, "link": link}


def run(
    options: CanOptions,
    simulation: SimulationConfig,
    control_port: int | None = None,
    duration: float | None = None,
    own: str | None = None,  # noqa: ARG001 - as other rigs have it
) -> None:
    """Be the rig until SIGTERM or SIGINT; one JSON line on stdout tells when it is ready.

    Args:
        options: The rig file's driver section.
        simulation: Its simulation section.
        control_port: Instead of the section's; 0 for any free one.
        duration: End by itself after this [s].
        own: Not needed: both ends of a bus have the same name.

    Raises:
        DriverError: The bus cannot be had, or the simulation does not fit the DBC.
        OSError: The control port is taken.
    """
    if options.interface == "virtual":
        raise CodecError(
            "driver.interface: virtual exists only within one process, so a rig in another cannot be reached "
            "through it; use interface: socketcan with a vcan channel, or driver.kind: virtual"
        )
    compile_plant(simulation)
    port = simulation.control_port if control_port is None else control_port
    serve(CanRig(options, simulation), port, duration, {"channel": options.channel})
