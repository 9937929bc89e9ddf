"""A guest that records onto a real ext4 file system is killed as by a power cut; another one reads on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import pytest

from tests.vm.test_guest import why_not

if TYPE_CHECKING:
    from collections.abc import Iterator

REPO = Path(__file__).parents[2]
HERE = Path(__file__).parent
LIMIT_S = 240
ENOUGH_ROWS = 5000
ROWS_A_SECOND = 1000
"""At most: what `disk/record_rows.py` records in the guest."""

pytestmark = [pytest.mark.vm, pytest.mark.timeout(2 * LIMIT_S + 60)]


def guest(share: Path, program: str, *arguments: str) -> subprocess.Popen[str]:
    """Start a program of `disk/` in a guest that shares a folder."""
    command = [sys.executable, str(HERE / "disk" / program), *arguments]
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(REPO)}
    return subprocess.Popen(
        [HERE / "canvm.sh", "-s", share, "-t", str(LIMIT_S), "--", *command],
        cwd=REPO,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def children(pid: int) -> Iterator[int]:
    """All processes below one."""
    for each in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(each.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended meanwhile
            continue
        if parent == pid:
            yield int(each.parent.name)
            yield from children(int(each.parent.name))


def cut_off(run: subprocess.Popen[str]) -> None:
    """Kill the guest, all at once, without a word to it."""
    for pid in list(children(run.pid)):
        try:
            if "linux.uml" in Path(f"/proc/{pid}/cmdline").read_text():
                os.kill(pid, signal.SIGKILL)
        except (OSError, ProcessLookupError):
            continue


def wait_for_rows(run: subprocess.Popen[str], progress: Path) -> None:
    """Until the recorder has said that enough is on the disk."""
    deadline = time.monotonic() + LIMIT_S
    while not (told := lines(progress)) or told[-1][1] < ENOUGH_ROWS:
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < deadline, told[-3:]
        time.sleep(0.05)


def lines(progress: Path) -> list[tuple[int, int]]:
    """Rows taken, rows said to be on the disk, each time."""
    text = progress.read_text() if progress.exists() else ""
    whole = text[: text.rfind("\n") + 1]
    return [(int(taken), int(written)) for taken, written in map(str.split, whole.splitlines())]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    if why_not() and os.environ.get("SEOD_REQUIRE_VM"):
        pytest.fail(f"SEOD_REQUIRE_VM is set, but {why_not()}", pytrace=False)
    mkfs = shutil.which("mkfs.ext4", path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
    if why_not() or mkfs is None:
        pytest.skip(why_not() or "there is no mkfs.ext4")
    path = tmp_path / "disk.img"
    with path.open("wb") as file:
        file.truncate(64 << 20)
    subprocess.run([mkfs, "-q", "-F", path], check=True)
    return path


def test_after_a_power_cut_all_is_there_that_was_said_to_be(image: Path, tmp_path: Path) -> None:
    progress = tmp_path / "progress"
    run = guest(tmp_path, "record_rows.py", str(image), str(progress))
    try:
        wait_for_rows(run, progress)
    finally:
        cut_off(run)
        run.communicate()
    told = lines(progress)
    again = guest(tmp_path, "read_rows.py", str(image))
    out, err = again.communicate()
    assert again.returncode == 0, err
    found = json.loads(out.splitlines()[-1])
    behind = [taken - written for taken, written in told]
    print(f"taken, safe: {told[-1]}; found: {len(found['ticks'])}; behind: {median(behind)}")
    assert found["ticks"] == list(range(len(found["ticks"])))
    assert told[-1][1] <= len(found["ticks"])
    assert found["parts"] > 2
    assert median(behind) < ROWS_A_SECOND, "mostly, less than a second is not yet on the disk"
