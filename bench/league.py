"""The league of relay methods: bias, RMS over the Cramer-Rao bound, and coverage, on common plants.

    python bench/league.py [--quick] [--file league.jsonl] [--workers 2] [--doc]

Plants of zeta 0.1-1.5 with noise of 0-2 %, and the design's three plants with delay, hysteresis, load and
unequal gains, swung by a sampled relay in the compiled plant of `sim`. Each seed has a plant, a start and
noise of its own, and makes three records: under the relay as it is, under one with unequal levels, and under
one of two phases; each method gets the one that its authors ask for. A method's bound is that of its own
record, with what it was not told unknown. All methods run in the first 20 runs of a case (10 without noise),
`wave` alone in the others. `--quick`: three plants, without noise and with 1 %, 10 runs.

Results go to a file, a line for every 10 runs. What it holds is not done again, unless the sources have
changed; then `--only` does some again, and `--doc` takes the newest of each case.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads would only wake each other

import argparse
from pathlib import Path

import kept_runs
import league_runs
from league_cases import GRID, QUICK, VARIED
from league_plots import draw
from league_runs import BLOCK, COMPARED
from league_summary import Found, every_method, goals, league, verdict
from through import add_options

DOCS = Path(__file__).parents[1] / "docs"


def tasks(options: argparse.Namespace) -> list[tuple[object, int]]:
    """Cases with the numbers of their blocks; first blocks of all come first."""
    if options.quick:
        return [(case, 0) for case in QUICK]
    cases = list(dict.fromkeys([*GRID, *VARIED]))
    blocks = {case: -(-options.runs // BLOCK) if case.noise else 1 for case in cases}
    return [(case, k) for k in range(max(blocks.values())) for case, n in blocks.items() if k < n]


def tables(found: Found) -> dict[str, str]:
    """By the names that the document gives them."""
    return {
        "league": league(found),
        "verdict": verdict(found),
        "goals": goals(found),
        "rms-zeta": every_method(found, 1, noisy=True),
        "rms-omega_n": every_method(found, 0, noisy=True),
        "bias-zeta": every_method(found, 1, noisy=False),
        "bias-omega_n": every_method(found, 0, noisy=False),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--runs", type=int, default=100, help=f"of each case with noise; {COMPARED * BLOCK} of all methods"
    )
    parser.add_argument(
        "--quick", action="store_true", help="10 runs of three plants, without noise and with 1 %%"
    )
    parser.add_argument("--file", type=Path, default=Path("league.jsonl"), help="what was done, kept")
    add_options(parser, workers=2)
    parser.add_argument("--only", default="", help="cases whose names match this, as `load=0.3`")
    parser.add_argument("--doc", action="store_true", help="write the tables and plots of docs/league*.md")
    options = parser.parse_args()
    digest = league_runs.sources()
    if not options.doc:
        kept_runs.work(league_runs, tasks(options), options, digest)
    kept_runs.tell(options, league_runs, digest, tables, draw, (DOCS, "league*.md"))


if __name__ == "__main__":
    main()
