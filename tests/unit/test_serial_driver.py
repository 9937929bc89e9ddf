"""The serial driver against a board on a pseudo terminal: what goes wrong on lines, and how it ends."""

from __future__ import annotations

import math
import os
import select
import time
from typing import TYPE_CHECKING

import pytest

from drivers.base import DriverError
from drivers.neutral import SerialNeutral, open_neutral
from drivers.serial import SerialDriver
from drivers.serial_counters import COUNTER_NAMES
from drivers.serial_frame import COMMAND, HELLO, SAMPLE, BoardSample, Splitter, decode, encode, hello
from drivers.serial_handshake import Handshake
from drivers.serial_inputs import SerialInputs
from tests.unit.serial_bench import BoardPeer, SerialBench, make_options, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def bench() -> Iterator[SerialBench]:
    bench = SerialBench(time.monotonic)
    yield bench
    bench.driver.close()
    bench.close()


@pytest.fixture
def running(bench: SerialBench) -> SerialBench:
    bench.run()
    bench.sample(0.0)
    bench.read()
    return bench


# What comes in


def test_a_sample_in_units_at_its_boards_time(running: SerialBench) -> None:
    before = time.monotonic()
    running.sample(-0.12345)
    value, t = running.read()
    assert value == pytest.approx(-0.12345, abs=1e-9)
    assert before - 1e-3 <= t <= time.monotonic()


def test_many_samples_in_one_read_keep_their_times(running: SerialBench) -> None:
    for _ in range(50):  # the offset of the clocks is known as well as the quickest of these
        running.sample(0.0)
        running.read()
    first = time.monotonic()
    until(lambda: time.monotonic() > first + 0.008)
    frames = [running.peer.frame(0.001 * k, first + 0.002 * k) for k in range(5)]
    running.peer.send(b"".join(frames[:-1]))
    _, earlier = running.read()
    running.peer.send(frames[-1])
    value, t = running.read()
    assert value == pytest.approx(0.004)
    assert t - earlier == pytest.approx(0.002, abs=1e-4)
    assert running.count("samples") == 56


def test_gaps_and_repeats_of_the_sequence_are_counted(running: SerialBench) -> None:
    frames = [running.peer.frame(0.01 * k) for k in range(5)]
    running.peer.send(frames[0] + frames[3] + frames[3] + frames[4])
    value, _ = running.read()
    assert value == pytest.approx(0.04)
    assert (running.count("lost"), running.count("repeated")) == (2, 1)


def test_any_garbage_between_frames_costs_only_what_it_hits(running: SerialBench) -> None:
    first, second = running.peer.frame(0.1), running.peer.frame(0.2)
    running.peer.send(first + os.urandom(600).replace(b"\0", b"\1") + b"\0" + second)
    value, _ = running.read()
    assert value == pytest.approx(0.2)
    assert running.count("samples") == 3
    assert running.count("bad_frames") + running.count("crc_errors") + running.count("garbage_bytes") > 0


def test_a_damaged_frame_is_a_crc_error_and_a_gap(running: SerialBench) -> None:
    damaged = bytearray(running.peer.frame(0.1))
    damaged[8] ^= 0x04 if damaged[8] != 0x04 else 0x08
    running.peer.send(bytes(damaged) + running.peer.frame(0.2))
    running.read()
    assert running.count("crc_errors") + running.count("bad_frames") == 1
    assert running.count("lost") == 1


@pytest.mark.parametrize("frame", [encode(0x55, 0, b""), encode(SAMPLE, 0, b"short"), encode(HELLO, 0, b"")])
def test_a_whole_frame_that_makes_no_sense_is_counted(running: SerialBench, frame: bytes) -> None:
    running.peer.send(frame)
    running.read()
    assert running.count("bad_frames") == 1


def test_a_sample_that_was_long_on_its_way_is_late(running: SerialBench) -> None:
    old = running.peer.frame(0.1)
    deadline = time.monotonic() + 0.02
    while time.monotonic() < deadline:
        running.read()
    before = running.count("late")
    running.peer.send(old)
    running.read()
    assert running.count("late") == before + 1


def test_what_the_board_says_of_itself_is_counted(running: SerialBench) -> None:
    running.peer.board.dropped()
    running.sample(0.0)
    running.read()
    assert running.count("board_drops") == 1
    running.driver.write(time.monotonic(), [1.0])
    running.commands()
    running.sample(0.0)
    running.read()
    assert running.count("watchdog_trips") == 0
    late = time.monotonic() + 0.06  # no command for longer than the board's watchdog waits
    running.peer.send(running.peer.frame(0.0, late))
    running.read()
    assert running.count("watchdog_trips") == 1


def test_a_line_on_which_nothing_came_is_neither_read_nor_looked_at(
    running: SerialBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both wait for the kernel's worker, which has no real-time priority."""
    fd, looked_at = running.driver._link._fd, []  # type: ignore[attr-defined]
    read, wait = os.read, select.select
    monkeypatch.setattr(os, "read", lambda at, n: (looked_at.append(at), read(at, n))[1])
    monkeypatch.setattr(select, "select", lambda i, *rest: (looked_at.extend(i), wait(i, *rest))[1])
    for _ in range(20):
        running.read()
        running.driver.wait(time.monotonic() + 1e-4)
    assert fd not in looked_at
    running.sample(0.5)
    assert running.read()[0] == pytest.approx(0.5)
    assert fd in looked_at


# What goes out


def test_when_a_command_was_set_is_what_the_board_says(running: SerialBench) -> None:
    for k in range(5):
        before = running.driver.write(time.monotonic(), [0.1 * k])
        running.commands()
        running.sample(0.0)
        running.read()
        (left,) = running.driver.left()
        assert before <= left <= time.monotonic()


def test_a_command_that_is_not_acknowledged_yet_is_taken_as_usual(running: SerialBench) -> None:
    running.driver.write(time.monotonic(), [1.0])
    assert math.isnan(running.driver.left()[0])  # nothing is known yet
    running.commands()
    running.sample(0.0)
    running.read()
    latency = running.driver.left()[0]
    before = running.driver.write(time.monotonic(), [1.0])
    assert before <= running.driver.left()[0] <= time.monotonic()
    assert latency < before


def test_values_are_held_within_what_the_line_carries(running: SerialBench) -> None:
    running.driver.write(time.monotonic(), [1e6])
    assert running.commands() == [[pytest.approx(32.767)]]


def test_commands_in_flight_are_bounded_and_neutral_still_goes(running: SerialBench) -> None:
    running.peer.deaf = True
    for _ in range(40):
        running.driver.write(time.monotonic(), [1.0])
    assert running.count("commands") == 16
    assert running.count("deferred") == 24
    assert math.isfinite(running.driver.neutral(time.monotonic()))
    until(lambda: sent(running.peer)[-1:] == [0])


def sent(peer: BoardPeer) -> list[int]:
    """First output of each whole command that is on the line, as its number."""
    frames = [decode(each) for each in Splitter(b"\0", 400).feed(peer.raw) if each]
    return [int.from_bytes(frame.body, "little", signed=True) for frame in frames if frame.type == COMMAND]


def test_a_board_that_acknowledges_nothing_is_trouble_until_it_takes_neutral(running: SerialBench) -> None:
    running.peer.deaf = True
    running.driver.write(time.monotonic(), [1.0])
    until(lambda: running.read() and "acknowledges no command" in running.driver.trouble)
    assert running.count("unconfirmed") == 1
    running.peer.deaf = False

    def mended() -> bool:
        running.driver.write(time.monotonic(), [2.0])
        running.sample(0.0)
        running.read()
        return running.driver.trouble == ""

    until(mended)
    numbers = sent(running.peer)
    assert numbers[0] == 1000
    assert numbers[1] == 0
    assert set(numbers[1:]) <= {0, 2000}


# Unplugged and back


def test_an_unplugged_port_is_told_and_taken_again_with_neutral_first(running: SerialBench) -> None:
    running.driver.write(time.monotonic(), [1.0])
    running.commands()
    running.peer.unplug()
    until(lambda: running.read() and running.driver.trouble)
    assert "is gone" in running.driver.trouble
    assert math.isnan(running.driver.write(time.monotonic(), [1.0]))
    running.peer.raw = b""
    running.peer.board = running.peer.new_board(clock_start=77)
    running.peer.plug_in()

    def back() -> bool:
        running.driver.write(time.monotonic(), [3.0])
        if running.peer.board.sampling:
            running.sample(0.5)
        return running.read()[0] == 0.5 and running.driver.trouble == ""

    until(back)
    running.driver.write(time.monotonic(), [3.0])
    until(lambda: 3000 in sent(running.peer))
    assert sent(running.peer)[0] == 0
    assert (running.count("unplugged"), running.count("reopened")) == (1, 1)
    assert running.count("handshakes") == 2
    assert running.read()[1] > time.monotonic() - 1.0


def test_another_board_in_its_place_is_refused_and_gets_no_command(running: SerialBench) -> None:
    running.peer.unplug()
    until(lambda: running.read() and running.driver.trouble)
    running.peer.options = make_options(running.peer.link, inputs=[{"name": "angle"}])
    running.peer.board = running.peer.new_board()
    running.peer.raw = b""
    running.peer.plug_in()

    def refused() -> bool:
        assert math.isnan(running.driver.write(time.monotonic(), [3.0]))
        assert math.isnan(running.driver.neutral(time.monotonic()))
        running.read()
        return "layout f/h" in running.driver.trouble

    until(refused)
    refused()
    assert sent(running.peer) == []


def test_a_board_that_stopped_sampling_is_started_again(running: SerialBench) -> None:
    running.peer.board = running.peer.new_board()  # it restarted: silent until START
    until(lambda: running.read() and running.count("handshakes") == 2)
    until(lambda: running.read() and running.peer.board.sampling)


# Opening


def test_a_port_that_is_not_there_names_those_that_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "usb-Teensy").touch()
    monkeypatch.setattr("drivers.serial_link.BY_ID", tmp_path)
    driver = SerialDriver(make_options(tmp_path / "no"), time.monotonic)
    with pytest.raises(DriverError, match=r"no such port; by stable names there are: .*usb-Teensy"):
        driver.open(["angle"], ["valve"])


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    driver = SerialDriver(make_options(tmp_path / "file"), time.monotonic)
    with pytest.raises(DriverError, match="no serial port"):
        driver.open(["angle"], ["valve"])


def test_a_port_that_another_daemon_has_is_left_alone(running: SerialBench) -> None:
    second = SerialDriver(running.options, time.monotonic)
    with pytest.raises(DriverError, match="another program has it"):
        second.open(["angle"], ["valve"])


def test_a_silent_board_is_told(bench: SerialBench) -> None:
    bench.peer.deaf = True
    driver = SerialDriver(bench.options.model_copy(update={"handshake_s": 0.3}), time.monotonic)
    with pytest.raises(DriverError, match=r"sent no HELLO for 0\.3 s, nor anything else: is it switched on"):
        driver.open(["angle"], ["valve"])


@pytest.mark.parametrize(
    ("sent", "says"),
    [
        (
            b"Grbl 1.1h ['$' for help]\r\n",
            r"but \d+ other bytes, at first b\"Grbl 1\.1h .*driver.format ascii",
        ),
        (
            encode(HELLO, 0, bytes(8) + b"\xff\xfe/h\0x"),
            "the last of them a HELLO whose layout .* is no text",
        ),
        (encode(HELLO, 0, b"\1\0"), "the last of them a HELLO of 2 bytes"),
    ],
)
def test_a_stranger_on_the_line_is_told_by_what_it_sends(bench: SerialBench, sent: bytes, says: str) -> None:
    bench.peer.deaf = True
    driver = SerialDriver(bench.options.model_copy(update={"handshake_s": 0.3}), time.monotonic)
    ask = driver._link.send
    driver._link.send = lambda data: ask(data) and bench.peer.send(sent) is None  # type: ignore[method-assign]
    with pytest.raises(DriverError, match=says):
        driver.open(["angle"], ["valve"])


def test_a_name_in_another_encoding_is_no_reason_to_refuse_a_board(bench: SerialBench) -> None:
    body = hello(1, "iB/h", 2000.0, 0.05, "")[:-1]
    named = decode(body).body + "Prüfstand".encode("latin-1")
    bench.peer.board._form.hello = lambda: encode(HELLO, 0, named)  # type: ignore[method-assign]
    bench.driver.open(bench.inputs, bench.outputs)


def test_what_is_odd_is_told_once_and_when_it_is_over(running: SerialBench) -> None:
    notices = ["", "sends 99.9", "sends 100.1", "", ""]
    for running.driver._inputs.notice in notices:  # type: ignore[attr-defined]
        running.read()
    assert [why for _, why in running.driver.remarks] == [
        "sends 99.9",
        "the board's samples are in order again",
    ]


@pytest.mark.parametrize(("rate_hz", "says"), [(200.0, "2000"), (20000.0, "2000"), (2000.0, "")])
def test_a_board_at_another_rate_is_told_with_both_rates_and_the_key(rate_hz: float, says: str) -> None:
    taken = SerialInputs(make_options(rate_hz=rate_hz), ("angle",), 0.0, [0] * len(COUNTER_NAMES))
    for k in range(6000):
        now = 100.0 + k / 2000.0
        taken.take(BoardSample(k % 256, 500 * k, 0, None, None, [0.0, 1.0]), now)
        taken.looked(now)
    if says:
        assert f"sends {says} samples/s, driver.rate_hz is {rate_hz:g}" in taken.notice
    else:
        assert taken.notice == ""


HELLO_OF = {"version": 1, "layout": "iB/h", "rate_hz": 2000.0, "watchdog_s": 0.05, "name": "toy"}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"version": 2}, "toy speaks version 2 of the line, seod 1"),
        ({"layout": "i/h"}, "toy has the layout i/h, the rig file iB/h"),
        ({"watchdog_s": 0.2}, r"waits 0\.2 s for a command"),
        ({"rate_hz": 1000.0}, "samples at 1000 Hz, driver.rate_hz is 2000"),
    ],
)
def test_a_board_that_is_not_the_rig_files_is_refused(
    bench: SerialBench, change: dict[str, object], why: str
) -> None:
    bench.peer.board._form.hello = lambda: hello(**{**HELLO_OF, **change})  # type: ignore[method-assign, arg-type]
    with pytest.raises(DriverError, match=why):
        bench.driver.open(bench.inputs, bench.outputs)
    bench.peer.board = bench.peer.new_board()
    bench.driver.open(bench.inputs, bench.outputs)


def test_the_handshake_asks_again_and_again() -> None:
    shake = Handshake(make_options(handshake_s=1.0), [0] * 30)
    shake.begin(10.0)
    due = [shake.due(10.0 + 0.05 * k) for k in range(5)]
    assert due == ["ask", "", "ask", "", "ask"]
    assert shake.trouble(10.5, "") == ""
    assert "sent no HELLO" in shake.trouble(11.5, "")


# Another process' neutral


def test_neutral_by_another_process_ends_a_torn_frame_and_is_new(running: SerialBench) -> None:
    running.driver.write(time.monotonic(), [5.0])
    running.commands()
    writer = open_neutral(running.driver.neutral_recipe())
    running.driver._link.send(b"\x05\x83torn")  # type: ignore[attr-defined]  # the loop died within a frame
    assert writer.write(1) == ""
    writer.close()
    until(lambda: running.peer.values[-1] == [0.0])


def test_neutral_on_a_port_that_is_gone_says_so(running: SerialBench) -> None:
    writer = open_neutral(running.driver.neutral_recipe())
    assert isinstance(writer, SerialNeutral)
    running.peer.unplug()
    assert writer.write(1) != ""
    running.peer.plug_in()
    assert writer.write(1) == ""
    writer.close()


# Lines of text


@pytest.fixture
def text() -> Iterator[SerialBench]:
    bench = SerialBench(
        time.monotonic, format="ascii", fields=["time", "sequence", "ack", "age", "angle", "enable"]
    )
    yield bench
    bench.driver.close()
    bench.close()


def test_the_same_in_ascii(text: SerialBench) -> None:
    text.run()
    text.sample(0.0)  # the first line is left out: its beginning may be missing
    text.sample(0.25)
    assert text.read()[0] == pytest.approx(0.25)
    text.driver.write(time.monotonic(), [1.25])
    assert text.commands() == [[pytest.approx(1.25)]]
    text.peer.send(text.peer.frame(0.5).replace(b",", b",9", 1))
    text.read()
    assert text.count("crc_errors") == 1
    assert b"start\n" in text.peer.raw


def test_a_board_that_only_prints_numbers() -> None:
    bench = SerialBench(time.monotonic, format="ascii", fields=["angle", "enable"])
    try:
        bench.run()
        for line in (b"123\n", b"1000,1\n", b"2000,1\r\n"):
            bench.peer.send(line)
        before = time.monotonic()
        value, t = bench.read()
        assert value == pytest.approx(0.02)
        assert before <= t <= time.monotonic()
        assert bench.driver.trouble == ""
        assert math.isfinite(bench.driver.write(time.monotonic(), [1.0]))
        assert bench.driver.trouble == ""  # it acknowledges nothing, and need not
    finally:
        bench.driver.close()
        bench.close()
