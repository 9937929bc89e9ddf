"""Bias and scatter relative to the Cramer-Rao bound, and interval coverage, of all estimators.

    python bench/accuracy.py [--quick] [--file accuracy.jsonl] [--workers 2] [--doc]

A sampled relay swings plants of zeta 0.1-1.5 and omega_n Ts 0.02-0.2, and the design's three plants with more
noise, coarse sensors, jitter, delay, hysteresis, friction. Each run has a plant, start and noise of its own.
All methods run in the first 25 runs of a case, `wave` alone in the others. Without noise there is no bound;
counts are taken for noise in it. `--quick`: 50 runs of the three plants.

Results go to a file, a line for every 25 runs. What it holds is not done again, unless the sources have
changed; then `--only` does some again, and `--doc` takes the newest of each case.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads would only wake each other

import argparse
import math
from pathlib import Path

import accuracy_runs
import kept_runs
from accuracy_cases import GRID, PLANTS, Case, about_the_plants
from accuracy_plots import draw
from accuracy_runs import BLOCK
from accuracy_summary import Found, goals, methods, totals, varied
from through import add_options

DOCS = Path(__file__).parents[1] / "docs"
QUICK = [Case(*plant) for plant in PLANTS]


def tasks(options: argparse.Namespace) -> list[tuple[Case, int]]:
    """Cases with the numbers of their blocks; first blocks of all come first."""
    if options.quick:
        return [(case, block) for block in range(2) for case in QUICK]
    counts = {case: math.ceil(options.varied_runs / BLOCK) for _, case in about_the_plants()}
    counts |= {case: math.ceil(options.grid_runs / BLOCK) for case in GRID}
    counts |= dict.fromkeys(QUICK, math.ceil(options.runs / BLOCK))
    return [(case, k) for k in range(max(counts.values())) for case, n in counts.items() if k < n]


def tables(found: Found) -> dict[str, str]:
    """By the names that the document gives them."""
    return {
        "goals": goals(found) + "\n" + totals(found),
        "methods-zeta": methods(found, 1),
        "methods-omega_n": methods(found, 0),
        "varied-zeta": varied(found, 1),
        "varied-omega_n": varied(found, 0),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000, help="of the design's three plants, plain")
    parser.add_argument("--grid-runs", type=int, default=200, help="of each plant of the grid")
    parser.add_argument("--varied-runs", type=int, default=100, help="of each other case")
    parser.add_argument("--quick", action="store_true", help="50 runs of the design's three plants")
    parser.add_argument("--file", type=Path, default=Path("accuracy.jsonl"), help="what was done, kept")
    add_options(parser, workers=2)
    parser.add_argument("--only", default="", help="cases whose names match this, as `speed=1`")
    parser.add_argument("--doc", action="store_true", help="write the tables and plots of docs/accuracy*.md")
    options = parser.parse_args()
    digest = accuracy_runs.sources()
    if not options.doc:
        kept_runs.work(accuracy_runs, tasks(options), options, digest)
    kept_runs.tell(options, accuracy_runs, digest, tables, draw, (DOCS, "accuracy*.md"))


if __name__ == "__main__":
    main()
