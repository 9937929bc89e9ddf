"""Damaged files through every reader: how many end in a traceback, what memory they take, which ones hang.

    python bench/fuzz_readers.py [--files 10000] [--seed 1] [--kinds csv,mf4] [--keep FOLDER]

Each file is a small sound one of its kind (`tests/damage/files.py`) after one or two blows
(`tests/damage/blows.py`), by a seed that its number and kind make. A warm process for each kind summarises,
reads, exports and, where it can be, replays it, and tells its peak of resident memory. A process that is
silent for 20 s hangs, one that dies crashed; both are failures. Goal: none of 10,000, and memory of at most
4 x the file's size + 300 MB (of the whole process, or of the largest reader so far that ran apart; what
reading adds to it is beside).
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.damage.blows import damaged
from tests.damage.files import sound_files
from tests.damage.trial import Complaints, outcome, uses

SILENT_S = 20.0
EXPORTS = ("csv", "csv", "parquet", "mat", "mdf")
ROOM_MB = 300.0
TIMES_SIZE = 4.0


class Result(NamedTuple):
    """One file: its number, bytes, what went wrong, peak and added memory [MB], time [s]."""

    number: int
    size: int
    wrong: list[str]
    peak: float
    added: float
    time: float


def memory_mb(word: str) -> float:
    """`VmRSS`, or `VmHWM`, its peak since `forget_peak`."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(word))
    return int(line.split()[1]) / 1024.0


def forget_peak() -> None:
    """The kernel counts the peak of resident memory from now on."""
    Path("/proc/self/clear_refs").write_text("5")


def work(kind: str, seed: int, first: int, last: int, keep: str) -> None:
    """Files `first` to `last` of a kind; a line for each on stdout."""
    out, sys.stdout = sys.stdout, sys.stderr
    warnings.simplefilter("ignore")
    complaints = Complaints()
    sound = sound_files()[kind]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"run{sound.suffix}")
        sound.make(path)
        data = path.read_bytes()
        for to in dict.fromkeys(EXPORTS):  # what these import is not the file's
            for use in uses(path, sound, Path(folder), to):
                outcome(use, "")
        for number in range(first, last):
            draw = random.Random(f"{seed} {kind} {number}")
            path.write_bytes(damaged(data, draw))
            if keep:
                Path(keep, f"{kind}-{number}{sound.suffix}").write_bytes(path.read_bytes())
            forget_peak()
            before, began = memory_mb("VmRSS"), time.monotonic()
            ways = uses(path, sound, Path(folder), draw.choice(EXPORTS))
            names = str(path), str(Path(folder, "out.")), str(Path(folder, "sound.log"))
            wrong = [found for use in ways if (found := outcome(use, *names))]
            wrong += complaints.taken()
            peak = max(memory_mb("VmHWM"), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0)
            size = path.stat().st_size
            print(
                json.dumps([number, size, wrong, peak, peak - before, time.monotonic() - began]),
                file=out,
                flush=True,
            )


class Worker:
    """A process that goes through the files of one kind; started again behind a file that killed it."""

    def __init__(self, kind: str, seed: int, count: int, keep: str) -> None:
        self.results: list[Result] = []
        self._arguments, self._count, self._keep = (kind, seed), count, keep

    def run(self) -> list[Result]:
        """All of them."""
        while len(self.results) < self._count:
            self._run_from(len(self.results))
        return self.results

    def _run_from(self, first: int) -> None:
        kind, seed = self._arguments
        command = [
            sys.executable,
            __file__,
            "--work",
            kind,
            str(seed),
            str(first),
            str(self._count),
            self._keep,
        ]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as child:
            hung = threading.Event()
            dog = self._watch(child, hung)
            for line in child.stdout or ():
                dog.cancel()
                self.results.append(Result(*json.loads(line)))
                dog = self._watch(child, hung)
            dog.cancel()
            status = child.wait()
        if len(self.results) < self._count:
            what = f"hangs for {SILENT_S:g} s" if hung.is_set() else f"crash, status {status}"
            self.results.append(Result(len(self.results), 0, [what], 0.0, 0.0, SILENT_S))

    def _watch(self, child: subprocess.Popen[str], hung: threading.Event) -> threading.Timer:
        def end() -> None:
            hung.set()
            child.kill()

        dog = threading.Timer(SILENT_S + 10.0 * (not self.results), end)
        dog.start()
        return dog


def is_within(result: Result) -> bool:
    """Whether the process kept to its memory."""
    return result.peak <= TIMES_SIZE * result.size / 2**20 + ROOM_MB


def main() -> int:
    """Print a line for each kind, then all that went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(sound_files()))
    parser.add_argument("--keep", default="", help="folder for the damaged files")
    options = parser.parse_args()
    kinds = options.kinds.split(",")
    failures: Counter[str] = Counter()
    first: dict[str, str] = {}
    total: list[Result] = []
    print(f"{'kind':14}{'files':>7}{'wrong':>7}{'peak MB':>9}{'added MB':>9}{'slowest s':>10}")
    for index, kind in enumerate(kinds):
        count = options.files * (index + 1) // len(kinds) - options.files * index // len(kinds)
        results = Worker(kind, options.seed, count, options.keep).run()
        total += results
        for result in results:
            wrong = result.wrong + ([] if is_within(result) else [f"memory: {result.peak:.0f} MB"])
            for each in wrong:
                failures[f"{kind}: {each}"] += 1
                first.setdefault(f"{kind}: {each}", f"{kind} {result.number}")
        print(
            f"{kind:14}{count:7}{sum(bool(r.wrong) for r in results):7}{max(r.peak for r in results):9.0f}"
            f"{max(r.added for r in results):9.0f}{max(r.time for r in results):10.2f}",
            flush=True,
        )
    for what, count in failures.most_common(60):
        print(f"{count:5} x {what} (first: {first[what]})")
    used = sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    bad = sum(bool(r.wrong) for r in total)
    hangs = sum("hangs" in each for r in total for each in r.wrong)
    beyond = sum(not is_within(r) for r in total)
    worst = max(r.peak for r in total)
    print(f"{len(total)} files, {bad} wrong, of which {hangs} hang; worst memory {worst:.0f} MB,")
    print(f"{beyond} beyond {TIMES_SIZE:g} x size + {ROOM_MB:g} MB; {used:.0f} s of processor time")
    return 1 if bad else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--work"]:
        kind, seed, first, last, keep = sys.argv[2:]
        work(kind, int(seed), int(first), int(last), keep)
    else:
        sys.exit(main())
