"""Fixtures for all tests: a test may leave nothing behind.

Each test is compared before and after: child processes, threads, asyncio tasks and file descriptors (sockets,
memfds, pipes, files). What wider fixtures hold (a daemon shared by a module, an event loop, the channels of
pytest-xdist) is there before the test as well and does not count. Processes that lost their parent are
looked for at the end of each module.
"""

from __future__ import annotations

import asyncio
import gc
import inspect
import os
import threading
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from tests.stolen import pytest_runtest_protocol, pytest_terminal_summary  # noqa: F401 - hooks

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator

    Found = Counter[str]

GRACE_S = 0.3
"""What ends by itself within this time is not a leak (a thread between its last line and its end)."""

LOOKS = 20
"""At a process without environment, a millisecond apart: one that was given none stays without."""

MARK = "SEOD_TEST_PROCESS"
"""Environment variable inherited by all that a test starts: finds processes that lost their parent."""

os.environ[MARK] = str(os.getpid())

settings.register_profile("repeated", derandomize=True, deadline=None)
settings.register_profile("new", deadline=None)
settings.load_profile(os.environ.get("SEOD_EXAMPLES", "repeated"))
"""Examples of hypothesis are the same in each run; `make fuzz` looks for new ones. None has a deadline."""

gc.disable()  # while tests are collected: all of that stays, and to look through it takes a seventh of it


def pytest_itemcollected(item: pytest.Item) -> None:
    """Whole diagnoses compute, and no clock decides about them: `make test` runs them behind all others."""
    slow = item.get_closest_marker("slow") and item.path.name.startswith("test_diagnose_")
    if slow or item.path.parent.name == "blind":
        item.add_marker("computes")


def pytest_collection_finish() -> None:
    """From here on, without what stays."""
    gc.freeze()
    gc.enable()


def open_descriptors() -> Found:
    """What this process has open, as the kernel names it: `socket:[123]`, `/memfd:seod (deleted) inode 7`.

    Looked at before and after each test: with a `Path` for each it took more than three times as long.
    """
    found: Found = Counter()
    for entry in list(os.scandir("/proc/self/fd")):
        try:
            target = os.readlink(entry.path)  # noqa: PTH115
            if target.startswith("/"):
                target += f" inode {os.fstat(int(entry.name)).st_ino}"
        except OSError:  # the descriptor of the listing itself, or one closed by a thread meanwhile
            continue
        if "/mpl-data/fonts/" in target:  # matplotlib keeps those that it has drawn with
            continue
        found[target] += 1
    return found


def child_processes() -> Found:
    """Children of this process, those that ended without being waited for included."""
    found: Found = Counter()
    for thread in list(os.scandir("/proc/self/task")):
        try:
            pids = Path(thread.path, "children").read_text().split()
        except OSError:  # a thread that ended meanwhile
            continue
        found.update(f"process {pid} ({_command(pid)})" for pid in pids)
    return found


def marked_processes() -> Found:
    """All other processes that this one started, however deep, with or without a parent."""
    wanted = f"{MARK}={os.getpid()}".encode()
    found: Found = Counter()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or entry.name == str(os.getpid()):
            continue
        try:
            environment = _environment(entry)
        except OSError:  # ended meanwhile, or someone else's
            continue
        if wanted in environment.split(b"\0"):
            found[f"process {entry.name} ({_command(entry.name)})"] += 1
    return found


def _environment(entry: Path) -> bytes:
    """Of a process; while it becomes another program there is none for a moment.

    Raises:
        OSError: It has ended, or is the kernel's own.
    """
    for _ in range(LOOKS):
        environment = (entry / "environ").read_bytes()
        if environment or not (entry / "exe").readlink():
            break
        time.sleep(0.001)
    return environment


def running_threads() -> Found:
    """Python threads that are alive."""
    return Counter(f"thread {thread.name} ({thread.ident})" for thread in threading.enumerate())


def _command(pid: str) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return "ended"
    return b" ".join(words).decode(errors="replace").strip() or "ended, not waited for"


def left_behind(looks: list[Callable[[], Found]], before: list[Found]) -> Found:
    """What is there now and was not there before, once the grace time is over."""
    deadline = time.monotonic() + GRACE_S
    while True:
        left = sum((look() - old for look, old in zip(looks, before, strict=True)), Counter[str]())
        if not left or time.monotonic() > deadline:
            return left
        time.sleep(0.01)


def _watch(*looks: Callable[[], Found]) -> Iterator[None]:
    before = [look() for look in looks]
    yield
    left = left_behind(list(looks), before)
    if left:
        pytest.fail("left behind: " + "; ".join(sorted(left)), pytrace=False)


@pytest.fixture(autouse=True, scope="session")
def _one_thread_in_each_worker() -> Iterator[None]:
    """pytest-xdist starts a worker for each processor: threads of a diagnosis would wait for each other.

    Measured: two workers with two threads each take a fifth more processor time than with one.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    from seod.diagnose import pipeline

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "processors", lambda: 1)
        yield


@pytest.fixture(autouse=True, scope="module")
def _no_orphans() -> Iterator[None]:
    yield from _watch(child_processes, marked_processes)


@pytest.fixture(autouse=True)
def _no_leaks() -> Iterator[None]:
    yield from _watch(child_processes, running_threads, open_descriptors)


@pytest.fixture(autouse=True)
def _no_leaked_tasks(_no_leaks: None, request: pytest.FixtureRequest) -> None:
    # Set up within `_no_leaks`, so that the event loop's own descriptors are closed again when that looks.
    if inspect.iscoroutinefunction(getattr(request.node, "obj", None)):
        request.getfixturevalue("_task_watch")


@pytest.fixture
async def _task_watch() -> AsyncIterator[None]:
    # The loop would cancel leftover tasks silently as it closes.
    before = asyncio.all_tasks()
    yield
    for _ in range(10):  # a cancelled task needs a turn or two to end
        await asyncio.sleep(0)
    left = asyncio.all_tasks() - before - {asyncio.current_task()}
    if left:
        pytest.fail("left behind: " + "; ".join(sorted(map(repr, left))), pytrace=False)
