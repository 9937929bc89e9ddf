"""The league of relay methods: bias, RMS over the Cramer-Rao bound, and coverage, on common plants.

    python bench/league.py [--quick] [--file league.jsonl] [--processes 2] [--doc]

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
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import league_runs
from accuracy import put
from league_cases import GRID, QUICK, VARIED
from league_plots import draw
from league_runs import BLOCK, COMPARED
from league_summary import Found, every_method, goals, league, verdict

DOCS = Path(__file__).parents[1] / "docs"


def tasks(options: argparse.Namespace) -> list[tuple[object, int]]:
    """Cases with the numbers of their blocks; first blocks of all come first."""
    if options.quick:
        return [(case, 0) for case in QUICK]
    cases = list(dict.fromkeys([*GRID, *VARIED]))
    blocks = {case: -(-options.runs // BLOCK) if case.noise else 1 for case in cases}
    return [(case, k) for k in range(max(blocks.values())) for case, n in blocks.items() if k < n]


def work(options: argparse.Namespace, digest: str) -> None:
    """Do what the file does not hold yet."""
    done = league_runs.read(options.file, digest)
    wanted = [(case, block) for case, block in tasks(options) if re.search(options.only, case.name)]
    left = [(case, block) for case, block in wanted if block not in done.get(case.name, {})]
    print(f"{len(left)} blocks of {BLOCK} runs to do; sources {digest}", file=sys.stderr)
    with ProcessPoolExecutor(options.processes) as pool, options.file.open("a") as file:
        if file.tell():
            file.write("\n")  # ends a line that was cut short
        cases, blocks = [case for case, _ in left], [block for _, block in left]
        for k, text in enumerate(pool.map(league_runs.line, cases, blocks, [digest] * len(left)), 1):
            file.write(text + "\n")
            file.flush()
            print(f"\r{k} of {len(left)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


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
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", default="", help="cases whose names match this, as `load=0.3`")
    parser.add_argument("--doc", action="store_true", help="write the tables and plots of docs/league*.md")
    options = parser.parse_args()
    digest = league_runs.sources()
    if not options.doc:
        work(options, digest)
    kept = league_runs.read(options.file, None if options.doc else digest)
    found = {name: [x for block in blocks.values() for x in block] for name, blocks in kept.items()}
    parts = tables(found)
    if options.doc:
        for page in DOCS.glob("league*.md"):
            page.write_text(put(page.read_text(), parts))
        draw(found, DOCS / "img")
    else:
        print("\n\n".join(f"{name}\n\n{part}" for name, part in parts.items()))


if __name__ == "__main__":
    main()
