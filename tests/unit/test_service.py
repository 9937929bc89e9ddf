"""The unit's exposure, journal lines, neutral as the last thing, upgrade of rig files, the installer."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import seod.config.upgrade
import seod.launch.last_neutral
from seod.cli import app
from seod.config.load import load_rig
from seod.config.upgrade import UpgradeError, upgraded
from seod.launch.last_neutral import REPEATS, write_neutral
from seod.observe.rig import tell_journal
from seod.processes import journal
from tests.command_line import CliRunner

REPO = Path(__file__).parents[2]
CAN = REPO / "configs" / "can.yaml"
UNIT = REPO / "systemd" / "seod@.service"


def exposed(unit: Path, threshold: int) -> subprocess.CompletedProcess[str]:
    words = [
        "systemd-analyze",
        "security",
        "--offline=true",
        f"--threshold={threshold}",
        "--no-pager",
        str(unit),
    ]
    return subprocess.run(words, check=False, capture_output=True, text=True)


def test_the_unit_is_exposed_by_15_at_most(tmp_path: Path) -> None:
    done = exposed(UNIT, 15)
    assert done.returncode == 0, done.stdout + done.stderr
    loose = tmp_path / "seod@.service"
    loose.write_text(UNIT.read_text().replace("PrivateUsers=yes", "").replace("PrivateMounts=yes", ""))
    assert exposed(loose, 15).returncode != 0


def test_a_wrong_rig_file_ends_with_a_code_of_its_own(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("version: 1\n")
    assert CliRunner().invoke(app, ["run", str(wrong)]).exit_code == os.EX_CONFIG
    assert f"RestartPreventExitStatus={os.EX_CONFIG}" in UNIT.read_text()


# ---- the journal


def decoded(data: bytes) -> dict[str, str]:
    found = {}
    while data:
        name, _, rest = data.partition(b"\n")
        (length,) = struct.unpack_from("<Q", rest)
        found[name.decode()] = rest[8 : 8 + length].decode()
        assert rest[8 + length : 9 + length] == b"\n"
        data = rest[9 + length :]
    return found


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "journal"))
        listener.setblocking(False)
        monkeypatch.setattr(journal, "SOCKET", str(tmp_path / "journal"))
        monkeypatch.setattr(journal, "connected", lambda: True)
        yield lambda: decoded(listener.recv(65536))


def test_a_fault_has_its_fields(lines: Any) -> None:
    why = "motor: position 2\nis outside"
    tell_journal("press", {"event": "fault", "t": 1.0, "axis": "motor", "code": "travel", "why": why})
    said = lines()
    assert said["MESSAGE"] == f"seod: fault travel: {why}"
    assert {key: said[key] for key in ("RIG", "AXIS", "CODE", "PRIORITY")} == {
        "RIG": "press",
        "AXIS": "motor",
        "CODE": "travel",
        "PRIORITY": "3",
    }
    tell_journal("press", {"event": "warning", "t": 1.0, "axis": None, "code": "link", "why": "down"})
    assert "AXIS" not in (said := lines())
    assert said["PRIORITY"] == "4"


def test_other_events_and_a_journal_that_is_gone_are_no_matter(
    lines: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tell_journal("press", {"event": "state", "t": 1.0, "axis": "motor", "state": "idle"})
    with pytest.raises(BlockingIOError):
        lines()
    monkeypatch.setattr(journal, "SOCKET", "/nowhere")
    assert not journal.tell("hello")


def test_only_a_stream_to_the_journal_counts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (tmp_path / "log").open("w") as log:
        monkeypatch.setattr(sys, "stderr", log)
        here = os.fstat(log.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{here.st_dev}:{here.st_ino}")
        assert journal.connected()
        monkeypatch.setenv("JOURNAL_STREAM", f"{here.st_dev}:{here.st_ino + 1}")
        assert not journal.connected()
        monkeypatch.delenv("JOURNAL_STREAM")
        assert not journal.connected()


# ---- neutral as the last thing


class Writer:
    def __init__(self, *answers: str) -> None:
        self.answers, self.closed = list(answers), False

    def write(self, sent: int) -> str:
        del sent
        return self.answers.pop(0)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(
    ("answers", "why"),
    [([""] * REPEATS, ""), (["full"] * (REPEATS - 1) + [""], ""), (["down"] * REPEATS, "down")],
)
def test_the_last_neutral(answers: list[str], why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = Writer(*answers)
    monkeypatch.setattr(seod.launch.last_neutral, "_recipe", lambda _: {"kind": "test"})
    monkeypatch.setattr(seod.launch.last_neutral, "open_neutral", lambda _: writer)
    monkeypatch.setattr(seod.launch.last_neutral, "lock_rig", lambda _: None)
    monkeypatch.setattr(seod.launch.last_neutral, "PAUSE_S", 0.0)
    assert write_neutral(load_rig(CAN)) == why
    assert writer.closed
    assert not writer.answers


def test_a_rig_file_that_is_wrong_is_told_once(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("version: 1\n")
    done = CliRunner().invoke(app, ["neutral", str(wrong)], env={"EXIT_STATUS": "78"})
    assert (done.exit_code, done.output) == (0, "")
    assert CliRunner().invoke(app, ["neutral", str(wrong)]).exit_code == 1


def test_a_simulated_rig_needs_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seod.launch.last_neutral, "lock_rig", lambda _: None)
    done = CliRunner().invoke(app, ["neutral", str(REPO / "configs" / "virtual.yaml")])
    assert done.exit_code == 1
    assert "moves no rig" in done.output


# ---- rig files of earlier versions


def test_a_rig_file_of_this_version_stays_as_it_is(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text((REPO / "configs" / "virtual.yaml").read_text())
    before = rig.read_bytes()
    done = CliRunner().invoke(app, ["upgrade", str(rig)])
    assert done.exit_code == 0
    assert "nothing to change" in done.output
    assert rig.read_bytes() == before


def test_an_earlier_version_is_lifted_step_by_step(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Version 1 is the first; the way up is tried with a version 0 that had another name for `rig`."""

    def step(document: Any) -> None:
        document.insert(1, "rig", document.pop("name"))

    monkeypatch.setitem(seod.config.upgrade.STEPS, 0, step)
    text = (REPO / "configs" / "virtual.yaml").read_text()
    old = text.replace("\nversion: 1", "\nversion: 0", 1).replace("\nrig:", "\nname:")
    rig = tmp_path / "rig.yaml"
    rig.write_text(old)
    done = CliRunner().invoke(app, ["upgrade", str(rig)])
    assert done.exit_code == 0, done.output
    assert load_rig(rig) == load_rig(REPO / "configs" / "virtual.yaml")
    assert (tmp_path / "rig.yaml~").read_text() == old
    assert "# " in rig.read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("version: 2\n", "of a later seod"),
        ("version: 0\n", "was never one"),
        ("rig: a\n", "expected a whole number"),
        ("version: true\n", "expected a whole number"),
        ("a: [", "no YAML"),
    ],
)
def test_what_cannot_be_upgraded_says_why(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(UpgradeError, match=said):
        upgraded(text, "rig.yaml", tmp_path)
