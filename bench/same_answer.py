"""Whether a recording gets byte for byte the same answer on one core and on two, idle, loaded, and twice.

    python bench/same_answer.py [--records 50] [--first 23000] [--duration 6] [--cold 1] [--effort normal]

Records come from the generator of `tests/blind`. Each is asked by `seod diagnose --json` as a process: on all
cores, once more, on one core, and on all cores beside as many busy programs. Of the first `--cold` ones it is
asked with an empty cache of compiled code too, which takes a minute each.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import Invisible, draw
from hidden_records import make_record, write

from seod.diagnose.search.budget import EFFORTS

if TYPE_CHECKING:
    from collections.abc import Iterator

KINDS = ("one", "two", "clean", "unlisted")
EXCITATIONS = ("multisine", "relay", "steps", "operation")


def answer(path: Path, effort: str, cores: int, cache: str | None = None) -> tuple[bytes, float]:
    """What the command prints, and its wall time [s]."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    command = [sys.executable, "-m", "seod.cli", "diagnose", str(path), "--json", "--effort", effort]
    begin = perf_counter()
    run = subprocess.run(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        check=True,
        preexec_fn=lambda: os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores]),
    )
    return run.stdout, perf_counter() - begin


@contextlib.contextmanager
def busy(programs: int) -> Iterator[None]:
    """Programs that do nothing, as fast as they can."""
    started = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(programs)]
    try:
        yield
    finally:
        for each in started:
            each.kill()
            each.wait()


def answers(path: Path, effort: str, cores: int, cold: bool) -> Iterator[tuple[str, bytes, float]]:
    """How it was asked, the answer, and the wall time [s]."""
    for name, count in (("all cores", cores), ("once more", cores), ("one core", 1)):
        yield name, *answer(path, effort, count)
    with busy(cores):
        yield "loaded", *answer(path, effort, cores)
    if cold:
        with tempfile.TemporaryDirectory() as cache:
            yield "cold", *answer(path, effort, cores, cache)


def record(number: int, seconds: float, path: Path) -> bool:
    """Write a record; False where what it hides cannot be seen."""
    kind = KINDS[number % len(KINDS)]
    try:
        case = draw(number, kind, None, EXCITATIONS[number // 4 % 4], False, duration=seconds)
    except Invisible:
        return False
    write(make_record(case), path)
    return True


def main() -> None:
    """Print a line for each record, then how many differ."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=int, default=50)
    parser.add_argument("--first", type=int, default=23000)
    parser.add_argument("--duration", type=float, default=6.0)
    parser.add_argument("--cold", type=int, default=1)
    parser.add_argument("--effort", choices=EFFORTS, default="normal")
    asked = parser.parse_args()
    cores, number, done, differ = len(os.sched_getaffinity(0)), asked.first, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        while done < asked.records:
            if record(number, asked.duration, path):
                told = list(answers(path, asked.effort, cores, done < asked.cold))
                others = [name for name, text, _ in told if text != told[0][1]]
                times = ", ".join(f"{name} {wall:.1f} s" for name, _, wall in told)
                print(
                    f"{number}: {'differs: ' + ', '.join(others) if others else 'same'}; {times}", flush=True
                )
                done, differ = done + 1, differ + bool(others)
            number += 1
    print(f"{differ} of {done} records got an answer that differs")


if __name__ == "__main__":
    main()
