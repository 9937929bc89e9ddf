"""Recording on real disks that are full or gone, and a real bus beside it: the loop never notices."""

from __future__ import annotations

import fcntl
import os
import re
import struct
import subprocess
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

import can
import pytest
from bus import COMMAND_ID, CONFIG
from conftest import run_daemon

from seod.record.layout import COUNTERS
from seod.record.read import items, parts
from tests.peers import REPO, until
from tests.unit.record_rows import Content
from tests.vm.disk.mounting import mount, unmount

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Bench

    from tests.peers import Rpc

EXT4_SHUTDOWN, WITHOUT_FLUSH = 0x8004587D, 2
"""ioctl that makes a file system refuse everything from now on, as when its disk is pulled out."""


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A small ext4 file system."""
    image = tmp_path / "disk.img"
    with image.open("wb") as file:
        file.truncate(8 << 20)
    subprocess.run(["/usr/sbin/mkfs.ext4", "-q", "-F", image], check=True)
    folder = mount(image, str(tmp_path / "disk"))
    yield folder
    unmount(folder)


def fill(disk: Path) -> Path:
    """Take all the room there is."""
    path = disk / "filler"
    with path.open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue
    return path


def pull_out(disk: Path) -> None:
    fd = os.open(disk, os.O_RDONLY)
    try:
        fcntl.ioctl(fd, EXT4_SHUTDOWN, struct.pack("I", WITHOUT_FLUSH))
    finally:
        os.close(fd)


def ticks(path: Path) -> list[int]:
    return [
        tick
        for rows in items(path, ["motor"])
        if not isinstance(rows, dict)
        for tick in rows["tick"].tolist()
    ]


def goes_on(bench: Bench) -> str:
    """The warning that the recording goes on; others may come before it."""
    while True:
        why: str = bench.daemon.event(event="warning", code="recording")["why"]
        if why.startswith("recording goes on"):
            return why


def recorder(bench: Bench) -> dict[str, int]:
    report: dict[str, int] = bench.health()["recorder"]  # type: ignore[assignment]
    return report


def test_a_full_disk_is_told_and_costs_nothing_once_there_is_room(
    rig: Rpc, tmp_path: Path, disk: Path
) -> None:
    path = disk / "a.mcap"
    with run_daemon(rig, CONFIG, tmp_path, "--record", str(path)) as bench:
        bench.excite()
        filler = fill(disk)
        told = bench.daemon.event(event="warning", code="recording")
        assert "No space left on device" in told["why"]
        ticked = bench.health()["ticks"]
        until("further ticks", lambda: bench.health()["ticks"] > ticked + 50)
        assert bench.state() == "exciting"
        filler.unlink()
        goes_on(bench)
        until("all rows on the disk", lambda: recorder(bench)["rows"] > ticked + 50)
        bench.recover()
    found = ticks(path)
    assert found == list(range(found[0], found[0] + len(found)))
    assert Content(path).json(COUNTERS)[-1]["lost"] == 0


def test_a_disk_that_is_pulled_out_is_told_and_a_new_file_begins_on_the_next_one(
    rig: Rpc, tmp_path: Path, disk: Path
) -> None:
    path = disk / "run" / "a.mcap"  # the empty mount point has no such folder
    path.parent.mkdir()
    with run_daemon(rig, CONFIG, tmp_path, "--record", str(path)) as bench:
        until("rows on the disk", lambda: recorder(bench)["rows"] > 50)
        pull_out(disk)
        told = bench.daemon.event(event="warning", code="recording")
        assert "cannot be written" in told["why"]
        ticked = bench.health()["ticks"]
        until("further ticks", lambda: bench.health()["ticks"] > ticked + 20)
        subprocess.run(["umount", "-l", disk], check=True)
        mount(tmp_path / "disk.img", str(disk))
        assert goes_on(bench).endswith("a.0002.mcap")
        rows = recorder(bench)["rows"]
        until("rows in the new file", lambda: recorder(bench)["rows"] > rows)
        lost = recorder(bench)["lost"]
    assert len(parts(path)) == 2
    found = ticks(path)
    gaps = sum(b - a - 1 for a, b in pairwise(found))
    assert gaps == lost
    assert Content(path.with_name("a.0002.mcap")).json(COUNTERS)[-1]["lost"] == lost


@pytest.mark.parametrize("name", ["bus.blf", "bus.mf4"])
def test_each_frame_of_the_bus_is_in_the_log_or_told(rig: Rpc, tmp_path: Path, name: str) -> None:
    text = CONFIG.read_text().replace("../../..", str(REPO))
    config = tmp_path / "logged.yaml"
    config.write_text(text + f"\nrecord:\n  bus_log: {name}\n")
    with run_daemon(rig, config, tmp_path) as bench:
        bench.excite()
        sent = bench.counters()["frames_sent"]
        until("more commands", lambda: bench.counters()["frames_sent"] > sent + 100)
        bench.recover()
        sent = bench.counters()["frames_sent"] - sent
    told = re.search(r"bus log .*: (\d+) frames are not in it", bench.program.said())
    lost = int(told[1]) if told else 0
    with can.LogReader(tmp_path / name) as log:
        frames = Counter(frame.arbitration_id for frame in log)
    assert frames[COMMAND_ID] + lost >= sent
    assert lost == 0 or name == "bus.mf4"  # MF4 is too slow for the guest
    assert set(frames) >= {COMMAND_ID, 0x101}
