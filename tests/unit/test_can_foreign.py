"""Somebody else who sends our commands, told from our own frames on each kind of interface."""

from __future__ import annotations

import socket
import struct
from collections import Counter
from typing import TYPE_CHECKING

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import can_socket
from drivers.can_interfaces import ECHOES
from tests.unit.can_bench import CODEC, VALVE, Rig, rigs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

STAMP = struct.pack("@ll", 1_700_000_000, 250_000_000)
TAKEOVER_S = 1.0


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    yield from rigs(monkeypatch)


def valve(volts: float, counter: int = 0) -> bytes:
    return CODEC.encode("Valve", {"voltage": volts}, counter)


def take_over(rig: Rig) -> None:
    """The first second, in which the supervisor may still write neutral, is over."""
    rig.clock.t += 2 * TAKEOVER_S


@pytest.mark.parametrize(
    ("flags", "ours", "here"),
    [
        (0, False, False),
        (socket.MSG_DONTROUTE, False, True),
        (socket.MSG_DONTROUTE | socket.MSG_CONFIRM, True, True),
    ],
    ids=["another node", "another program on this computer", "this socket"],
)
def test_only_a_confirmed_frame_is_ours(flags: int, ours: bool, here: bool) -> None:
    class Kernel:
        def recvmsg(self, _size: int, _space: int) -> tuple[bytes, list[tuple[int, int, bytes]], int, None]:
            return struct.pack("=IB3x8s", 0x201, 4, b"\1\2\3\4"), [(1, 35, STAMP)], flags, None

    frame = can_socket.receive(Kernel(), 0.0)  # type: ignore[arg-type] # all of a socket that is used
    assert frame is not None
    assert (not frame.message.is_rx, frame.here) == (ours, here)
    assert bytes(frame.message.data) == b"\1\2\3\4"
    assert frame.message.timestamp == 1_700_000_000.25


@pytest.mark.parametrize(
    ("word", "extended", "remote", "error"),
    [
        (0x201, False, False, False),
        (0x80000201, True, False, False),
        (0x40000201, False, True, False),
        (0x20000004, False, False, True),
    ],
)
def test_the_kernels_frames_are_read_as_python_can_reads_them(
    word: int, extended: bool, remote: bool, error: bool
) -> None:
    message = can_socket.unpack(struct.pack("=IB3x8s", word, 3, b"abc"), STAMP, 0)
    assert (message.is_extended_id, message.is_remote_frame, message.is_error_frame) == (
        extended,
        remote,
        error,
    )
    assert message.arbitration_id == word & 0x1FFFFFFF
    if remote:
        return
    fd = can_socket.unpack(struct.pack("=IBB2x64s", word, 12, 0x03, bytes(range(64))), STAMP, 0)
    assert (fd.is_fd, fd.bitrate_switch, fd.error_state_indicator, fd.dlc) == (True, True, True, 12)
    assert bytes(fd.data) == bytes(range(12))


def test_a_foreign_command_with_our_own_data_is_no_confirmation(make: Callable[..., Rig]) -> None:
    rig = make()
    rig.bus.echo = False
    take_over(rig)
    rig.tick(1.0)
    rig.arrive(VALVE, bytes(rig.bus.sent[0].data))  # is_rx: another program, the very same bytes
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == rig.count("foreign_commands") == 1
    assert rig.driver.left()[0] != rig.driver.left()[0], "not confirmed: nan"
    rig.bus.incoming.append(rig.bus.sent[0])
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 1
    assert rig.driver.left()[0] == rig.driver.left()[0]


def test_what_a_foreign_command_says_is_told(make: Callable[..., Rig]) -> None:
    rig = make()
    assert rig.driver.tell_foreign() == ""
    rig.arrive(VALVE, valve(5.0, 3))
    rig.driver.read(rig.clock.t)
    assert "another node" in rig.driver.tell_foreign()
    assert "Valve (id 0x201): voltage 5 V" in rig.driver.tell_foreign()
    rig.arrive(VALVE, b"\1\2")
    rig.driver.read(rig.clock.t)
    assert "Valve (id 0x201): 2 bytes 01 02" in rig.driver.tell_foreign()
    assert rig.driver.foreign_commands == 2


def test_neutral_after_a_foreign_command_reaches_a_rig_that_went_on_from_its_counter(
    make: Callable[..., Rig],
) -> None:
    rig = make()
    take_over(rig)
    for _ in range(3):
        rig.tick(1.0)
    rig.arrive(VALVE, valve(5.0, 10))
    rig.driver.read(rig.clock.t)
    rig.tick()
    cycle = rig.bus.commands()[3:]
    assert [volts for volts, _ in cycle] == [0.0] * 16
    assert [counter for _, counter in cycle] == [(3 + k) % 16 for k in range(16)]
    rig.tick()
    assert rig.bus.commands()[19:] == [(0.0, 3)], "then one a tick again"
    for _ in range(20):  # a node that goes on commanding cannot make us flood the bus
        rig.arrive(VALVE, valve(5.0, 10))
        rig.driver.read(rig.clock.t)
        rig.tick()
    assert len(rig.bus.commands()) == 40


def test_neutral_of_the_supervisor_is_not_foreign_while_it_hands_over(make: Callable[..., Rig]) -> None:
    rig = make()
    rig.arrive(VALVE, valve(0.0, 7))
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 0
    rig.arrive(VALVE, valve(0.1, 7))
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 1, "a command that moves is nobody's neutral"
    take_over(rig)
    rig.arrive(VALVE, valve(0.0, 7))
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 2, "nobody else holds the rig now, and our commands are undone"


@pytest.mark.parametrize("interface", sorted(ECHOES))
def test_our_own_frames_that_come_back_late_are_ours(make: Callable[..., Rig], interface: str) -> None:
    rig = make(interface=interface)
    take_over(rig)
    rig.bus.echo = False
    for volts in (1.0, 2.0, 3.0):
        rig.tick(volts)
    back = [can.Message(arbitration_id=VALVE, is_extended_id=False, data=m.data) for m in rig.bus.sent]
    for message in back:
        message.is_rx = ECHOES[interface] == "plain"
    rig.bus.incoming.extend([back[2], back[0], back[1]])
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 0
    rig.bus.incoming.append(can.Message(arbitration_id=VALVE, is_extended_id=False, data=valve(9.0)))
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 1


@pytest.mark.parametrize("echo", ["local", "plain"])
def test_one_frame_more_than_we_sent_is_foreign(make: Callable[..., Rig], echo: str) -> None:
    rig = make(interface={"local": "kvaser", "plain": "udp_multicast"}[echo])
    take_over(rig)
    rig.bus.echo = False
    rig.tick(1.0)
    ours = rig.bus.sent[0]
    ours.is_rx = echo == "plain"
    rig.bus.incoming.extend([ours, ours])
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 1


@pytest.mark.parametrize("interface", ["slcan", "serial", "socketcand", "ixxat", "made_elsewhere"])
def test_where_nothing_comes_back_each_of_our_commands_is_foreign(
    make: Callable[..., Rig], interface: str
) -> None:
    rig = make(interface=interface)
    assert "receive_own_messages" not in rig.asked[0]
    take_over(rig)
    rig.bus.echo = False
    for _ in range(100):
        rig.tick(1.0)
    assert rig.driver.trouble == ""
    assert rig.driver.foreign_commands == 0
    rig.arrive(VALVE, valve(1.0))
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 1


def test_the_rig_file_may_say_that_an_interface_hands_frames_back(make: Callable[..., Rig]) -> None:
    rig = make(interface="made_elsewhere", echo=True)
    assert rig.asked[0]["receive_own_messages"] is True
    rig.bus.echo = False
    rig.tick(1.0)
    rig.arrive(VALVE, bytes(rig.bus.sent[0].data))
    rig.driver.read(rig.clock.t)
    assert rig.driver.foreign_commands == 0
    assert rig.driver.left() == [rig.clock.t]


@settings(max_examples=60)
@given(st.lists(st.sampled_from(["send", "echo", "swap", "foreign", "fail"]), max_size=50), st.booleans())
def test_frames_of_ours_and_of_others_against_a_plain_count(steps: list[str], plain: bool) -> None:
    """Any order of sends, of echoes early, late and out of order, of failures and of foreign frames."""
    with pytest.MonkeyPatch.context() as patch:
        rig = Rig(patch, interface="udp_multicast" if plain else "kvaser", max_in_flight=100)
        take_over(rig)
        rig.bus.echo = False
        pending: list[can.Message] = []
        foreign = number = 0
        for step in steps:
            before = len(rig.bus.sent)
            if step == "send":
                number += 1
                rig.tick(0.001 * number)
            elif step == "fail":
                rig.bus.incoming.append(can.CanOperationError("Network is down", 100))
                rig.tick()
            elif step == "foreign":
                foreign += 1
                rig.arrive(VALVE, valve(-5.0, foreign), is_rx=plain)
            elif pending:
                rig.bus.incoming.append(pending.pop(0 if step == "echo" else -1))
            pending += rig.bus.sent[before:]
            for message in pending:
                message.is_rx = plain
            if len(pending) > 25:  # more than are remembered
                rig.bus.incoming.append(pending.pop(0))
            rig.driver.read(rig.clock.t)
        assert rig.driver.foreign_commands == foreign
        data = Counter(bytes(m.data) for m in rig.bus.sent)
        assert set(data.values()) <= {1, 2}, "the frames are told apart by their counters"
        rig.driver.close()
