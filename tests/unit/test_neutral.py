"""Neutral written by another process than the one that opened the bus."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING

import pytest

from drivers.neutral import CLASSIC, FLEXIBLE, NoNeutral, SocketcanNeutral, open_neutral, pack_frame
from tests.unit.can_bench import CODEC, Rig, rigs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


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


def test_rigs_that_no_other_process_reaches_say_so() -> None:
    writer = open_neutral({"kind": "none", "why": "it is simulated"})
    assert isinstance(writer, NoNeutral)
    assert writer.write(3) == "it is simulated"
    with pytest.raises(ValueError, match="'pigeon'"):
        open_neutral({"kind": "pigeon"})
