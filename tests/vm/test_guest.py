"""Runs `tests/vm/guest` once, in guests with real SocketCAN and systemd; reports each test.

A guest takes a minute until its first daemon ticks, so that files share one. Those that install the service
have one of their own.

Not everyone can start the guest: it needs root and Debian's packages. Where it cannot run these tests are
skipped; SEOD_REQUIRE_VM=1 makes that a failure, SEOD_SKIP_VM=1 leaves them out.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import pytest

from sim.cache import compile_plant, is_plant_compiled
from tests.stolen import STOLEN_S, note_again, stolen_s
from tests.wheels import houses

REPO = Path(__file__).parents[2]
GUEST = Path(__file__).with_name("guest")
HOUSES = REPO / ".pytest_cache" / "wheelhouses"
NAMES = sorted(path.stem for path in GUEST.glob("test_*.py"))
INSTALLING = ("test_unit", "test_upgrade", "test_service")
SHARING = [name for name in NAMES if name not in INSTALLING]
GUESTS = 2
"""Guests at a time: each has one processor."""
SETS = [*(SHARING[k::GUESTS] for k in range(GUESTS)), *([name] for name in INSTALLING)]
"""Files of each guest; the longest guests first: the last one has no other beside it."""
LIMIT_S = 1200
"""Of one of them."""
ALL_S = 2400
MOST_AGAIN = 2
"""Of a file that takes half a minute, in which the host may take its processor each time."""

pytestmark = [pytest.mark.vm, pytest.mark.timeout(ALL_S)]


class Result(NamedTuple):
    """One test of the guest."""

    name: str
    outcome: str
    """`passed`, `failed` or `skipped`."""
    text: str


def why_not() -> str:
    """Why the guest cannot be started here, or ""."""
    if os.environ.get("SEOD_SKIP_VM"):
        return "SEOD_SKIP_VM is set"
    if os.geteuid() != 0:
        return "the guest needs root"
    if shutil.which("apt-get") is None:
        return "the guest's kernel is a Debian package, and there is no apt-get"
    return ""


def read_report(path: Path, names: list[str]) -> dict[str, list[Result]]:
    """The guest's results, by file."""
    results: dict[str, list[Result]] = {name: [] for name in names}
    for case in ET.parse(path).iter("testcase"):
        problems = [e for e in case if e.tag in ("failure", "error", "skipped")]
        outcome = "passed"
        if problems:
            outcome = "skipped" if all(e.tag == "skipped" for e in problems) else "failed"
        text = "\n".join(f"{e.get('message') or ''}\n{e.text or ''}" for e in problems)
        name = case.get("classname", "").rpartition(".")[2]
        results[name].append(Result(case.get("name", ""), outcome, text))
    return results


@pytest.fixture(scope="session")
def guest_report() -> dict[str, list[Result]]:
    """All results of one run of the guest."""
    reason = why_not()
    if reason and os.environ.get("SEOD_REQUIRE_VM"):
        pytest.fail(f"SEOD_REQUIRE_VM is set, but {reason}", pytrace=False)
    if reason:
        pytest.skip(reason)
    if not is_plant_compiled():  # the guest sees the machine code; to make it there takes a minute
        compile_plant()
    shutil.rmtree(HOUSES, ignore_errors=True)
    HOUSES.mkdir(parents=True)
    houses(HOUSES)
    with ThreadPoolExecutor(GUESTS) as guests:
        return {name: results for told in guests.map(run_patiently, SETS) for name, results in told.items()}


def run_patiently(names: list[str]) -> dict[str, list[Result]]:
    """As `run_guest`; what failed while the host took the machine's time again, `MOST_AGAIN` times."""
    told, again = {}, names
    for left in range(MOST_AGAIN, -1, -1):
        before = stolen_s()
        told |= run_guest(again)
        taken = stolen_s() - before
        again = [name for name in again if any(result.outcome == "failed" for result in told[name])]
        if taken < STOLEN_S or not again or not left:
            break
        for name in again:
            note_again(name, taken)
    return told


def run_guest(names: list[str]) -> dict[str, list[Result]]:
    """What one guest says of these files."""
    report = REPO / ".pytest_cache" / f"guest_{names[0]}.xml"
    report.parent.mkdir(exist_ok=True)
    report.unlink(missing_ok=True)
    tests = [str(GUEST / f"{name}.py") for name in names]
    command = [sys.executable, "-m", "pytest", *tests, f"--junitxml={report}", "-p", "no:cacheprovider"]
    run = subprocess.run(
        [GUEST.with_name("canvm.sh"), "-s", REPO, "-t", str(LIMIT_S), "--", *command],
        cwd=REPO,
        env=os.environ
        | {"SEOD_IN_GUEST": "1", "PYTHONDONTWRITEBYTECODE": "1", "SEOD_WHEELHOUSES": str(HOUSES)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    print(run.stdout)
    if not report.exists():
        said = f"the guest gave no results (exit code {run.returncode}):\n{run.stdout}"
        return {name: [Result("all", "failed", said)] for name in names}
    return read_report(report, names)


@pytest.mark.parametrize("name", NAMES)
def test_in_guest(name: str, guest_report: dict[str, list[Result]], subtests: pytest.Subtests) -> None:
    """One file of the guest's tests; each of its tests is a subtest here."""
    results = guest_report[name]
    assert results, f"the guest ran no test of {name}.py"
    for result in results:
        with subtests.test(msg=result.name):
            if result.outcome == "failed":
                pytest.fail(result.text, pytrace=False)
            if result.outcome == "skipped":
                assert not os.environ.get("SEOD_REQUIRE_VM"), f"skipped in the guest: {result.text.strip()}"
                pytest.skip(result.text.strip())
