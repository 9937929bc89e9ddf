"""One hidden record of `bench/blind.py`: drawn, asked of the diagnosis, judged. Workers import this."""

from __future__ import annotations

import math
import resource
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import Case, Invisible, draw
from hidden_records import make_record, write
from hidden_rough import Rough, make_rough_record, rough
from hidden_score import outcome, parameters
from hidden_truth import told_by_file, told_by_rough_file

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.result import DiagnoseError

if TYPE_CHECKING:
    from collections.abc import Callable

LATE = "no answer in time"


class Wanted(NamedTuple):
    """A record: its number, what is fixed of it (None: drawn), processor time of its diagnosis [s]."""

    number: int
    kind: str | None
    causes: tuple[str, ...] | None
    excitation: str | None
    noise: float
    duration: float | None
    rough: bool
    limit: int


def told(path: Path, output: str) -> tuple[dict, dict]:
    """What the diagnosis says of a file, as JSON, and what it took."""
    before = process_time()
    try:
        said = diagnose([read(path)], (), Options(output=output)).as_json()
    except DiagnoseError as error:
        said = {"verdict": f"refused: {error}", "effects": []}
    return said, {"seconds": process_time() - before}


def hidden(wanted: Wanted, ask: Callable[[Path, str], tuple[dict, dict]] = told) -> dict | str:
    """The record's line of the results; why there is none, where its cause cannot be seen.

    Args:
        wanted: Which record.
        ask: Gives the answer to a file, and further fields of the line.
    """
    number, kind, causes, excitation, noise, duration = wanted[:6]
    try:
        case = draw(number, kind, causes, excitation, None, noise, duration)
    except Invisible as error:
        return str(error)
    how = rough(case) if wanted.rough else None
    with tempfile.TemporaryDirectory() as folder:
        return line(case, *answer(case, Path(folder), wanted.limit, how, ask), how)


def answer(
    case: Case, folder: Path, limit: int, how: Rough | None, ask: Callable[[Path, str], tuple[dict, dict]]
) -> tuple[dict, dict]:
    """What `ask` gives for the case's file, in a process of its own, which the kernel ends at the limit."""
    path = folder / "run.csv"
    write(make_record(case) if how is None else make_rough_record(case, how), path)
    output = "velocity" if case.rig.sees_speed else "position"
    with ProcessPoolExecutor(1, get_context("fork"), _bounded, (limit,)) as pool:
        try:
            return pool.submit(ask, path, output).result()
        except BrokenProcessPool:
            return {"verdict": LATE, "effects": []}, {"seconds": float(limit)}
        except (ValueError, ArithmeticError) as error:
            return {"verdict": f"broke off: {error}", "effects": []}, {"seconds": math.nan}


def _bounded(limit: int) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))


def line(case: Case, said: dict, further: dict, how: Rough | None = None) -> dict:
    truth = told_by_file(case) if how is None else told_by_rough_file(case, how)
    judged = said if how is None else how.forgiven(case.causes, said)
    return {
        "rough": None if how is None else how.as_json(),
        "number": case.number,
        "kind": case.kind,
        "causes": list(case.causes),
        "excitation": case.excitation,
        "output": "velocity" if case.rig.sees_speed else "position",
        "noise_part": case.noise_part,
        "visible": case.visible,
        "plant": [case.rig.K_L, case.rig.omega_n, case.rig.zeta],
        "effects": case.rig.effects,
        "defects": case.defects,
        "outcome": outcome(case.kind, case.causes, judged),
        "verdict": said["verdict"],
        "named": [each["name"] for each in said["effects"]],
        "as_well": [each["indistinguishable_from"] for each in said["effects"]],
        "p_values": [each["p_value"] for each in said["effects"]],
        "parameters": parameters(truth, judged),
        "before": (said.get("baseline") or {}).get("holdout_nrmse"),
        "after": (said.get("extended") or {}).get("holdout_nrmse"),
        "floor": said.get("noise_floor_nrmse"),
        "account": said.get("account"),
        "found_plant": [(said.get("extended") or {}).get(name) for name in ("K_L", "omega_n", "zeta")],
    } | further
