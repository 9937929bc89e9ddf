"""The CAN driver's options, and the whole of it over python-can within this process."""

from __future__ import annotations

import itertools
import math
import time
from typing import TYPE_CHECKING

import can
import pytest

from drivers.base import DriverError
from drivers.can import CanDriver
from tests.unit.can_bench import options

if TYPE_CHECKING:
    from pathlib import Path

CHANNELS = itertools.count()


def test_a_bus_that_cannot_be_had_says_what_to_do() -> None:
    driver = CanDriver(options(interface="socketcan", channel="nocan7"), time.monotonic)
    with pytest.raises(DriverError, match=r"socketcan channel 'nocan7'.*ip link add vcan0"):
        driver.open(["Encoder.angle"], ["Valve.voltage"])
    driver.close()


def test_channels_of_the_wrong_direction_and_fd_messages_are_refused(tmp_path: Path) -> None:
    driver = CanDriver(options(), time.monotonic)
    with pytest.raises(DriverError, match=r"no output channel 'Encoder\.angle'.*Valve\.voltage"):
        driver.open([], ["Encoder.angle"])
    (tmp_path / "fd.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: seod rig\nBO_ 300 Long: 12 rig\n SG_ a : 0|8@1+ (1,0) [0|0] "" seod\n'
    )
    driver = CanDriver(options(tmp_path, dbc="fd.dbc"), time.monotonic)
    with pytest.raises(DriverError, match=r"Long is an FD message: set driver\.fd: true"):
        driver.open(["Long.a"], [])


def test_fd_frames_and_several_messages_over_python_can(tmp_path: Path) -> None:
    (tmp_path / "fd.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: seod rig\nBO_ 300 Long: 10 rig\n'
        ' SG_ a : 64|16@1+ (1,0) [0|0] "" seod\n\n'
        'BO_ 301 First: 10 seod\n SG_ u : 0|16@1- (1,0) [0|0] "V" rig\n\n'
        'BO_ 2147484188 Second: 2 seod\n SG_ v : 0|16@1- (1,0) [0|0] "V" rig\n'
    )
    channel = f"fd{next(CHANNELS)}"
    peer = can.Bus(interface="virtual", channel=channel, ignore_config=True)
    driver = CanDriver(
        options(tmp_path, dbc="fd.dbc", channel=channel, fd=True, data_bitrate=5_000_000), time.monotonic
    )
    driver.open(["Long.a"], ["First.u", "Second.v"])
    driver.start()
    peer.send(
        can.Message(arbitration_id=300, is_extended_id=False, is_fd=True, data=bytes(8) + b"\x07" + bytes(3))
    )
    assert driver.read(time.monotonic())[0].value == 7
    driver.write(time.monotonic(), [3.0, -3.0])
    first, second = peer.recv(1), peer.recv(1)
    assert first is not None
    assert second is not None
    assert (first.is_fd, first.bitrate_switch, len(first.data), first.data[0]) == (True, True, 12, 3)
    assert (second.is_fd, second.is_extended_id, second.arbitration_id) == (False, True, 540)
    assert all(math.isnan(t) for t in driver.left())
    driver.read(time.monotonic())
    assert driver.left()[0] < driver.left()[1] <= time.monotonic()
    driver.close()
    peer.shutdown()
