"""What each rescue rule of the diagnosis is for, and whether it earns its place.

    python bench/ablation.py --out ablation.jsonl --note 400     # where each rule acts; resumes
    python bench/ablation.py --out ablation.jsonl --off          # those records again, that rule off
    python bench/ablation.py --out ablation.jsonl                # only the table

Records are those of `bench/blind.py`. A rule acts where it gives something else than if it were off:
`--note` writes down which did, and the answer; `--off` asks anew, with one rule off at a time, of records in
which it acted (at most `--most` of them). The table counts right answers with and without it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import wraps
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import Invisible, draw
from hidden_records import make_record, write
from hidden_score import outcome

from seod.data import read
from seod.diagnose.fitting import work
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.result import DiagnoseError

if TYPE_CHECKING:
    from collections.abc import Callable

SEED_FIRST = 43000
RIGHT = ("exact", "within")


@dataclass(frozen=True)
class Rule:
    """A rule by the function that is it.

    Attributes:
        place: Module and function, `module:function` or `module:Class.method`, in `seod.diagnose`.
        off: What is given instead where it is off, from the function's arguments.
        says: What it is for.
    """

    place: str
    off: Callable[..., Any]
    says: str

    @property
    def name(self) -> str:
        return self.place.split(":")[1]


def first(some, *_, **__):
    return some


def second(_, other, *__, **___):
    return other


def no(*_, **__):
    return False


def nothing(*_, **__):
    return ()


def none(*_, **__):
    return None


RULES = (
    Rule("pipeline:hidden_by_offset", first, "A fourth root, where an offset or a delay hides the plant."),
    Rule("starts.search_roots:less_damped", first, "An over-damped root far from the noise is damped less."),
    Rule("search.screen:Screen.watching", first, "The window that Eq. 1 fits worst is among those tried."),
    Rule("fitting.window_halves:finer", none, "More windows, where one half alone shows an effect."),
    Rule("fitting.window_halves:misfits", no, "`unexplained` where a fitted window has twice the noise."),
    Rule("fitting.window_halves:fits_both", no, "Explained where a fit of all windows leaves only noise."),
    Rule("search.final_choice:best_alike", first, "Of causes alike the one that fits best is in the set."),
    Rule("search.prune:plainer", first, "A richer form gives way to the plain one that does as well."),
    Rule("search.final_choice:_over_whole",
         lambda base, _grown, _wide, held, _screen: (Judged.of(base, held), []),
         "Whole recordings are fitted, where windows leave more than noise."),
    Rule("search.final_choice:worse", no, "No set is kept that simulates worse than the baseline."),
    Rule("search.refine:settled", first, "A set that leaves only noise is fitted until nothing changes."),
    Rule("search.refine:_uneven", no, "A set that fits some windows only begins anew at the grid's plants."),
    Rule("search.race:imitates", no, "A wave in step with the command, or the longest ripple, is no cause."),
    Rule("search.race:elsewhere", no, "A second plant of a set is kept, that fits worse alone."),
    Rule("search.race:_richer", lambda *_: [], "Richer forms also begin at the best set with the plain one."),
    Rule("search.race:_reaches_far", no, "Causes begin far from the parent's plant too."),
    Rule("starts.effect_starts:_where_it_oscillates", nothing, "A disturbance begins at omega_n too."),
    Rule("starts.relay.grid:grid_plants", nothing, "Plants of a relay's grid are starts."),
    Rule("starts.relay.grid:_disturbed", lambda *_: [], "So are plants that a disturbance drives."),
    Rule("starts.relay.grid:_ramped", lambda *_: [], "So are plants behind a slow valve."),
    Rule("fitting.least_squares:rounded", first, "From afar a coarse sensor's rounding is white noise."),
    Rule("fitting.least_squares:LeastSquares.bent", second, "Steps bend with the valley."),
    Rule("fitting.free_run:fitted_in_one_run", first, "Last a fit in one run, where that foretells more."),
    Rule("pipeline:trimmed", first, "Rows far off do not count, where a record has outliers."),
    Rule("verdict.effects:_over_the_sweep", lambda *_: [], "A drift under a sweep may be another cause."),
    Rule("starts.unsigned:unsigned_starts", nothing, "Readings without sign get the one of a plant."),
)  # fmt: skip


def found(rule: Rule) -> tuple[Any, str, Callable[..., Any]]:
    """Where the function is: its module or class, its name, itself."""
    module, _, name = rule.place.partition(":")
    owner: Any = import_module(f"seod.diagnose.{module}")
    *outer, name = name.split(".")
    for each in outer:
        owner = getattr(owner, each)
    return owner, name, getattr(owner, name)


def replaced(rule: Rule, other: Callable[..., Any]) -> None:
    """Put `other` in its place, and in that of all modules that import it."""
    owner, name, function = found(rule)
    setattr(owner, name, other)
    for module in list(sys.modules.values()):
        if isinstance(module, ModuleType) and module.__name__.startswith("seod.diagnose"):
            for own, value in list(vars(module).items()):
                if value is function:
                    setattr(module, own, other)


def noted(rule: Rule, acts: Counter[str]) -> None:
    """Count how often it gives something else than if it were off."""
    _, _, function = found(rule)

    @wraps(function)
    def watched(*args: Any, **more: Any) -> Any:
        result = function(*args, **more)
        if rule.off is first or rule.off is second:
            acts[rule.name] += result is not rule.off(*args)
        else:
            acts[rule.name] += bool(result)
        return result

    replaced(rule, watched)


def asked(path: Path, output: str, effort: str, off: str | None) -> tuple[dict, dict[str, int], float]:
    """The answer to a file, which rules acted, and the work [s]; in a process of its own."""
    acts: Counter[str] = Counter()
    for rule in RULES:
        if rule.name == off:
            replaced(rule, rule.off)
        elif off is None:
            noted(rule, acts)
    before = work.used_s()
    try:
        told = diagnose([read(path)], (), Options(output=output, effort=effort)).as_json()
    except (DiagnoseError, ValueError, ArithmeticError) as error:
        told = {"verdict": f"refused: {error}", "effects": []}
    return told, {name: count for name, count in acts.items() if count}, work.used_s() - before


def line(number: int, folder: Path, asked_for: argparse.Namespace, off: str | None) -> dict | None:
    """One record's answer, with all rules or without one."""
    try:
        case = draw(number, None, None, asked_for.excitation, None, 0.01, asked_for.duration)
    except Invisible:
        return None
    path = folder / "run.csv"
    write(make_record(case), path)
    output = "velocity" if case.rig.sees_speed else "position"
    with ProcessPoolExecutor(1, get_context("fork")) as pool:
        try:
            told, acts, used = pool.submit(asked, path, output, asked_for.effort, off).result()
        except BrokenProcessPool:
            told, acts, used = {"verdict": "broke off", "effects": []}, {}, 0.0
    return {
        "number": number,
        "off": off,
        "kind": case.kind,
        "causes": list(case.causes),
        "excitation": case.excitation,
        "outcome": outcome(case.kind, case.causes, told),
        "verdict": told["verdict"],
        "named": [each["name"] for each in told["effects"]],
        "held": (told.get("extended") or {}).get("holdout_nrmse"),
        "acts": acts,
        "work": used,
    }


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
    parser.add_argument("--effort", default="normal")
    given = parser.parse_args()
    lines = [json.loads(row) for row in given.out.read_text().splitlines()] if given.out.exists() else []
    done = {each["number"] for each in lines if each["off"] is None}
    todo = [(k, None) for k in range(given.first, given.first + given.note) if k not in done]
    todo += wanted(lines, given.most) if given.off else []
    with tempfile.TemporaryDirectory() as folder, given.out.open("a", encoding="utf-8") as out:
        for number, off in todo:
            if (made := line(number, Path(folder), given, off)) is not None:
                lines.append(made)
                out.write(json.dumps(made) + "\n")
                out.flush()
                hidden, named = "+".join(made["causes"]), "+".join(made["named"])
                said = f"{made['outcome']}: {hidden} -> {made['verdict']} {named}, {made['work']:.1f} s"
                print(number, off or "", said, flush=True)
    table(lines)


if __name__ == "__main__":
    main()
