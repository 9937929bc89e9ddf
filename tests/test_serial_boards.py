"""The daemon on a line whose other end is a board written from docs/serial.md alone (`text_board.py`)."""

from __future__ import annotations

import re
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import pytest

from tests.peers import Rpc, RpcError, until
from tests.test_serial import Daemon, write_rig_file

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.processes

BOARD = Path(__file__).with_name("text_board.py")
OMEGA_N, ZETA = 95.0, 0.35


def text_rig_file(folder: Path) -> Path:
    """The shipped serial rig with lines of text, 1000 a second."""
    path = write_rig_file(folder)
    text = path.read_text()
    for old, new in (
        ("format: binary", "format: ascii\n  fields: [time, sequence, ack, age, angle, run_enable]"),
        ("rate_hz: 2000                   # samples", "rate_hz: 1000                   # samples"),
        ("scale: 1.0e-5, ", ""),
        ("scale: 1.0e-3, ", ""),
    ):
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text)
    return path


@contextmanager
def board(rig_file: Path, *options: str) -> Iterator[None]:
    words = [
        sys.executable,
        BOARD,
        rig_file.with_name("board"),
        "--omega-n",
        str(OMEGA_N),
        "--zeta",
        str(ZETA),
    ]
    process = subprocess.Popen([*words, *options], stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"ready\n"
        yield
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


@contextmanager
def daemon(rig_file: Path) -> Iterator[Daemon]:
    made = Daemon(rig_file)
    try:
        yield made
    finally:
        made.close()


def estimates(rpc: Rpc, noisy: int) -> list[dict[str, Any]]:
    """Until so many of them are noisy."""
    told: list[dict[str, Any]] = []
    while sum(each["quality"] == "noisy" for each in told) < noisy:
        told.append(rpc.wait_for("an estimate", lambda m: m.get("method") == "estimate")["params"])
    return told


def test_a_clock_that_jitters_is_told_and_its_answers_are_called_noisy(tmp_path: Path) -> None:
    rig_file = text_rig_file(tmp_path)
    with board(rig_file, "--jitter", "2.5e-3"), daemon(rig_file) as run:
        line = run.rpc.event(event="warning", code="line")
        assert "the board's times jitter by 2" in line["why"]
        run.rpc.call("start")
        told = estimates(run.rpc, 40)
        health = run.rpc.call("status")["health"]
    assert health["stamp_common_sd_s"] == pytest.approx(2.5e-3, rel=0.5)
    noisy = [each for each in told if each["quality"] == "noisy"]
    # Where a busy machine was late with a tick, a window begins anew.
    assert {each["quality"] for each in told} <= {"noisy", "settling", "stale", "no_oscillation"}
    assert all("times of samples scatter by" in each["advice"] for each in noisy[-20:])
    assert median(each["omega_n"] for each in noisy) == pytest.approx(OMEGA_N, rel=0.2)


def test_a_board_whose_clock_begins_anew_is_gone_on_with(tmp_path: Path) -> None:
    rig_file = text_rig_file(tmp_path)
    with board(rig_file, "--back-at", "4", "--back-by", "3"), daemon(rig_file) as run:
        until("a sample", lambda: run.counter("samples"))
        run.rpc.call("start")
        until("the step", lambda: run.counter("clock_resets") == 1)
        run.estimates(5)
        assert run.counter("clock_resets") == 1


def test_a_silent_board_is_told_as_that_and_not_as_an_estop(tmp_path: Path) -> None:
    rig_file = text_rig_file(tmp_path)
    with board(rig_file, "--silent"), daemon(rig_file) as run:
        told = until("what the board lacks", lambda: link_refusal(run.rpc))
        assert "is it switched on" in told


def link_refusal(rpc: Rpc) -> str:
    """Why the rig does not start, once the board has had its time; before that nothing has come from it."""
    with pytest.raises(
        RpcError, match=r"nothing has come from the rig since|sent no sample for 3 s"
    ) as refused:
        rpc.call("start")
    return str(refused.value) if "nor anything else" in str(refused.value) else ""


def test_a_board_at_a_tenth_of_its_rate_is_told_with_both_rates(tmp_path: Path) -> None:
    rig_file = text_rig_file(tmp_path)
    with board(rig_file, "--rate", "100"), daemon(rig_file) as run:
        line = run.rpc.event(event="warning", code="line")
        assert re.search(r"sends [\d.]+ samples/s, driver.rate_hz is 1000: write driver.rate_hz", line["why"])
