"""Neutral written by another process than the one that opened the bus."""

from __future__ import annotations

import errno
import os
import pty
import socket
import termios
import tty
from typing import TYPE_CHECKING

import pytest

from drivers.neutral import (
    CLASSIC,
    FLEXIBLE,
    NoNeutral,
    SerialNeutral,
    SocketcanNeutral,
    open_neutral,
    pack_frame,
)
from tests.unit.can_bench import CODEC, Rig, rigs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    yield from rigs(monkeypatch)


@pytest.fixture
def rig(make: Callable[..., Rig]) -> Rig:
    return make()


class FakeSocket:
    """A raw socket with a queue of limited length."""

    def __init__(self, room: int = 1000, error: int = 0) -> None:
        self.frames: list[bytes] = []
        self.room = room
        self.error = error
        self.closed = False

    def send(self, frame: bytes) -> None:
        if self.error:
            raise OSError(self.error, "fails")
        if len(self.frames) >= self.room:
            raise OSError(errno.ENOBUFS, "full")
        self.frames.append(frame)

    def close(self) -> None:
        self.closed = True


def neutral_writer(monkeypatch: pytest.MonkeyPatch, rig: Rig, *sockets: FakeSocket) -> SocketcanNeutral:
    supply = iter(sockets)
    monkeypatch.setattr("drivers.neutral._raw_socket", lambda channel, fd: next(supply))
    writer = open_neutral(rig.driver.neutral_recipe())
    assert isinstance(writer, SocketcanNeutral)
    return writer


def test_the_neutral_cycle_begins_with_the_counter_that_is_expected(
    monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    raw = FakeSocket()
    writer = neutral_writer(monkeypatch, rig, raw)
    assert writer.write(21) == ""
    frames = [CLASSIC.unpack(frame) for frame in raw.frames]
    decoded = [CODEC.decode(frame_id, False, data[:length]) for frame_id, length, data in frames]
    assert [frame.counter for frame in decoded] == [(21 + n) % 16 for n in range(16)]
    assert all(frame.values["voltage"] == 0.0 and frame.checksum_ok for frame in decoded)


def test_a_queue_with_room_for_the_next_two_counters_takes_neutral(
    monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    assert neutral_writer(monkeypatch, rig, FakeSocket(room=2)).write(3) == ""


def test_the_neutral_writer_says_what_is_wrong_and_takes_a_new_interface(
    monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    full, gone, new = FakeSocket(room=1), FakeSocket(error=errno.ENODEV), FakeSocket()
    writer = neutral_writer(monkeypatch, rig, full, gone, new)
    assert writer.write(0) == "can0: only 1 of 16 neutral frames found room in the queue"
    full.error = errno.ENETDOWN
    assert writer.write(0) == "can0: fails"
    full.error = errno.ENXIO
    assert writer.write(0) == "can0 is gone"
    assert full.closed
    assert gone.closed
    assert writer.write(0) == ""
    assert len(new.frames) == 16
    writer.close()
    writer.close()


class CycleSocket(FakeSocket):
    """Has room for `room` frames, then fails with an error of its own."""

    def __init__(self, room: int, error: int) -> None:
        super().__init__(room)
        self.when_full = error

    def send(self, frame: bytes) -> None:
        if len(self.frames) >= self.room:
            raise OSError(self.when_full, os.strerror(self.when_full))
        self.frames.append(frame)


def small_writer(
    monkeypatch: pytest.MonkeyPatch, *sockets: FakeSocket, opened: list[tuple[str, bool]] | None = None
) -> SocketcanNeutral:
    """Of a rig that takes two frames a step, and counts to four."""
    supply = iter(sockets)

    def raw_socket(channel: str, fd: bool) -> FakeSocket:
        if opened is not None:
            opened.append((channel, fd))
        return next(supply)

    monkeypatch.setattr("drivers.neutral._raw_socket", raw_socket)
    return SocketcanNeutral("can1", True, [[b"a%d" % n, b"b%d" % n] for n in range(4)])


def test_all_frames_of_each_step_are_sent_and_the_cycle_goes_round(monkeypatch: pytest.MonkeyPatch) -> None:
    raw, opened = FakeSocket(), list[tuple[str, bool]]()
    writer = small_writer(monkeypatch, raw, opened=opened)
    assert writer.write(6) == ""
    assert raw.frames == [b"a2", b"b2", b"a3", b"b3", b"a0", b"b0", b"a1", b"b1"]
    assert opened == [("can1", True)], "opened before it is needed, and once"
    assert not raw.closed


@pytest.mark.parametrize("error", [errno.ENOBUFS, errno.EAGAIN])
def test_a_full_queue_keeps_neutral_from_leaving_until_two_steps_are_in_it(
    monkeypatch: pytest.MonkeyPatch, error: int
) -> None:
    for room, said in (
        (0, "can1: only 0 of 4 neutral frames found room in the queue"),
        (3, "can1: only 1 of 4 neutral frames found room in the queue"),
        (4, ""),
        (7, ""),
    ):
        raw = CycleSocket(room, error)
        assert small_writer(monkeypatch, raw).write(0) == said
        assert not raw.closed, "a queue that is full is no interface that is gone"


@pytest.mark.parametrize("error", [errno.ENODEV, errno.ENXIO, errno.EBADF])
def test_an_interface_that_went_in_mid_cycle_is_taken_again_and_sent_the_whole_cycle(
    monkeypatch: pytest.MonkeyPatch, error: int
) -> None:
    went, new = CycleSocket(3, error), FakeSocket()
    writer = small_writer(monkeypatch, went, new)
    assert writer.write(1) == ""
    assert went.closed
    assert new.frames == [b"a1", b"b1", b"a2", b"b2", b"a3", b"b3", b"a0", b"b0"]
    writer.close()
    assert new.closed
    assert writer.socket is None


def test_an_interface_that_fails_to_open_again_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(channel: str, fd: bool) -> FakeSocket:
        raise OSError(errno.EPERM, "not permitted")

    writer = small_writer(monkeypatch, CycleSocket(0, errno.ENODEV))
    monkeypatch.setattr("drivers.neutral._raw_socket", refused)
    assert writer.write(0) == "can1: not permitted"
    assert writer.socket is None
    assert writer.write(0) == "can1: not permitted"


class Kernel:
    """What is asked of a raw CAN socket."""

    def __init__(self, fails: str = "") -> None:
        self.fails = fails
        self.asked: list[tuple[object, ...]] = []

    def note(self, name: str, *arguments: object) -> None:
        self.asked.append((name, *arguments))
        if name == self.fails:
            raise OSError(errno.ENODEV, "No such device")

    def socket(self, *arguments: object) -> Kernel:
        self.note("socket", *arguments)
        return self

    def setsockopt(self, *arguments: object) -> None:
        self.note("setsockopt", *arguments)

    def bind(self, address: tuple[str]) -> None:
        self.note("bind", address)

    def close(self) -> None:
        self.note("close")


RAW = (socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
NO_FRAMES_IN = (socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")


@pytest.mark.parametrize(
    ("fd", "more"), [(False, []), (True, [("setsockopt", socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)])]
)
def test_the_raw_socket_never_waits_and_never_reads(
    monkeypatch: pytest.MonkeyPatch, fd: bool, more: list[tuple[object, ...]]
) -> None:
    kernel = Kernel()
    monkeypatch.setattr("drivers.neutral.socket.socket", kernel.socket)
    recipe = {"kind": "socketcan", "channel": "can2", "fd": fd, "frames": []}
    writer = open_neutral(recipe)
    assert isinstance(writer, SocketcanNeutral)
    assert writer.socket is not None
    assert kernel.asked == [
        ("socket", *RAW),
        ("setsockopt", *NO_FRAMES_IN),
        *more,
        ("bind", ("can2",)),
    ]


def test_a_raw_socket_that_cannot_be_bound_is_closed_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = Kernel(fails="bind")
    monkeypatch.setattr("drivers.neutral.socket.socket", kernel.socket)
    writer = SocketcanNeutral("can2", False, [[b"x"]])
    assert writer.socket is None
    assert [name for name, *_ in kernel.asked] == ["socket", "setsockopt", "bind", "close"]
    assert writer.write(0) == "can2: No such device"
    assert [name for name, *_ in kernel.asked[4:]] == ["socket", "setsockopt", "bind", "close"]


def test_an_interface_that_is_not_there_is_told_and_leaves_nothing_open(rig: Rig) -> None:
    writer = open_neutral(rig.driver.neutral_recipe())
    assert writer.write(0).startswith("can0: ")
    writer.close()


def test_frames_have_the_kernels_layout() -> None:
    frame = {"id": 0x123, "extended": True, "fd": False, "bit_rate_switch": False, "data": "0102"}
    assert CLASSIC.size == 16
    assert FLEXIBLE.size == 72
    assert (
        pack_frame(frame).hex() == (0x80000123).to_bytes(4, "little").hex() + "02000000" + "0102" + "00" * 6
    )
    flexible = pack_frame({**frame, "fd": True, "bit_rate_switch": True})
    assert len(flexible) == 72
    assert flexible[4:8].hex() == "02050000"
    assert flexible[8:].hex() == "0102" + "00" * 62
    steady = pack_frame({**frame, "fd": True, "extended": False})
    assert steady[:8].hex() == "23010000" + "02040000"
    assert pack_frame({**frame, "id": 0x122, "extended": False})[:5].hex() == "2201000002"


def test_rigs_that_no_other_process_reaches_say_so() -> None:
    writer = open_neutral({"kind": "none", "why": "it is simulated"})
    assert isinstance(writer, NoNeutral)
    assert writer.write(3) == "it is simulated"
    writer.close()
    with pytest.raises(ValueError, match=r"^unknown neutral recipe 'pigeon'$"):
        open_neutral({"kind": "pigeon"})


# A serial port


class Port:
    """A pseudo-terminal: the writer's end has a name, this one shows what came."""

    def __init__(self) -> None:
        self.own, self.theirs = pty.openpty()
        tty.setraw(self.theirs)
        os.set_blocking(self.own, False)
        self.name = os.ttyname(self.theirs)

    def came(self) -> bytes:
        try:
            return os.read(self.own, 1 << 16)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        os.close(self.own)
        os.close(self.theirs)


@pytest.fixture
def port() -> Iterator[Port]:
    made = Port()
    yield made
    made.close()


def test_serial_neutral_is_the_bytes_of_the_recipe_however_often(port: Port) -> None:
    writer = open_neutral({"kind": "serial", "port": port.name, "data": "00ff0a41"})
    assert isinstance(writer, SerialNeutral)
    for sent in (0, 7):
        assert writer.write(sent) == ""
        assert port.came() == b"\x00\xff\x0aA"
    writer.close()
    assert writer.fd is None
    writer.close()
    assert writer.write(0) == "", "a port that was given back is taken again"
    assert port.came() == b"\x00\xff\x0aA"
    writer.close()


def test_a_serial_port_is_opened_to_write_and_never_waits(
    port: Port, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, int]] = []
    real = os.open

    def opened(name: str, flags: int) -> int:
        asked.append((name, flags))
        return real(name, flags)

    monkeypatch.setattr("drivers.neutral.os.open", opened)
    writer = SerialNeutral(port.name, b"0")
    assert asked == [(port.name, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)]
    assert writer.fd is not None
    assert not os.get_blocking(writer.fd)
    writer.close()
    assert writer.write(0) == ""
    assert len(asked) == 2
    writer.close()


def test_what_has_not_left_is_thrown_away_before_neutral_is_written(
    port: Port, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[object, ...]] = []
    writer = SerialNeutral(port.name, b"neutral")
    fd = writer.fd
    monkeypatch.setattr("drivers.neutral.termios.tcflush", lambda *asked: done.append(("flush", *asked)))
    monkeypatch.setattr("drivers.neutral.os.write", lambda *asked: done.append(("write", *asked)) or 7)
    assert writer.write(0) == ""
    assert done == [("flush", fd, termios.TCOFLUSH), ("write", fd, b"neutral")]
    writer.close()


@pytest.mark.parametrize(("sent", "said"), [(7, ""), (6, "{port}: no room for neutral")])
def test_neutral_that_found_no_room_is_told(
    port: Port, monkeypatch: pytest.MonkeyPatch, sent: int, said: str
) -> None:
    writer = SerialNeutral(port.name, b"neutral")
    monkeypatch.setattr("drivers.neutral.os.write", lambda *_: sent)
    assert writer.write(0) == said.format(port=port.name)
    assert writer.fd is not None, "it is kept: the next time there may be room"
    writer.close()


def test_a_serial_port_that_is_not_there_is_told_and_tried_again(tmp_path: Path, port: Port) -> None:
    name = tmp_path / "board"
    writer = SerialNeutral(str(name), b"0")
    assert writer.fd is None
    assert writer.write(0) == f"{name}: No such file or directory"
    name.symlink_to(port.name)
    assert writer.write(0) == ""
    assert port.came() == b"0"
    writer.close()


@pytest.mark.parametrize("error", [OSError(errno.EIO, "fails"), termios.error(errno.EIO, "fails")])
def test_a_serial_port_that_fails_is_taken_again_once(
    port: Port, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    real, failing = termios.tcflush, [error]

    def flush(fd: int, queue: int) -> None:
        if failing:
            raise failing.pop()
        real(fd, queue)

    monkeypatch.setattr("drivers.neutral.termios.tcflush", flush)
    writer = SerialNeutral(port.name, b"0")
    assert writer.write(0) == ""
    assert port.came() == b"0"
    failing += [error, error]
    assert writer.write(0) == f"{port.name}: {error}"
    assert writer.fd is None
    assert not failing
    assert port.came() == b""
    assert writer.write(0) == ""
    writer.close()


def test_a_serial_port_that_went_says_why_it_cannot_be_opened(
    tmp_path: Path, port: Port, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = tmp_path / "board"
    name.symlink_to(port.name)
    writer = SerialNeutral(str(name), b"0")
    name.unlink()

    def gone(fd: int, queue: int) -> None:
        raise termios.error(errno.EIO, "Input/output error")

    monkeypatch.setattr("drivers.neutral.termios.tcflush", gone)
    assert writer.write(0) == f"{name}: No such file or directory"
