"""The leak fixture fails on each kind of leak, and only then."""

from __future__ import annotations

from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

CONFTEST = Path(__file__).parents[1] / "conftest.py"

LEAKY = """
import asyncio, os, socket, subprocess, sys, threading

kept = []

def test_socket():
    kept.append(socket.socketpair())

def test_memfd():
    kept.append(os.memfd_create("rows"))

def test_second_descriptor_of_one_memfd():
    kept.append(os.dup(kept[-1]))

def test_file(tmp_path):
    kept.append(open(tmp_path / "log", "w"))

def test_thread():
    end = threading.Event()
    thread = threading.Thread(target=end.wait, name="worker", daemon=True)
    thread.start()
    kept.append(end)

def test_running_child():
    kept.append(subprocess.Popen(["sleep", "600"]))

def test_child_not_waited_for():
    child = subprocess.Popen(["true"], stdout=subprocess.DEVNULL)
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    kept.append(child)

async def test_task():
    kept.append(asyncio.create_task(asyncio.sleep(600), name="left running"))

def test_end():
    kept[-3].kill()
    for child in kept[-3:-1]:
        child.wait()
"""

CLEAN = """
import asyncio, os, socket, subprocess, threading
import pytest

@pytest.fixture(scope="module")
def shared():
    with socket.socket() as s:
        yield s

async def in_thread():
    return await asyncio.to_thread(threading.get_ident)

def test_closes_what_it_opens(shared, tmp_path, capfd):
    a, b = socket.socketpair()
    a.close(), b.close()
    os.close(os.memfd_create("rows"))
    subprocess.run(["true"], check=True)

async def test_ends_its_tasks(shared):
    task = asyncio.create_task(asyncio.sleep(600))
    await asyncio.sleep(0)
    task.cancel()
    await in_thread()

async def test_waits_for_its_child():
    child = await asyncio.create_subprocess_exec("true")
    await child.wait()
"""

ORPHAN = """
import subprocess, sys

def test_parent_ends_before_its_child():
    subprocess.run(["sh", "-c", "sleep 20 >/dev/null 2>&1 & echo $!"], check=True)
"""


def run(pytester: pytest.Pytester, source: str, *options: str) -> pytest.RunResult:
    pytester.makeconftest(CONFTEST.read_text())
    pytester.makepyfile(source)
    pytester.makeini("[pytest]\nasyncio_mode = auto\nasyncio_default_fixture_loop_scope = function\n")
    return pytester.runpytest_subprocess("-p", "no:nbmake", "-W", "error", *options)


def test_each_kind_of_leak_fails(pytester: pytest.Pytester) -> None:
    result = run(pytester, LEAKY, "-v", "-W", "ignore::pytest.PytestUnraisableExceptionWarning")
    result.assert_outcomes(passed=9, errors=8)
    text = "\n".join(line for line in result.outlines if line.startswith("left behind"))
    for kind in (
        "socket:[",
        "/memfd:rows",
        "/log inode",
        "thread worker",
        "(sleep 600)",
        "not waited",
        "left running",
    ):
        assert kind in text
    assert text.count("/memfd:rows") == 2


@pytest.mark.parametrize("options", [[], ["-n1"]])
def test_a_tidy_test_passes(pytester: pytest.Pytester, options: list[str]) -> None:
    run(pytester, CLEAN, *options).assert_outcomes(passed=3)


def test_a_process_without_parent_fails_its_module(pytester: pytest.Pytester) -> None:
    result = run(pytester, ORPHAN, "-s")
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(["*left behind: process * (sleep 20)*"])
