"""How long a diagnosis of a minute at 2 kHz takes, beside the goal of 30 s on two cores.

    python bench/diagnose.py [--seconds 60] [--effort normal]

The records hide nothing, one cause, two, and one off the list, for which the search uses all its time. They
come from the generator of `tests/blind`. Wall time counts reading the file; run it on an
idle machine. Counted is the work by which searches end, in seconds of a usual machine: processor time over it
tells this machine's speed.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: the diagnosis has threads of its own
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import draw
from hidden_records import make_record, write

from seod.data import read
from seod.diagnose.fitting.work import used_s
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.search.budget import EFFORTS, Effort

GOAL_S = 30.0
TICK = 0.0005
CASES = (
    (900, "clean", (), "operation"),
    (901, "one", ("coulomb_friction",), "operation"),
    (902, "two", ("square_root_flow", "backlash"), "multisine"),
    (903, "unlisted", ("gusts",), "steps"),
)


def timed(path: Path, effort: Effort) -> tuple[str, float, float, float]:
    """What the diagnosis says of a file; wall, processor and counted time [s]."""
    wall, busy, counted = perf_counter(), process_time(), used_s()
    told = diagnose([read(path)], (), Options(effort=effort))
    names = ", ".join(each.name for each in told.effects) or "nothing named"
    return f"{told.verdict}: {names}", perf_counter() - wall, process_time() - busy, used_s() - counted


def main() -> None:
    """Print a line for each record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--effort", choices=tuple(EFFORTS), default="normal")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write(make_record(replace(draw(900, "clean", (), "operation", False, duration=4.0))), path)
        timed(path, "quick")  # machine code is made, or read from its cache
        for number, kind, causes, excitation in CASES:
            case = replace(draw(number, kind, causes, excitation, False, duration=options.seconds), tick=TICK)
            write(make_record(case), path)
            said, wall, busy, counted = timed(path, options.effort)
            hidden = ", ".join(causes) or "nothing"
            print(
                f"{hidden:28} {wall:5.1f} s ({wall / GOAL_S:.2f} of the goal), busy {busy:5.1f} s, "
                f"counted {counted:5.1f} s  {said}"
            )


if __name__ == "__main__":
    main()
