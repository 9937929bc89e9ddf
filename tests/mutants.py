"""How many small changes of what must not fail the unit tests see: `make mutants`, some minutes.

mutmut makes the mutants and runs, for each, the tests that reach the function that was changed; modules and
tests stand in pyproject.toml under `tool.mutmut`. A mutant that does what the original does is no gap in the
tests: `EQUIVALENT` names each with the reason. Both shares are printed, with and without these.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from mutmut.mutation.diff_apply import get_diff_for_mutant
from mutmut.stats import status_by_exit_code

WORK = Path("mutants")
GOAL = 95.0
"""Percent of a module's mutants that are to be killed."""
SEEN = {"killed", "timeout", "segfault"}
SOCKETS = "AF_UNIX is what no family stands for"
ORIGIN = "times of a board's clock count from anywhere"
HEARD = "read only once a sample was heard, which sets it"
NO_SHARE = "a share of 0 adds nothing, it saves the time"
NOT_ZERO = "between the limits it was decided before"
HALVES = "half a wrap ahead is half a wrap back"
MOVED = "set before it is read: a first sample is a movement from nan"
CLIPPED = "a command at the limit is clipped to itself"
EQUIVALENT: dict[str, str] = {
    "AxisGuard.pass_command: out = u if -limit <= u <= limit else math.copysign(limit, u)"
    " -> out = u if -limit < u <= limit else math.copysign(limit, u)": CLIPPED,
    "AxisGuard.pass_command: out = u if -limit <= u <= limit else math.copysign(limit, u)"
    " -> out = u if -limit <= u < limit else math.copysign(limit, u)": CLIPPED,
    "AxisGuard.__init__: self.moved_at = -math.inf -> self.moved_at = None": MOVED,
    "AxisGuard.__init__: self.moved_at = -math.inf -> self.moved_at = +math.inf": MOVED,
    "DeviceClock.restart: self._now = self._put_right = 0.0 -> self._now = self._put_right = 1.0": ORIGIN,
    "DeviceClock.heard: passed = 0.0 if self._latest is None else _passed_s(self._latest, time_us)"
    " -> passed = 1.0 if self._latest is None else _passed_s(self._latest, time_us)": ORIGIN,
    "_passed_s: return ((after_us - before_us + HALF) % WRAP - HALF) * 1e-6"
    " -> return ((after_us - before_us - HALF) % WRAP - HALF) * 1e-6": HALVES,
    "DeviceClock.heard: passed = 0.0 -> passed = 1.0": ORIGIN,
    "DeviceClock._was_set:"
    " return early < 0.0 or passed - (arrived - self._arrived) > STEP_S or passed < -STEP_S ->"
    " return early <= 0.0 or passed - (arrived - self._arrived) > STEP_S or passed < -STEP_S": NOT_ZERO,
    "DeviceClock._difference:"
    " bound = 0.5 * (above + below) if -math.inf < below < above else above ->"
    " bound = 0.5 * (above + below) if -math.inf < below <= above else above": "the mean of two alike is one",
    "DeviceClock._difference:"
    " return bound + share * (self.jitter.level(x) - bound) if share else bound ->"
    " return bound + share * (self.jitter.level(x) - bound) if (share) or True else bound": NO_SHARE,
    "Bound.__init__: self._best = (0.0, math.inf) -> self._best = (1.0, math.inf)": "any point is below inf",
    "DeviceClock.restart: self._arrived = -math.inf -> self._arrived = None": HEARD,
    "DeviceClock.restart: self._arrived = -math.inf -> self._arrived = +math.inf": HEARD,
    "SupervisorGuard.__init__: self.beats = self.silent = 0 -> self.beats = self.silent = None": (
        "the first look sets both, whatever the count is"
    ),
    "Way.__init__: self.own_end, self.gateway_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)"
    " -> self.own_end, self.gateway_end = socket.socketpair(None, socket.SOCK_SEQPACKET)": SOCKETS,
    "Child.__init__: self.link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)"
    " -> self.link, theirs = socket.socketpair(None, socket.SOCK_SEQPACKET)": SOCKETS,
}
"""By function and changed line, why no test can see it."""


@dataclass
class Module:
    """What became of the mutants of one module.

    Attributes:
        killed: How many a test saw.
        equivalent: Those that do what the original does.
        survived: The others, by function and changed line.
    """

    path: str
    killed: int = 0
    equivalent: list[str] = field(default_factory=list)
    survived: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        return self.killed + len(self.equivalent) + len(self.survived)

    @property
    def share(self) -> float:
        """Killed, of all [%]."""
        return 100.0 * self.killed / self.count

    @property
    def share_of_others(self) -> float:
        """Killed, of those that are not equivalent [%]."""
        return 100.0 * self.killed / max(self.count - len(self.equivalent), 1)


def change(mutant: str, path: str) -> str:
    """Function and changed line: `AxisGuard._frozen: still = t - self.moved_at -> still = None`."""
    name = mutant.rpartition(".")[2].rpartition("__mutmut_")[0]
    name = name.removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")
    lines = get_diff_for_mutant(mutant, path=path).splitlines()[2:]
    before, after = (" ".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+")
    return f"{name}: {before} -> {after}"


def results() -> list[Module]:
    """Of the last run."""
    modules = []
    for found in sorted(WORK.rglob("*.py.meta")):
        path = str(found.relative_to(WORK)).removesuffix(".meta")
        module = Module(path)
        for mutant, code in json.loads(found.read_text())["exit_code_by_key"].items():
            status = status_by_exit_code[code]
            if status in SEEN:
                module.killed += 1
                continue
            changed = change(mutant, path)
            if changed in EQUIVALENT:
                module.equivalent.append(changed)
            else:
                module.survived.append(f"{changed} ({status})")
        if module.count:
            modules.append(module)
    return modules


def main() -> int:
    """0 if each module is at the goal."""
    shutil.rmtree(WORK, ignore_errors=True)
    ran = subprocess.run(
        [sys.executable, "-m", "mutmut", "run", "--max-children", "1"], stdout=subprocess.DEVNULL, check=False
    )
    if ran.returncode:
        print("mutmut failed: `mutmut run` tells why")
        return 1
    return report(results())


def report(modules: list[Module]) -> int:
    """Print the table, then what survived."""
    print(f"{'module':32} mutants killed equivalent survived  killed  of the others (goal {GOAL:g} %)")
    for module in modules:
        counts = f"{module.count:7} {module.killed:6} {len(module.equivalent):10} {len(module.survived):8}"
        print(f"{module.path:32} {counts}  {module.share:4.1f} %  {module.share_of_others:5.1f} %")
    for module in modules:
        for survivor in module.survived:
            print(f"survived: {module.path}: {survivor}")
        for equal in module.equivalent:
            print(f"equivalent: {module.path}: {equal}: {EQUIVALENT[equal]}")
    return int(any(module.share_of_others < GOAL for module in modules))


if __name__ == "__main__":
    sys.exit(report(results()) if sys.argv[1:] == ["--last"] else main())
