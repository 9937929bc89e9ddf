"""Hides causes in records and asks the diagnosis: who finds what, against the goals.

    python bench/blind.py --out blind.jsonl --count 200     # again with the same file: goes on where it was
    python bench/blind.py --out blind.jsonl --count 0       # only the tables
    python bench/blind.py --out blind.jsonl --workers 2     # on workers of Dask; --scheduler tcp://host:8786
    python bench/blind.py --out rough.jsonl --rough         # noise, scales and converters of measured rigs
    python bench/blind.py --out relay.jsonl --cause coulomb_friction --excitation relay --noise 0.03

Records come from the generator of `tests/blind`, which shares nothing with the model that is fitted. Each
number makes one record, and one line in the file; the diagnosis sees the CSV file alone.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from blind_runs import LATE, Wanted, hidden
from hidden_cases import KINDS
from hidden_score import OUTCOMES, wilson
from through import add_options, results

GOALS = {"one": 0.99, "two": 0.95, "clean": 0.995, "unlisted": 0.95}
COVERAGE = (0.90, 0.98)
OUT = Path(tempfile.gettempdir()) / "seod-blind.jsonl"
LIMIT_S = 120
"""Processor time of one diagnosis, after which it counts as wrong."""


def run(args: argparse.Namespace, done: set[int]) -> None:
    causes = None if args.cause is None else tuple(args.cause)
    numbers = (n for n in range(args.first, args.first + args.count) if n not in done)
    wanted = (
        Wanted(n, args.kind, causes, args.excitation, args.noise, args.duration, args.rough, args.limit)
        for n in numbers
    )
    with args.out.open("a", encoding="utf-8") as out:
        for _, found in results(args, hidden, wanted):
            if isinstance(found, dict):
                out.write(json.dumps(found) + "\n")
                out.flush()
            print(found if isinstance(found, str) else summary(found), flush=True)


def summary(found: dict) -> str:
    hidden = "+".join(found["causes"]) or "nothing"
    named = "+".join(found["named"]) or "nothing"
    visible = "/".join(f"{x:.1f}" for x in found["visible"].values())
    how = f"{found['excitation']} {found['output']}"
    return (
        f"{found['number']:5d} {found['outcome']:6s} {hidden:45s} ({visible:>9s}) {how:20s} "
        f"-> {found['verdict'][:30]}: {named} {found['as_well']} {found['seconds']:.1f} s"
    )


def rate(lines: list[dict]) -> str:
    counts = Counter(each["outcome"] for each in lines)
    right = counts["exact"] + counts["within"]
    low, high = wilson(right, len(lines))
    return (
        f"{right:4d} of {len(lines):4d}  {100 * right / max(len(lines), 1):5.1f} % "
        f"[{100 * low:5.1f}, {100 * high:5.1f}]  exact {counts['exact']:4d}"
    )


def table(title: str, lines: list[dict], key) -> None:
    groups = defaultdict(list)
    for each in lines:
        groups[key(each)].append(each)
    print(f"\n{title}")
    for name in sorted(groups):
        print(f"  {name!s:32s} {rate(groups[name])}")


def confusion(lines: list[dict]) -> None:
    print("\nhidden -> named (single causes, misses alone)")
    pairs = Counter(
        (each["causes"][0], "+".join(sorted(each["named"])) or "nothing")
        for each in lines
        if each["kind"] == "one" and each["outcome"] == "wrong"
    )
    for (cause, named), count in sorted(pairs.items()):
        print(f"  {cause:32s} {named:60s} {count}")


def intervals(lines: list[dict]) -> None:
    told = [each for one in lines if one["outcome"] == "exact" for each in one["parameters"]]
    if not told:
        return
    inside = sum(low <= truth <= high for _, truth, _, low, high in told)
    low, high = wilson(inside, len(told))
    print(
        f"\nparameter intervals cover {inside} of {len(told)}: {100 * inside / len(told):.1f} % "
        f"[{100 * low:.1f}, {100 * high:.1f}], goal {100 * COVERAGE[0]:g}-{100 * COVERAGE[1]:g} %"
    )
    places = defaultdict(list)
    for place, truth, value, *ends in told:
        size = abs(truth) or 0.5 * (ends[1] - ends[0])
        places[place].append((abs(value - truth) / max(size, 1e-300), ends[0] <= truth <= ends[1]))
    for place, errors in sorted(places.items()):
        covered = sum(good for _, good in errors)
        print(
            f"  {place:44s} median error {100 * median(e for e, _ in errors):6.2f} %  {covered}/{len(errors)}"
        )


def tables(lines: list[dict]) -> None:
    print(f"\n{len(lines)} records, {', '.join(OUTCOMES)}; right: exact or within")
    for kind in KINDS:
        ours = [each for each in lines if each["kind"] == kind]
        print(f"  {kind:10s} {rate(ours)}  goal {100 * GOALS[kind]:g} %")
    table("single causes", [each for each in lines if each["kind"] == "one"], lambda each: each["causes"][0])
    table("by excitation", lines, lambda each: f"{each['excitation']} {each['output']}")
    table("by noise", lines, lambda each: each["noise_part"])
    if any(each.get("rough") for each in lines):
        table("by the noise's colour", lines, lambda each: each["rough"]["colour"])
        table("by the command's sampler", lines, lambda each: each["rough"].get("sampler", "none"))
        table("with a hum of the mains", lines, lambda each: each["rough"].get("mains", 0.0) > 0.0)
    table("off the list", [e for e in lines if e["kind"] == "unlisted"], lambda each: each["causes"][0])
    alarms = [each for each in lines if each["kind"] == "clean" and each["named"]]
    print(f"\nfalse alarms on clean records: {len(alarms)}")
    confusion(lines)
    intervals(lines)
    if lines:
        seconds = sorted(each["seconds"] for each in lines if math.isfinite(each["seconds"]))
        late = sum(each["verdict"] == LATE for each in lines)
        print(
            f"\nprocessor time: median {median(seconds):.1f} s, p90 {seconds[int(0.9 * len(seconds))]:.1f} s,"
            f" most {seconds[-1]:.1f} s, {late} not in time"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT, help="results, one a line")
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--cause", action="append", help="hide this one; twice: both")
    parser.add_argument("--excitation")
    parser.add_argument("--noise", type=float, default=0.01, help="part of the detrended std(y)")
    parser.add_argument("--duration", type=float, help="of each record [s]; default: by the plant, 20 or 30")
    parser.add_argument("--limit", type=int, default=LIMIT_S, help="processor time of a diagnosis [s]")
    parser.add_argument("--rough", action="store_true", help="noise, scales and converters of measured rigs")
    add_options(parser, workers=0)
    args = parser.parse_args()
    args.kind = args.kind or (None if args.cause is None else ("one", "two")[len(args.cause) - 1])
    lines = _read(args.out)
    run(args, {each["number"] for each in lines})
    tables(sorted(_read(args.out), key=lambda each: each["number"]))


def _read(path: Path) -> list[dict]:
    """Lines of the file; of `bench/ablation.py`'s those with all rules on."""
    lines = [json.loads(row) for row in path.read_text().splitlines()] if path.exists() else []
    return [each for each in lines if each.get("off") is None]


if __name__ == "__main__":
    main()
