"""Whether a longer recording of the same rig names the same causes, with narrower intervals, and how fast.

    python bench/long_recordings.py [--rigs 3] [--lengths 12 48 240 600]

Each rig hides two causes and is recorded for 12 s and for 4, 20 and 50 times as long, at 1 kHz. The records
come from the generator of `tests/blind`. Printed are the causes named, right or not, the width of the first
cause's first interval over the shortest recording's, and the wall time, whose goal is 30 s for ten minutes.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import Invisible, draw
from hidden_records import make_record, write
from hidden_score import outcome

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose

TICK = 0.001
PAIRS = (
    (("coulomb_friction", "valve_deadband"), "multisine"),
    (("coulomb_friction", "transport_delay"), "steps"),
    (("backlash", "load_bias"), "operation"),
    (("square_root_flow", "periodic_disturbance"), "multisine"),
    (("stribeck_friction", "sensor_lag"), "steps"),
)


def first_width(effects: list[dict[str, Any]], cause: str) -> float:
    """Of the interval of a cause's first parameter; nan where it is not named."""
    told = next((each for each in effects if each["name"] == cause), None)
    if told is None:
        return float("nan")
    low, high = next(iter(told["parameters"].values()))["ci95"]
    return float(high - low)


def main() -> None:
    """Print a line for each record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rigs", type=int, default=len(PAIRS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--lengths", type=float, nargs="+", default=[12.0, 48.0, 240.0, 600.0])
    asked = parser.parse_args()
    path = Path(tempfile.mkdtemp()) / "run.csv"
    for number in range(asked.first, asked.first + asked.rigs):
        causes, excitation = PAIRS[number % len(PAIRS)]
        shortest = 0.0
        for seconds in asked.lengths:
            try:
                case = draw(7000 + number, "two", causes, excitation, False, duration=asked.lengths[0])
            except Invisible:
                print(f"{number:3d} cannot be seen", flush=True)
                break
            write(make_record(replace(case, tick=TICK, duration=seconds)), path)
            begin = perf_counter()
            told = diagnose([read(path)], (), Options("position")).as_json()
            wall = perf_counter() - begin
            width = first_width(told["effects"], causes[0])
            shortest = shortest or width
            names = ", ".join(each["name"] for each in told["effects"]) or "nothing"
            right = outcome("two", causes, told)
            print(
                f"{number:3d} {'+'.join(causes):34} {seconds:5.0f} s: {right:7} {told['verdict']:11} "
                f"{names:44} width {width / shortest:5.2f}, {wall:5.1f} s",
                flush=True,
            )
    path.unlink(missing_ok=True)
    path.parent.rmdir()


if __name__ == "__main__":
    main()
