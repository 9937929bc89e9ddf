"""Tests of processes on a machine whose processors are taken from it now and then.

A virtual machine stands still for 100 ms at a time while its host has others to serve; Linux counts that as
stolen time. A daemon that stands still for so long stops its rig, as it must, and a test that waits for
anything else fails. Such a test has shown nothing: it is run once more, and the summary names it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from _pytest.runner import runtestprotocol

if TYPE_CHECKING:
    from collections.abc import Sequence

STOLEN_S = 0.05
"""From here on a loop with a hang timeout of 50 ms (the least in use) may have been stopped by it."""

_again: list[str] = []


def stolen_s() -> float:
    """Time that the host has taken from this machine's processors since it was started [s]."""
    return int(Path("/proc/stat").read_text().split("\n", 1)[0].split()[8]) / os.sysconf("SC_CLK_TCK")


def note_again(what: str, taken_s: float) -> None:
    """Tell of `what` in the summary."""
    _again.append(f"{what}: {taken_s:.2f} s were taken from the machine during a run, which failed")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test of processes; once more if it failed while time was stolen."""
    if item.get_closest_marker("processes") is None:
        return None
    before = stolen_s()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports: Sequence[pytest.TestReport] = runtestprotocol(item, log=False, nextitem=nextitem)
    taken = stolen_s() - before
    if taken >= STOLEN_S and any(report.failed for report in reports):
        note_again(item.nodeid, taken)
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name what was run twice."""
    if _again:
        terminalreporter.section("run again")
        for line in _again:
            terminalreporter.write_line(line)
