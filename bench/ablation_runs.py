"""One record of `bench/ablation.py`: asked with rules watched, or with one off. Workers import this."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from functools import partial, wraps
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from blind_runs import Wanted, hidden, told

from seod.diagnose.fitting import work
from seod.diagnose.fitting.judged import Judged

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Trial(NamedTuple):
    """A record, and the name of the rule that is off (None: all are on)."""

    record: Wanted
    off: str | None


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


RULES = (
    Rule("starts.search_roots:hidden_by_offset", first, "A root where an offset or a delay hides the plant."),
    Rule("search.final_choice:best_alike", first, "Of causes alike the one that fits best is in the set."),
    Rule("search.prune:plainer", first, "A richer form gives way to the plain one that does as well."),
    Rule("search.final_choice:_over_whole",
         lambda base, _grown, _wide, held, *_: (Judged.of(base, held), []),
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
    Rule("verdict.answer:trimmed", first, "Rows far off do not count, where a record has outliers."),
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


def tried(trial: Trial) -> dict | str:
    """The record's line as `bench/blind.py` writes it, with `off`, `acts` and the search's `work` [s]."""
    line = hidden(trial.record, partial(_asked, off=trial.off))
    return line if isinstance(line, str) else {"off": trial.off, "acts": {}, "work": 0.0} | line


def _asked(path: Path, output: str, *, off: str | None) -> tuple[dict, dict]:
    acts: Counter[str] = Counter()
    for rule in RULES:
        if rule.name == off:
            replaced(rule, rule.off)
        elif off is None:
            noted(rule, acts)
    before = work.used_s()
    said, costs = told(path, output)
    costs |= {"acts": {name: count for name, count in acts.items() if count}, "work": work.used_s() - before}
    return said, costs
