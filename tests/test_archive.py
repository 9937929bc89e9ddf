"""The archive by real processes: builders and workers that are killed, an object store that is a server."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

sys.path.insert(0, str(Path(__file__).parent / "unit"))
from archive_recordings import catalogue_of, fill, report

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytestmark = pytest.mark.processes
PATIENCE_S = 90.0


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "seod.cli", "archive", *map(str, words)]


def run(*words: object, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*words), capture_output=True, text=True, env=env, check=False)


def until(condition: Callable[[], object]) -> None:
    """Wait until it is true."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def children(pid: int) -> list[int]:
    """Workers of a process: those of its children that read recordings."""
    found = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            found += path.read_text().split()
        except OSError:  # a thread that ended meanwhile
            continue
    return [int(child) for child in found if is_worker(child)]


def is_worker(pid: str) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:  # ended meanwhile
        return False


def has_ended(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    """300 recordings, and their catalogue by one undisturbed process."""
    folder = tmp_path_factory.mktemp("archive")
    fill(folder, rigs=100)
    done = run("build", folder, "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{folder}: 300 recordings, 300 read now\n"
    return folder, catalogue_of(folder)


def test_a_builder_killed_again_and_again_gives_the_same_catalogue(archive):
    folder, right = archive
    shutil.rmtree(folder / "catalogue")
    for first in (
        "staged/00000001.batch",
        "day=2026-03-01/segments.parquet",
        "day=2026-03-15/segments.parquet",
    ):
        with subprocess.Popen(command("build", folder, "--workers", 1), stderr=subprocess.DEVNULL) as builder:
            until(lambda first=first: (folder / "catalogue" / first).exists() or builder.poll() is not None)
            builder.send_signal(signal.SIGKILL)
    done = run("build", folder, "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert catalogue_of(folder) == right


def test_a_worker_that_is_killed_costs_nothing_and_ends_with_its_builder(archive):
    folder, right = archive
    shutil.rmtree(folder / "catalogue")
    with subprocess.Popen(
        command("build", folder, "--workers", 2), stdout=subprocess.PIPE, text=True
    ) as builder:
        until(lambda: children(builder.pid))
        os.kill(children(builder.pid)[0], signal.SIGKILL)
        out, _ = builder.communicate(timeout=PATIENCE_S)
    assert (builder.returncode, out) == (0, f"{folder}: 300 recordings, 300 read now\n")
    assert catalogue_of(folder) == right

    shutil.rmtree(folder / "catalogue")
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command("build", folder, "--workers", 2), stderr=quiet) as builder:
        until(lambda: len(children(builder.pid)) == 2)
        workers = children(builder.pid)
        builder.send_signal(signal.SIGKILL)
    until(lambda: all(map(has_ended, workers)))
    assert run("build", folder, "--workers", 2).returncode == 0
    assert catalogue_of(folder) == right


@contextmanager
def object_store() -> Iterator[str]:
    """A moto server; gives its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "moto.server", "-p", str(port), "-H", "127.0.0.1"]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, stdout=quiet, stderr=quiet) as server:
        try:
            until(lambda: answers(port))
            yield f"http://127.0.0.1:{port}"
        finally:
            server.kill()


def answers(port: int) -> bool:
    with socket.socket() as talk:
        return talk.connect_ex(("127.0.0.1", port)) == 0


UPLOAD = """
import sys
from pathlib import Path
from seod.archive.store import Store
import fsspec
fsspec.filesystem("s3").mkdir("bench")
store, folder = Store("s3://bench/2026"), Path(sys.argv[1])
for path in sorted(folder.rglob("*")):
    if path.is_file():
        store.write(str(path.relative_to(folder)), path.read_bytes())
"""


def test_an_archive_in_an_object_store(tmp_path):
    fill(tmp_path)
    (tmp_path / "rig1/1.diagnosis.json").write_text(report())
    keys = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1"}
    with object_store() as address:
        env = {**os.environ, **keys, "AWS_ENDPOINT_URL": address}
        subprocess.run([sys.executable, "-c", UPLOAD, str(tmp_path)], env=env, check=True)
        where = "s3://bench/2026"
        done = run(where, env=env)
        assert (done.returncode, done.stdout) == (0, f"{where}: 12 recordings, 12 read now\n"), done.stderr
        assert run("build", where, env=env).stdout == f"{where}: 12 recordings, 0 read now\n"
        left = run("left-model", where, "--to", "csv", env=env)
        assert left.returncode == 0, left.stderr
        assert left.stdout.splitlines()[1].startswith("rig1,motor,2026-03-08T12:00:00.7")
        assert "coulomb_friction" in left.stdout
        (tmp_path / "rig0/0.mcap").write_bytes((tmp_path / "rig0/1.mcap").read_bytes())
        again = UPLOAD.replace('fsspec.filesystem("s3").mkdir("bench")', "")
        subprocess.run([sys.executable, "-c", again, str(tmp_path)], env=env, check=True)
        assert run("build", where, env=env).stdout == f"{where}: 12 recordings, 1 read now\n"
        nowhere = run("query", "s3://nobody/x", "SELECT 1", env=env)
        assert nowhere.returncode == 1
        assert nowhere.stderr.startswith("seod: s3://nobody/x: ")
