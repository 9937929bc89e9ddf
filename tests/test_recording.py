"""Recording and replay by real processes: what is left after kill -9, and the same estimates again."""

from __future__ import annotations

import signal
import subprocess
from typing import TYPE_CHECKING, Any

import pytest

from seod.data import read
from seod.record.layout import ESTIMATES
from seod.record.read import items
from tests.peers import SEOD, Program, Rpc, find_process, kill, port_of, port_open, until, write_rig_file
from tests.unit.record_rows import Content

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.processes


def begin(rig_file: Path, *arguments: str) -> tuple[Program, Rpc]:
    program = Program(rig_file.with_suffix(".log"), "run", rig_file, *arguments)
    port = port_of(rig_file)
    until("the port", lambda: port_open(port) or program.process.poll() is not None)
    assert program.process.poll() is None, program.said()
    rpc = Rpc(port)
    rpc.call("subscribe", topics=["event", "estimate"])
    return program, rpc


def replaying(rig_file: Path, recording: Path) -> Path:
    """The same rig file on a recording."""
    head, _, rest = rig_file.read_text().partition("driver:\n")
    rest = rest.partition("\nloop:")[2]
    path = rig_file.with_name("replay.yaml")
    driver = f"driver: {{kind: replay, file: {recording.name}, realtime: false}}"
    path.write_text(f"{head}{driver}\n\nloop:{rest}")
    return path


def rows_of(path: Path) -> list[int]:
    found = [item for item in items(path, ["motor"]) if not isinstance(item, dict)]
    return [tick for rows in found for tick in rows["tick"].tolist()]


def estimates(path: Path) -> list[dict[str, Any]]:
    found = Content(path).json(ESTIMATES + "motor")
    return [{key: value for key, value in estimate.items() if key != "age_s"} for estimate in found]


def record_live(rig_file: Path, path: Path) -> None:
    program, rpc = begin(rig_file, "--record", str(path))
    try:
        until("the loop", lambda: rpc.call("status")["health"]["ticks"])
        rpc.call("start")
        for e_a in (0.5, 0.4):
            rpc.call("set", axis="motor", e_a=e_a)
            for _ in range(10):
                rpc.wait_for("an estimate", lambda m: m["params"].get("quality") == "ok")
        rpc.call("stop")
    finally:
        rpc.close()
        program.stop()
        print(program.said())


def test_a_replay_gives_the_estimates_of_the_live_run(tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path)
    live, again = tmp_path / "live.mcap", tmp_path / "again.mcap"
    record_live(rig_file, live)
    program, rpc = begin(replaying(rig_file, live), "--record", str(again))
    try:
        until("the end", lambda: rpc.call("status")["health"]["recorder"]["rows"] >= len(rows_of(live)))
        with pytest.raises(Exception, match="this is a recording"):
            rpc.call("start")
    finally:
        rpc.close()
        program.stop()
        print(program.said())
    assert len(estimates(live)) > 20
    assert estimates(again) == estimates(live)
    assert rows_of(again) == rows_of(live)


def test_after_kill_9_the_recording_has_all_that_was_called_safe(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    rig_file = write_rig_file(tmp_path)
    program, rpc = begin(rig_file, "--record", str(path))
    try:
        until("rows", lambda: rpc.call("status")["health"]["recorder"]["rows"] > 500)
        safe = rpc.call("status")["health"]["recorder"]["rows"]
        kill(until("the gateway", lambda: find_process("seod.gateway", program.pid)), signal.SIGKILL)
        second = tmp_path / "a.start2.mcap"
        until("a second recording", lambda: second.exists() and second.stat().st_size > 20_000)
    finally:
        rpc.close()
        program.stop()
        print(program.said())
    found = rows_of(path)
    assert found == list(range(found[0], found[0] + len(found)))
    assert len(found) >= safe
    assert rows_of(second)[0] > found[-1]


def in_a_small_disk(folder: Path, *command: str) -> list[str]:
    """A command that finds a file system of 100 KB at `folder`, in a mount namespace of its own."""
    mounted = (
        f'mount -t tmpfs -o size=100k none {folder} && "$@"; rc=$?; cp {folder}/* {folder.parent}; exit $rc'
    )
    return ["unshare", "--map-root-user", "--mount", "sh", "-c", mounted, "sh", *command]


@pytest.mark.parametrize("name", ["a.csv", "a.mcap"])
def test_a_recording_that_a_full_disk_did_not_take_is_told_and_is_a_failure(
    name: str, tmp_path: Path
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(
        in_a_small_disk(disk, "touch", f"{disk}/x"), capture_output=True, check=False
    ).returncode:
        pytest.skip("user namespaces are not permitted")
    rig_file = write_rig_file(tmp_path)
    seod = [str(SEOD), "run", str(rig_file), "--for", "8", "--record", str(disk / name)]
    with subprocess.Popen(in_a_small_disk(disk, *seod), stderr=subprocess.PIPE, text=True) as process:
        port = port_of(rig_file)
        until("the port", lambda: port_open(port) or process.poll() is not None)
        rpc = Rpc(port)
        rpc.call("subscribe", topics=["event"])
        why = f"{disk / name} cannot be written: No space left on device"
        rpc.wait_for("the warning", lambda m: m["params"].get("why") == why)
        recorder = rpc.call("status")["health"]["recorder"]
        rpc.close()
        said = process.communicate()[1]
    assert recorder["error"] == why
    assert recorder["waiting"] > 0
    assert process.returncode == 1
    assert f"seod: recording {disk / name}: up to " in said
    assert f"rows are not in it: {why}" in said
    # the write that failed may have left whole rows beyond those confirmed
    assert recorder["rows"] <= len(read(tmp_path / name).t) <= recorder["rows"] + recorder["waiting"]
