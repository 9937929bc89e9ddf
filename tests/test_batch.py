"""Batches on real workers: killed in the middle, a scheduler started again, the command itself killed.

Whatever happens, nothing is lost, nothing is done twice, and the bytes are those of this process alone.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from batch_tasks import DEADLY, journal, write_recordings, written
from peers import SEOD, free_port, kill, port_open, until

from seod.batch.executor import Here
from seod.batch.run import Batch

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.processes
COUNT = 14
ROWS = 3000
"""Of a recording: identify takes long enough that something can happen in the middle."""
DASK = SEOD.with_name("dask")
ENVIRONMENT = os.environ | {
    "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
    "PYTHONPATH": str(Path(__file__).parent),
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    write_recordings(folder, COUNT, ROWS)
    (folder / "torn.csv").write_text("no numbers\n")
    return folder


@pytest.fixture(scope="module")
def alone(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What this process alone writes."""
    out = tmp_path_factory.mktemp("alone")
    with Batch("identify", [recordings], out, {}) as batch:
        outcome = batch.run(Here())
    assert list(outcome.failures) == ["torn.csv"]
    return written(out)


@pytest.fixture
def started() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes of a test; those that live are ended, in the reverse order."""
    processes: list[subprocess.Popen[bytes]] = []
    yield processes
    for process in reversed(processes):
        if process.poll() is None:
            process.terminate()
        process.wait(30)


class Run:
    """`seod batch identify` as a process of its own session, its output in a file."""

    def __init__(
        self, started: list[subprocess.Popen[bytes]], recordings: Path, out: Path, *more: str
    ) -> None:
        self.out, self.log = out, out.with_suffix(".log")
        command = [SEOD, "batch", "identify", recordings, "--out", out, *more]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True, env=ENVIRONMENT
            )
        started.append(self.process)

    def until_done(self, count: int) -> None:
        until(f"{count} results", lambda: len(journal(self.out)) >= count or self.process.poll() is not None)
        assert self.process.poll() is None, self.log.read_text()

    def ends(self, code: int) -> str:
        assert self.process.wait(90) == code, self.log.read_text()
        return self.log.read_text()


def workers_of(pid: int) -> list[int]:
    """Children of a process that are workers."""
    children = [
        child for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()
    ]
    return [int(child) for child in children if is_worker(Path(f"/proc/{child}/cmdline").read_bytes())]


def is_worker(command: bytes) -> bool:
    """By the command line, or by the title that Dask gives it where `setproctitle` is installed."""
    return b"spawn_main" in command or command.startswith(b"dask worker")


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def each_once(out: Path) -> None:
    names = journal(out)
    assert sorted(names) == sorted(set(names))
    assert len(names) == COUNT + 1


def test_a_worker_killed_in_the_middle_loses_nothing(recordings, alone, started, tmp_path):
    run = Run(started, recordings, tmp_path / "out", "--workers", "2")
    run.until_done(3)
    victim = workers_of(run.process.pid)[0]
    kill(victim, signal.SIGKILL)
    said = run.ends(1)
    assert gone(victim)
    assert written(run.out) == alone
    each_once(run.out)
    assert "! torn.csv: no table of numbers" in said
    assert f"identify: {COUNT + 1} files, 1 failed" in said
    assert "dashboard: http://127.0.0.1:" in said


def test_a_killed_command_goes_on_where_it_was_with_any_number_of_workers(
    recordings, alone, started, tmp_path
):
    run = Run(started, recordings, tmp_path / "out", "--workers", "1")
    run.until_done(3)
    workers = workers_of(run.process.pid)
    kill(run.process.pid, signal.SIGKILL)
    run.process.wait()
    until("workers end with their command", lambda: all(gone(pid) for pid in workers))
    before = len(journal(run.out))
    assert before < COUNT
    said = Run(started, recordings, run.out, "--workers", "0").ends(1)
    assert f"files, {before} of them before" in said
    assert written(run.out) == alone
    each_once(run.out)


def test_an_interrupt_ends_workers_and_tells_how_to_go_on(recordings, started, tmp_path):
    run = Run(started, recordings, tmp_path / "out", "--workers", "1")
    run.until_done(2)
    workers = workers_of(run.process.pid)
    assert workers
    os.killpg(run.process.pid, signal.SIGINT)  # as a terminal does
    said = run.ends(130)
    assert f"of {COUNT + 1} are done, and the same command goes on from there" in said
    assert "Traceback" not in said
    until("workers end", lambda: all(gone(pid) for pid in workers))


def scheduler(started: list[subprocess.Popen[bytes]], port: int, log: Path) -> subprocess.Popen[bytes]:
    command = [DASK, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    return service(started, command, log)


def worker(started: list[subprocess.Popen[bytes]], port: int, log: Path) -> subprocess.Popen[bytes]:
    options = [
        "--nthreads",
        "1",
        "--no-dashboard",
        "--host",
        "127.0.0.1",
        "--local-directory",
        str(log.parent),
    ]
    return service(started, [DASK, "worker", f"tcp://127.0.0.1:{port}", *options], log)


def service(started: list[subprocess.Popen[bytes]], command: list, log: Path) -> subprocess.Popen[bytes]:
    with log.open("ab") as output:
        process = subprocess.Popen(
            command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True, env=ENVIRONMENT
        )
    started.append(process)
    return process


def test_a_scheduler_that_is_started_again_gets_all_that_was_under_way(recordings, alone, started, tmp_path):
    port = free_port()
    first = scheduler(started, port, tmp_path / "scheduler.log")
    until("the scheduler listens", lambda: port_open(port))
    worker(started, port, tmp_path / "worker.log")
    run = Run(started, recordings, tmp_path / "out", "--scheduler", f"tcp://127.0.0.1:{port}")
    run.until_done(3)
    first.kill()
    first.wait()
    until("the command waits", lambda: "is away: waiting up to" in run.log.read_text())
    scheduler(started, port, tmp_path / "scheduler.log")
    until("the scheduler listens", lambda: port_open(port))
    worker(started, port, tmp_path / "worker.log")  # the old one may come back or end
    said = run.ends(1)
    assert "is back" in said
    assert written(run.out) == alone
    each_once(run.out)


SCRIPT = """
import json, sys
import batch_tasks
from seod.batch.cluster import OnDask
from seod.batch.executor import completed

if __name__ == "__main__":
    with OnDask(workers=2, memory=sys.argv[2], dashboard=None) as executor:
        done = dict(completed(executor, getattr(batch_tasks, sys.argv[1]), range(12)))
    print(json.dumps({item: getattr(result, "why", result) for item, result in done.items()}))
"""


@pytest.mark.parametrize(("task", "memory"), [("deadly", "auto"), ("greedy", "500 MB")])
def test_a_task_that_kills_its_workers_or_takes_their_memory_fails_and_no_other(tmp_path, task, memory):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "-W", "error", script, task, memory],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert "died again and again" in told.pop(str(DEADLY))
    assert told == {str(item): item * item for item in range(12) if item != DEADLY}


def test_a_scheduler_that_never_answers_is_told(recordings, tmp_path):
    script = (
        "from seod.batch.cluster import OnDask\n"
        f"with OnDask('tcp://127.0.0.1:{free_port()}', patience_s=1.0): pass\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert "StoppedError: no scheduler answers at tcp://127.0.0.1:" in done.stderr


def test_the_paper_is_the_same_bytes_whoever_computes_it(started, tmp_path):
    port = free_port()
    scheduler(started, port, tmp_path / "scheduler.log")
    until("the scheduler listens", lambda: port_open(port))
    worker(started, port, tmp_path / "worker.log")
    ways = {
        "alone": ("--workers", "0"),
        "two": ("--workers", "2"),
        "scheduler": ("--scheduler", f"tcp://127.0.0.1:{port}"),
    }
    told = {}
    for name, options in ways.items():
        command = [SEOD, "paper", "--figure", "4", "--figure", "10", "--out", tmp_path / name, *options]
        subprocess.run(command, check=True, capture_output=True, env=ENVIRONMENT, timeout=200)
        told[name] = written(tmp_path / name)
    assert set(told["alone"]) >= {"paper.json", "paper.html", "figure-4.svg", "figure-10.svg"}
    assert told["two"] == told["alone"]
    assert told["scheduler"] == told["alone"]
