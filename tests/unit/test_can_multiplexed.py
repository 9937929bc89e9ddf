"""Commands in a multiplexed message: sent only if the multiplexer selects them."""

from __future__ import annotations

import itertools
import time
from typing import TYPE_CHECKING

import can
import pytest

from drivers.base import DriverError
from drivers.can import CanDriver
from seod.config.check import check
from seod.config.load import load_text
from tests.unit.can_bench import options

if TYPE_CHECKING:
    from pathlib import Path

DBC = """VERSION ""
NS_ :
BS_:
BU_: seod amp
BO_ 300 Cmd: 8 seod
 SG_ Page M : 0|4@1+ (1,0) [0|15] "" amp
 SG_ Volt m1 : 8|16@1- (0.001,0) [0|0] "V" amp
 SG_ Gain m2 : 8|16@1- (1,0) [0|0] "" amp
BO_ 301 Fb: 8 amp
 SG_ Page M : 0|4@1+ (1,0) [0|15] "" seod
 SG_ Pos m1 : 8|16@1- (0.001,0) [0|0] "rad" seod
 SG_ Temp m2 : 8|16@1- (1,0) [0|0] "" seod
"""
CHANNELS = itertools.count()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mux.dbc").write_text(DBC)
    return tmp_path


@pytest.mark.parametrize(("page", "words"), [(0, "Expected multiplexer id"), (2, "Page must be 1 for it")])
def test_a_command_that_would_never_go_out_is_refused(folder: Path, page: int, words: str) -> None:
    driver = CanDriver(options(folder, dbc="mux.dbc"), time.monotonic)
    with pytest.raises(DriverError, match=words):
        driver.open(["Fb.Pos"], ["Cmd.Volt", "Cmd.Page"], [0.0, float(page)])
    driver.close()


def test_with_its_page_it_goes_out_and_inputs_are_new_with_theirs_only(folder: Path) -> None:
    channel = f"mux{next(CHANNELS)}"
    driver = CanDriver(options(folder, dbc="mux.dbc", channel=channel), time.monotonic)
    with can.Bus(interface="virtual", channel=channel, ignore_config=True) as peer:
        driver.open(["Fb.Pos", "Fb.Temp"], ["Cmd.Volt", "Cmd.Page"], [0.0, 1.0])
        driver.start()
        driver.write(time.monotonic(), [1.5, 1.0])
        sent = peer.recv(1.0)
        assert sent is not None
        assert bytes(sent.data[:3]) == b"\x01\xdc\x05"
        for data in (b"\x01\xf4\x01", b"\x02\x50\x00", b"\x05\x00\x00"):
            peer.send(can.Message(arbitration_id=301, is_extended_id=False, data=data + bytes(5)))
        position, temperature = driver.read(time.monotonic())
        assert (position.value, temperature.value) == (0.5, 80.0)
        assert position.t < temperature.t
        assert driver.counters[driver.counter_names.index("unknown_frames")] == 1
    driver.close()


def test_check_refuses_it(folder: Path) -> None:
    text = """
version: 1
rig: mux
driver: {kind: can, channel: vcan0, dbc: mux.dbc}
sensors: {position: {channel: Fb.Pos, unit: rad}}
outputs: {valve: {channel: Cmd.Volt}}
axes:
  motor:
    sensor: position
    output: valve
    K_L: 17
    relay: {e_a: 0.1 V}
    limits: {output: 2 V, travel: [-1.2, 1.2], speed: 30 rad/s, amplitude: 1 rad, excitation: 600 s}
    polarity: {movement: 20 mrad}
guard: {rig_watchdog: 0.1 s}
"""
    (refusal,) = check(load_text(text, "mux.yaml", folder)).refusals
    assert "Cmd cannot be sent: Expected multiplexer id" in refusal
    told = text.replace("{channel: Cmd.Volt}", "{channel: Cmd.Volt, fixed: {Cmd.Page: 1}}")
    assert check(load_text(told, "mux.yaml", folder)).refusals == ()
