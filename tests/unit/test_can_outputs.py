"""What leaves the CAN driver: commands, confirmed and bounded, neutral, fixed frames."""

from __future__ import annotations

import errno
import math
from typing import TYPE_CHECKING

import can
import pytest

from tests.unit.can_bench import CODEC, VALVE, Rig, rigs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    yield from rigs(monkeypatch)


@pytest.fixture
def rig(make: Callable[..., Rig]) -> Rig:
    return make()


def test_each_command_has_the_next_counter_and_its_confirmed_time(rig: Rig) -> None:
    for volts in (1.0, 2.0):
        rig.tick(volts)
    assert rig.bus.commands() == [(1.0, 0), (2.0, 1)]
    assert rig.driver.commands_sent == 2
    assert math.isnan(*rig.driver.left())  # the echo of the last one was not read yet
    rig.driver.read(rig.clock.t)
    assert rig.driver.left() == [rig.clock.t]


def test_in_flight_is_bounded_and_the_newest_command_goes_next(rig: Rig) -> None:
    rig.bus.echo = False
    for volts in (1.0, 2.0, 3.0, 4.0, 5.0):
        rig.tick(volts)
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 2.0, 3.0]
    assert rig.count("deferred") == 2
    rig.bus.incoming.append(rig.bus.sent[0])
    rig.driver.wait(rig.clock.t + 0.001)
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 2.0, 3.0, 5.0]


def test_neutral_has_a_reserved_place_and_drops_what_waits(rig: Rig) -> None:
    rig.bus.echo = False
    for volts in (1.0, 2.0, 3.0, 4.0):
        rig.tick(volts)
    assert math.isfinite(rig.tick())
    assert rig.bus.commands()[-1] == (0.0, 3)
    rig.bus.incoming.extend(rig.bus.sent)
    rig.driver.wait(rig.clock.t + 0.001)
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 2.0, 3.0, 0.0]


def test_without_echo_nothing_is_bounded(make: Callable[..., Rig]) -> None:
    rig = make(echo=False)
    rig.bus.echo = False
    for _ in range(200):
        rig.tick(1.0)
    assert len(rig.bus.commands()) == 200
    assert rig.driver.trouble == ""
    assert math.isnan(*rig.driver.left())


def test_commands_that_do_not_leave_are_trouble_until_they_do(rig: Rig) -> None:
    rig.bus.echo = False
    for _ in range(1500):
        rig.tick(1.0)
    assert len(rig.bus.sent) <= 7  # attempts become rarer: all of them will leave one day
    assert "do not leave the bus" in rig.driver.trouble
    assert rig.count("unconfirmed") == 1
    assert {volts for volts, _ in rig.bus.commands()[3:]} == {0.0}  # only neutral tries the bus
    rig.bus.echo = True
    rig.bus.incoming.extend(rig.bus.sent)
    before = len(rig.bus.sent)
    rig.tick(2.0)
    assert rig.driver.trouble == ""
    rig.tick(3.0)
    assert [volts for volts, _ in rig.bus.commands()[before:]] == [0.0, 3.0]


def test_lost_echoes_do_not_hold_the_commands_for_ever(rig: Rig) -> None:
    rig.bus.echo = False
    for _ in range(4):
        rig.tick(1.0)
    rig.bus.echo = True
    for _ in range(600):
        rig.tick(1.0)
    assert rig.driver.trouble == ""
    assert rig.bus.commands()[-1][0] == 1.0


def test_another_node_that_sends_our_commands_is_counted(rig: Rig) -> None:
    rig.arrive(VALVE, CODEC.encode("Valve", {"voltage": 5.0}, 3))
    rig.driver.read(rig.clock.t)
    assert rig.count("foreign_commands") == 1
    assert math.isnan(*rig.driver.left())


def test_a_full_queue_is_counted_and_no_failure(rig: Rig) -> None:
    for error in (
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),
    ):
        rig.bus.send_error = error
        assert math.isnan(rig.tick(1.0))
    rig.bus.send_error = None
    assert math.isfinite(rig.tick(2.0))
    assert rig.bus.commands() == [(2.0, 0)]
    assert rig.count("no_buffers") == 2
    assert rig.driver.trouble == ""


def test_close_gives_a_neutral_command_without_room_a_moment(rig: Rig) -> None:
    rig.bus.send_error = can.CanOperationError("full", errno.ENOBUFS)
    rig.tick()
    rig.bus.send_error = None
    bus = rig.bus
    rig.driver.close()
    assert bus.commands() == [(0.0, 0)]
    assert bus.closed


def test_start_tick_and_heartbeat_frames(make: Callable[..., Rig]) -> None:
    rig = make(
        start_frames=[{"id": 0, "data": "01 00"}],
        tick_frames=[{"id": 0x80}],
        heartbeat=[{"id": 0x701, "data": "05", "period_s": 0.01}],
    )
    assert [(m.arbitration_id, bytes(m.data)) for m in rig.bus.sent] == [(0, b"\x01\x00")]
    for _ in range(100):
        rig.tick()
    sent = [message.arbitration_id for message in rig.bus.sent]
    assert sent.count(0x80) == 100
    assert sent.count(0x701) in (10, 11)


def test_values_of_the_neutral_command_are_those_given_at_opening(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(monkeypatch)
    rig.driver.close()
    rig.driver.open([], ["Valve.voltage"], [2.5])
    rig.driver.start()
    rig.tick()
    assert rig.bus.commands() == [(2.5, 0)]
    first = rig.driver.neutral_recipe()["frames"][0][0]
    assert CODEC.decode(VALVE, False, bytes.fromhex(first["data"])).values["voltage"] == 2.5
    rig.driver.close()
