"""What each rescue rule of the diagnosis is for, and whether it earns its place.

    python bench/ablation.py --out ablation.jsonl --note 400     # where each rule acts; resumes
    python bench/ablation.py --out ablation.jsonl --off          # those records again, that rule off
    python bench/ablation.py --out ablation.jsonl                # only the table
    python bench/blind.py --out ablation.jsonl --count 0         # how many were right, all rules on

Records are those of `bench/blind.py`, and so are the lines. A rule acts where it gives something else than if
it were off: `--note` writes down which did, and the answer; `--off` asks anew, with one rule off at a time,
of records in which it acted (at most `--most` of them). The table counts right answers with and without it.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

from ablation_runs import RULES, Trial, tried
from blind_runs import Wanted
from through import add_options, results

SEED_FIRST = 43000
RIGHT = ("exact", "within")
LIMIT_S = 120
"""Processor time of one diagnosis, after which it counts as wrong: that of `bench/blind.py`."""


def wanted(lines: list[dict], most: int) -> list[tuple[int, str]]:
    """Records and rules that act in them, still to be asked without the rule."""
    done = {(each["number"], each["off"]) for each in lines}
    out = []
    for rule in RULES:
        acting = [each["number"] for each in lines if each["off"] is None and each["acts"].get(rule.name)]
        out += [(number, rule.name) for number in acting[:most] if (number, rule.name) not in done]
    return out


def table(lines: list[dict]) -> None:
    """Rule, where it acts, right with and without it, answers that differ, and its sentence."""
    with_all = {each["number"]: each for each in lines if each["off"] is None}
    print(f"{len(with_all)} records; right with all rules: {sum(map(right, with_all.values()))}")
    print(f"{'rule':28}{'acts in':>8}{'asked':>7}{'with':>6}{'without':>8}{'differ':>8}{'work':>7}  for what")
    for rule in RULES:
        acting = sum(bool(each["acts"].get(rule.name)) for each in with_all.values())
        pairs = [(with_all[each["number"]], each) for each in lines if each["off"] == rule.name]
        own, other = (sum(map(right, some)) for some in (zip(*pairs, strict=True) if pairs else ((), ())))
        differ = sum(a["named"] != b["named"] or a["verdict"] != b["verdict"] for a, b in pairs)
        used = sum(a["work"] for a, _ in pairs) / max(sum(b["work"] for _, b in pairs), 1e-9)
        ratio = f"{used:7.2f}" if pairs else " " * 7
        print(f"{rule.name:28}{acting:8}{len(pairs):7}{own:6}{other:8}{differ:8}{ratio}  {rule.says}")
    print("work: with the rule over without it, in these records")


def right(each: dict) -> bool:
    return each["outcome"] in RIGHT


def record(number: int, given: argparse.Namespace) -> Wanted:
    return Wanted(number, None, None, given.excitation, 0.01, given.duration, False, LIMIT_S)


def todo(given: argparse.Namespace, lines: list[dict]) -> list[Trial]:
    done = {each["number"] for each in lines if each["off"] is None}
    numbers = [k for k in range(given.first, given.first + given.note) if k not in done]
    again = wanted(lines, given.most) if given.off else []
    return [Trial(record(k, given), None) for k in numbers] + [
        Trial(record(k, given), off) for k, off in again
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "seod-ablation.jsonl")
    parser.add_argument("--note", type=int, default=0, help="records in which it is noted what acts")
    parser.add_argument("--off", action="store_true", help="ask anew where rules acted")
    parser.add_argument("--first", type=int, default=SEED_FIRST)
    parser.add_argument("--most", type=int, default=40, help="records without each rule")
    parser.add_argument("--excitation")
    parser.add_argument("--duration", type=float, default=12.0, help="of each record [s]")
    add_options(parser, workers=0)
    given = parser.parse_args()
    lines = [json.loads(row) for row in given.out.read_text().splitlines()] if given.out.exists() else []
    with given.out.open("a", encoding="utf-8") as out:
        for _, made in results(given, tried, todo(given, lines)):
            if isinstance(made, str):
                print(made, flush=True)
                continue
            lines.append(made)
            out.write(json.dumps(made) + "\n")
            out.flush()
            cause, named = "+".join(made["causes"]), "+".join(made["named"])
            said = f"{made['outcome']}: {cause} -> {made['verdict'][:30]} {named}, {made['seconds']:.1f} s"
            print(made["number"], made["off"] or "", said, flush=True)
    table(lines)


if __name__ == "__main__":
    main()
