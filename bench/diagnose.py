"""How long a diagnosis of a minute at 2 kHz takes, beside the goal of 30 s on two cores.

    python bench/diagnose.py [--seconds 60]

The records hide nothing, one cause, two, and one off the list, for which the search uses all its time. They
come from the generator of `tests/blind`. Wall time counts reading the file; run it on an idle machine.
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
from seod.diagnose.command import diagnose

GOAL_S = 30.0
TICK = 0.0005
CASES = (
    (900, "clean", (), "operation"),
    (901, "one", ("coulomb_friction",), "operation"),
    (902, "two", ("square_root_flow", "backlash"), "multisine"),
    (903, "unlisted", ("gusts",), "steps"),
)


def timed(path: Path) -> tuple[str, float, float]:
    """What the diagnosis says of a file; wall and processor time [s]."""
    wall, busy = perf_counter(), process_time()
    told = diagnose([read(path)])
    names = ", ".join(each.name for each in told.effects) or "nothing named"
    return f"{told.verdict}: {names}", perf_counter() - wall, process_time() - busy


def main() -> None:
    """Print a line for each record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write(make_record(replace(draw(900, "clean", (), "operation", False, duration=4.0))), path)
        timed(path)  # machine code is made, or read from its cache
        for number, kind, causes, excitation in CASES:
            case = replace(draw(number, kind, causes, excitation, False, duration=seconds), tick=TICK)
            write(make_record(case), path)
            said, wall, busy = timed(path)
            hidden = ", ".join(causes) or "nothing"
            print(f"{hidden:28} {wall:5.1f} s ({wall / GOAL_S:.2f} of the goal), busy {busy:5.1f} s  {said}")


if __name__ == "__main__":
    main()
