"""What failed while the machine was taken away is run once more, and named; nothing else is."""

from __future__ import annotations

from pathlib import Path

import pytest

HOOKS = """
import sys
sys.path.insert(0, {repo!r})
import tests.stolen
from tests.stolen import pytest_runtest_protocol, pytest_terminal_summary
times = iter({times})
tests.stolen.stolen_s = lambda: next(times)
"""
FAILS_ONCE = """
import pytest
runs = []
@pytest.mark.processes
def test_it():
    runs.append(1)
    assert len(runs) == 2
"""
FAILS = FAILS_ONCE.replace("len(runs) == 2", "False")
UNMARKED = FAILS_ONCE.replace("@pytest.mark.processes", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "times", "passed", "named"),
    [
        (FAILS_ONCE, [5.0, 5.1], 1, True),
        (FAILS_ONCE, [5.0, 5.0], 0, False),
        (FAILS, [5.0, 5.1], 0, True),
        (UNMARKED, [5.0, 5.1], 0, False),
    ],
)
def test_a_test_runs_again_only_where_time_was_stolen(
    pytester: pytest.Pytester, text: str, times: list[float], passed: int, named: bool
) -> None:
    pytester.makeini("[pytest]\nmarkers = processes: these")
    pytester.makeconftest(HOOKS.format(repo=str(Path(__file__).parents[2]), times=times))
    pytester.makepyfile(text)
    result = pytester.runpytest_subprocess("-p", "no:nbmake", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=passed, failed=1 - passed)
    assert ("0.10 s were taken from the machine" in result.stdout.str()) is named
