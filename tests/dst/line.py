"""A serial line with this computer's port on one end and a board on the other, on simulated time.

Bytes need their time on the wire, each way. The port can be gone, the cable cut, the bit rate wrong; bytes
get lost, others come between frames. The board speaks the binary form of docs/serial.md, written apart from
`drivers` and `sim`; its amplifier has a watchdog.
"""

from __future__ import annotations

import errno
import math
import os
import select
import stat
import struct
import termios
import zlib
from collections import deque
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import serial

from drivers import serial_counters as count
from tests.dst.frames import VOLTS
from tests.dst.rig import Rig
from tests.dst.shells import Shell
from tests.dst.world import End

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from tests.dst.world import Process, World

HELLO, SAMPLE, ASK, START, COMMAND = 0x01, 0x02, 0x81, 0x82, 0x83
BYTE_S = 10 / 115_200
ROOM = 4096
"""Bytes that the port holds, each way."""
WATCHDOG_MS = 400
PRESSURE = 7.0


def stuffed(content: bytes) -> bytes:
    """COBS of a content of less than 254 bytes, with its end."""
    return b"".join(bytes([len(part) + 1]) + part for part in content.split(b"\0")) + b"\0"


def unstuffed(data: bytes) -> bytes:
    """What was stuffed; b"" where it is none."""
    content, at = b"", 0
    while at < len(data):
        part = data[at + 1 : at + data[at]]
        if data[at] == 0 or len(part) != data[at] - 1:
            return b""
        content += part + b"\0"
        at += data[at]
    return content[:-1]


def frame(kind: int, sequence: int, body: bytes) -> bytes:
    """One frame with its end."""
    content = bytes([kind, sequence & 0xFF]) + body
    return stuffed(content + struct.pack("<I", zlib.crc32(content)))


class Stream:
    """Sound frames of a stream of bytes: type, sequence, body."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[tuple[int, int, bytes]]:
        """Those that are whole now."""
        *parts, self._rest = (self._rest + data).split(b"\0")
        contents = [unstuffed(part) for part in parts]
        return [
            (each[0], each[1], each[2:-4])
            for each in contents
            if len(each) >= 6 and struct.pack("<I", zlib.crc32(each[:-4])) == each[-4:]
        ]


class Command(NamedTuple):
    """A command, understood."""

    volts: float
    sound: bool = True


def command(body: bytes) -> Command:
    """The body of a COMMAND."""
    return Command(struct.unpack("<h", body)[0] * VOLTS)


class Port(End):
    """A process' hold on the port, also as `serial.Serial` and `Arrivals` of it."""

    def __init__(self, world: World, line: Line) -> None:
        super().__init__(world)
        self.fd = next(world.fds)
        world.ends[self.fd] = self
        self.line = line
        self.process: Process = world.me().process
        self.process.held.append(self)
        self.told = False
        self.commands = self.samples = 0
        self.started = self.asked_again = False
        self._out, self._in = Stream(), Stream()
        line.ports.append(self)

    def readable(self) -> bool:
        return self.told

    def tell(self) -> None:
        """Something came, or the line hung up."""
        self.told = True
        self.changed()

    @property
    def alive(self) -> bool:
        """The port was there ever since."""
        return self in self.line.ports

    def write(self, data: bytes) -> int:
        """As `os.write` on a port that does not block."""
        self.world.touch("send")
        self.world.me()
        if not self.alive:
            raise OSError(errno.EIO, "Input/output error")
        taken = self.line.take(data)
        if data and not taken:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        self.world.note(f"{self.process.name} writes {data[:taken].hex()}")
        for kind, _, body in self._out.feed(data[:taken]):
            if kind == ASK and not self.started:
                self.samples = 0  # of a board that still ran: they are not used
            self.asked_again |= kind == ASK and self.started
            self.started |= kind == START
            if kind == COMMAND:
                self.commands += 1
                self.line.on_command(self, command(body))
        self.world.touch("sent")
        return taken

    def read(self, most: int) -> bytes:
        """As `os.read`."""
        self.world.touch("receive")
        if not self.alive:
            raise OSError(errno.EIO, "Input/output error")
        data = bytes(self.line.inbox[:most])
        if not data:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        del self.line.inbox[:most]
        self.samples += sum(kind == SAMPLE for kind, _, _ in self._in.feed(data))
        return data

    def miscount(self, counters: list[int]) -> str:
        """What the driver's counters tell wrong ("" where nothing)."""
        if counters[count.REOPENED] or self.asked_again:
            return ""
        told = counters[count.SAMPLES] + counters[count.REPEATED]
        # one is in hand; those that were on their way while the board heard ASK are not used
        if not 0 <= self.samples - told <= 4:
            return f"{self.samples} samples were read, the counters add up to {told}"
        if self.commands > counters[count.COMMANDS] + 1:
            return f"{self.commands} commands were written, {counters[count.COMMANDS]} counted"
        return ""

    def give_back(self) -> None:
        if self in self.line.ports:
            self.line.ports.remove(self)

    # ---- as `serial.Serial`

    def fileno(self) -> int:
        return self.fd

    def set_low_latency_mode(self, _: bool) -> None:
        """It has no latency of its own."""

    def close(self) -> None:
        if self in self.process.held:
            self.process.held.remove(self)
        self.give_back()


class Arrivals:
    """`drivers.serial_arrivals.Arrivals`."""

    def __init__(self, port: Port) -> None:
        self._port = port

    def wait(self, timeout: float) -> bool:
        if not self._port.told:
            self._port.world.block(self._port.world.now + timeout, [self._port])
        return self._port.told

    def taken(self) -> bool:
        told, self._port.told = self._port.told, False
        return told

    def close(self) -> None:
        """Nothing is open."""


class Line:
    """The wire, the port, and what can go wrong with both.

    Attributes:
        there: The port exists.
        cut: Nothing passes, though it does.
        other_baud: The board's bit rate is another.
        loss: Part of the bytes that get lost, each way.
        noise: Part of the writes that have garbage before them, each way.
        works: Bytes pass, both ways, whole.
        on_command: Told of each command that the port takes: port, command.
        on_bytes: Told of bytes that reach the board.
        on_sensor: Told of each sample that reaches this computer: run enable, sound, and no counter.
    """

    HEALTHY: ClassVar[dict[str, Any]] = {
        "there": True,
        "cut": False,
        "other_baud": False,
        "loss": 0.0,
        "noise": 0.0,
    }

    def __init__(self, world: World, rng: Random) -> None:
        self.world, self.rng = world, rng
        self.there, self.cut, self.other_baud = True, False, False
        self.loss = self.noise = 0.0
        self.works = True
        self.ports: list[Port] = []
        self.inbox = bytearray()
        self.on_command: Callable[[Port, Command], None] = lambda *_: None
        self.on_bytes: Callable[[bytes], None] = lambda _: None
        self.on_sensor: Callable[[bool, bool, int | None], None] = lambda *_: None
        self._out: deque[bytes] = deque()
        self._leaving: tuple[float, bytes] | None = None
        self._in_free = world.now
        self._stream = Stream()

    # ---- from this computer

    def take(self, data: bytes) -> int:
        """A program writes; how many bytes found room."""
        room = ROOM - sum(map(len, self._out))
        taken = data[:room]
        if taken:
            self._out.append(taken)
            self._go()
        return len(taken)

    def flush(self) -> None:
        """Throw away what has not left yet."""
        self._out.clear()
        if self._leaving is not None:
            began, data = self._leaving
            self._leaving = began, data[: math.ceil((self.world.now - began) / BYTE_S)]

    def _go(self) -> None:
        if self._leaving is None and self._out:
            data = self._out.popleft()
            self._leaving = self.world.now, data
            self.world.at(self.world.now + len(data) * BYTE_S, self._left)

    def _left(self) -> None:
        if self._leaving is not None:
            _, data = self._leaving
            self._leaving = None
            if self.there and not self.cut:
                self.on_bytes(self._spoilt(data))
        self._go()

    def _spoilt(self, data: bytes) -> bytes:
        rng = self.rng
        if self.other_baud:
            return rng.randbytes(len(data))
        if self.loss:
            data = bytes(byte for byte in data if rng.random() >= self.loss)
        if self.noise and rng.random() < self.noise:
            data = rng.randbytes(rng.randrange(1, 9)) + data
        return data

    # ---- from the board

    def put(self, data: bytes) -> None:
        """The board sends."""
        self._in_free = max(self._in_free, self.world.now) + len(data) * BYTE_S
        self.world.at(self._in_free, lambda: self._arrive(self._spoilt(data)))

    def _arrive(self, data: bytes) -> None:
        if not self.there or self.cut or not data:
            return
        if self.ports:  # else nobody keeps it
            self.inbox += data[: max(0, ROOM - len(self.inbox))]
        for kind, _, body in self._stream.feed(data):
            if kind == SAMPLE:
                self.on_sensor(bool(body[-1]), True, None)  # a line keeps the order
        for port in self.ports:
            port.tell()

    # ---- trouble

    def set_state(self, **state: Any) -> None:
        """Change what is wrong with the line, with what programs see of it."""
        was_there = self.there
        for name, value in state.items():
            setattr(self, name, value)
        self.works = all(getattr(self, name) == value for name, value in self.HEALTHY.items())
        self.world.note(f"line {state}")
        if was_there and not self.there:
            ports, self.ports = self.ports, []
            self._out.clear()
            self.inbox.clear()
            for port in ports:
                port.tell()


class Board(Rig):
    """Sensors and amplifier behind the board."""

    def __init__(self, world: World, line: Line, rng: Random, rate_hz: float, watchdog_s: float) -> None:
        self.line, self.rate_hz = line, rate_hz
        self._stream = Stream()
        self._power_on(world.now)
        super().__init__(world, line, rng, rate_hz, watchdog_s)  # type: ignore[arg-type]
        line.on_bytes = self._receive

    def _power_on(self, t: float) -> None:
        self.sampling = self.was_broken = False
        self.since = t
        self.ack, self.commanded_at = 0, -math.inf
        self.samples = 0
        self.neutral = True

    def restart(self) -> None:
        """Its supply fails for a moment."""
        self._set(0.0)
        self._power_on(self.world.now)

    def _receive(self, data: bytes) -> None:
        for kind, sequence, body in self._stream.feed(data):
            if kind == ASK:
                self._set(0.0)
                self._power_on(self.since)
                rate, layout = round(self.rate_hz * 1000), b"fffB/h\0board"
                self.line.put(frame(HELLO, 0, struct.pack("<BBIH", 1, 1, rate, WATCHDOG_MS) + layout))
            elif kind == START and body == b"\1":
                self.sampling = True
            elif kind == COMMAND and self.sampling and len(body) == 2:
                self._obey(sequence, body)

    def _obey(self, sequence: int, body: bytes) -> None:
        if self.commanded_at > -math.inf and sequence == self.ack:
            return
        self.ack, self.neutral = sequence, False
        self.commanded_at = self.heard_at = self.world.now
        self._set(command(body).volts)

    def _us(self, t: float) -> int:
        return int((t - self.since) * 1e6)

    def _publish(self) -> None:
        now = self.world.now
        self.neutral = self.neutral or now - self.heard_at > self.watchdog
        if not self.sampling:
            return
        angle = PRESSURE if self.instead == "pressure" else self._angle
        age = min(self._us(now) - self._us(self.commanded_at), 65535) if self.commanded_at > 0 else 65535
        head = struct.pack("<IBBH", self._us(now) & 0xFFFFFFFF, self.neutral, self.ack, age)
        body = struct.pack("<fffB", math.nan if self.nan else angle, 0.0, PRESSURE, self.run)
        data = frame(SAMPLE, self.samples, head + body)
        self.samples += 1
        if self.corrupt:
            data = bytes([data[0]]) + bytes([data[1] ^ 3]) + data[2:]
        self._send(data)

    def _send(self, data: bytes) -> None:
        if self.silent or (self.loss and self.rng.random() < self.loss):
            return
        self.world.at(self.world.now + self.delay, lambda: self.line.put(data))


class PortOs(Shell):
    """`os` as the driver and neutral's writer use it on a port."""

    def __init__(self, world: World, line: Line) -> None:
        super().__init__(world, os)
        self._line = line

    def _there(self) -> None:
        if not self._line.there:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory")

    def stat(self, _: str) -> Any:
        """A character device, if it is there."""
        self._there()
        return os.stat_result((stat.S_IFCHR, *[0] * 9))

    def open(self, *_: object) -> int:
        """A descriptor of the port."""
        self._there()
        return Port(self._world, self._line).fd

    def read(self, fd: int, most: int) -> bytes:
        """From the port."""
        port: Port = self._world.ends[fd]
        return port.read(most)

    def write(self, fd: int, data: bytes) -> int:
        """To the port."""
        port: Port = self._world.ends[fd]
        return port.write(data)

    def close(self, fd: int) -> None:
        """Of the port."""
        self._world.ends[fd].close()


class Termios(Shell):
    """`termios.tcflush` of a simulated port."""

    def __init__(self, world: World, line: Line) -> None:
        super().__init__(world, termios)
        self._line = line

    def tcflush(self, fd: int, _: int) -> None:
        """What has not left is thrown away."""
        if not self._world.ends[fd].alive:
            raise termios.error(errno.EIO, "Input/output error")
        self._line.flush()


class Serial(Shell):
    """`serial.Serial`, called."""

    def __init__(self, world: World, line: Line) -> None:
        super().__init__(world, serial)
        self._line = line

    def Serial(self, *_: object, **__: object) -> Port:
        """The port, opened by this process; pyserial throws away what came before."""
        self._line.inbox.clear()
        return Port(self._world, self._line)


class HangUp(Shell):
    """`select.poll()` that tells of nothing but a port that hung up."""

    def __init__(self, world: World) -> None:
        super().__init__(world, select)

    def poll(self) -> Any:
        """A new poll object."""
        return _HangUpPoll(self._world)


class _HangUpPoll:
    def __init__(self, world: World) -> None:
        self._world = world
        self._ports: list[Port] = []

    def register(self, fd: int, _: int) -> None:
        self._ports.append(self._world.ends[fd])

    def poll(self, _: float) -> list[tuple[int, int]]:
        return [(port.fd, select.POLLHUP) for port in self._ports if not port.alive]
