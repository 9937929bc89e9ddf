"""When the bus fails: down, gone, off, and back again."""

from __future__ import annotations

import errno
import time
from typing import TYPE_CHECKING

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.can_errors import bus_event
from tests.unit.can_bench import VALVE, Rig, down, rigs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    yield from rigs(monkeypatch)


@pytest.fixture
def rig(make: Callable[..., Rig]) -> Rig:
    return make()


def test_after_an_interface_was_down_the_first_frame_is_neutral(make: Callable[..., Rig]) -> None:
    rig = make(start_frames=[{"id": 0, "data": "01 00"}], tick_frames=[{"id": 0x80}])
    rig.tick(1.0)
    rig.bus.send_error = down()
    for _ in range(30):
        rig.tick(2.0)
    assert "can0 is down: `ip link set can0 up`" in rig.driver.trouble
    assert rig.count("interface_down") == 1
    assert rig.count("send_errors") <= 6  # it is not tried at each tick
    before = len(rig.bus.sent)
    rig.bus.send_error = None
    for _ in range(30):
        rig.tick(3.0)
    after = rig.bus.sent[before:]
    assert [m.arbitration_id for m in after[:2]] == [VALVE, 0]
    volts = [volts for volts, _ in rig.bus.commands()[1:]]
    assert volts[0] == 0.0
    assert set(volts[1:]) == {3.0}
    assert rig.driver.trouble == ""


def test_an_interface_that_goes_down_is_noticed_by_reading(rig: Rig) -> None:
    rig.bus.incoming.append(can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN))
    rig.driver.read(rig.clock.t)
    assert "is down" in rig.driver.trouble
    rig.tick(1.0)
    assert rig.bus.commands() == [(0.0, 0)]


@pytest.mark.parametrize("code", [errno.ENODEV, errno.ENXIO])
def test_a_deleted_interface_is_taken_again_at_a_bounded_rate(rig: Rig, code: int) -> None:
    rig.tick(1.0)
    rig.bus.send_error = can.CanOperationError("Failed to transmit: no such device", code)
    rig.open_error = OSError(errno.ENODEV, "No such device")
    for _ in range(1000):
        rig.tick(2.0)
    assert "is gone" in rig.driver.trouble
    assert rig.buses[0].closed
    assert rig.attempts <= 4  # one at the start, then two a second
    rig.open_error = None
    for _ in range(600):
        rig.tick(3.0)
    assert len(rig.buses) == 2
    assert rig.count("reopened") == 1
    assert rig.driver.trouble == ""
    assert rig.bus.commands()[0][0] == 0.0
    assert rig.bus.commands()[-1][0] == 3.0


def test_waiting_on_a_bus_that_is_gone_takes_its_time(rig: Rig) -> None:
    rig.bus.incoming.append(can.CanOperationError("gone", errno.ENODEV))
    rig.driver.read(rig.clock.t)
    began = time.monotonic()
    assert not rig.driver.wait(rig.clock.t + 0.02)
    assert time.monotonic() - began >= 0.02


def test_bus_off_holds_everything_until_the_restart(rig: Rig) -> None:
    rig.tick(1.0)
    rig.error_frame(0x40)
    for _ in range(20):
        rig.tick(2.0)
    assert "bus-off" in rig.driver.trouble
    assert len(rig.bus.commands()) == 1
    rig.error_frame(0x100)
    rig.tick(3.0)
    rig.tick(4.0)
    assert rig.driver.trouble == ""
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 0.0, 4.0]
    assert (rig.count("bus_off"), rig.count("restarted"), rig.count("error_frames")) == (1, 1, 2)


def test_taking_the_interface_down_and_up_ends_bus_off(rig: Rig) -> None:
    rig.error_frame(0x40)
    rig.tick(1.0)
    rig.bus.incoming.append(down())
    for _ in range(20):
        rig.tick(2.0)
    assert rig.driver.trouble == ""
    assert rig.bus.commands()[0][0] == 0.0
    assert rig.bus.commands()[-1][0] == 2.0


def test_an_interface_that_goes_while_it_is_off_the_bus_is_taken_again(rig: Rig) -> None:
    """Nobody tells a new socket that the new interface's controller is on the bus."""
    rig.error_frame(0x40)
    rig.tick(1.0)
    rig.bus.incoming.append(can.CanOperationError("no such device", errno.ENODEV))
    for _ in range(1000):
        rig.tick(2.0)
    assert rig.driver.trouble == ""
    assert rig.count("reopened") == 1
    assert rig.bus.commands()[-1][0] == 2.0


def test_what_a_failed_interface_held_is_not_waited_for(rig: Rig) -> None:
    rig.bus.echo = False
    for _ in range(3):
        rig.tick(1.0)
    rig.bus.send_error = down()
    rig.bus.incoming.append(down())
    for _ in range(200):
        rig.tick(2.0)
    rig.bus.send_error = None
    rig.bus.echo = True
    for _ in range(20):
        rig.tick(2.0)
    assert rig.count("unconfirmed") == 0
    assert rig.count("deferred") == 0
    assert rig.bus.commands()[-1][0] == 2.0


def test_bus_off_and_restart_between_two_ticks_still_means_neutral_first(rig: Rig) -> None:
    rig.tick(1.0)
    rig.error_frame(0x40)
    rig.error_frame(0x100)
    rig.tick(2.0)
    assert rig.bus.commands()[-1][0] == 0.0


def test_error_frames_are_counted_by_kind(rig: Rig) -> None:
    rig.error_frame(0x004, 0x08)
    rig.error_frame(0x004, 0x20)
    rig.error_frame(0x020)
    rig.error_frame(0x004, 0x01)
    rig.driver.read(rig.clock.t)
    names = ("error_warning", "error_passive", "ack_errors", "overflows", "error_frames")
    assert [rig.count(name) for name in names] == [1, 1, 1, 1, 4]
    assert rig.driver.trouble == ""


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_any_error_frame_can_be_decoded(classes: int, data: bytes) -> None:
    assert bus_event(classes, data).bus_off == bool(classes & 0x40)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 9), max_size=40))
def test_whatever_the_bus_does_nothing_raises_and_neutral_comes_first(events: list[int]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        rig = Rig(patch)
        for event in events:
            _happen(rig, event)
            sent, troubled = len(rig.bus.commands()), bool(rig.driver.trouble)
            rig.tick(5.0)
            if troubled and len(rig.bus.commands()) > sent:
                assert rig.bus.commands()[sent][0] == 0.0
        rig.driver.close()


def _happen(rig: Rig, event: int) -> None:
    if event < 4:
        code = (None, errno.ENETDOWN, errno.ENODEV, errno.ENOBUFS)[event]
        rig.bus.send_error = can.CanOperationError("fails", code) if code else None
    elif event == 4:
        rig.bus.incoming.append(down())
    elif event in (5, 6):
        rig.error_frame(0x40 if event == 5 else 0x100)
    elif event == 7:
        rig.bus.echo = not rig.bus.echo
    else:
        rig.clock.t += 0.2 * (event - 7)
