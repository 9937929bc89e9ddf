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
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import Case, Invisible, draw, supply_of
from hidden_records import make_record, write
from hidden_rough import Rough, make_rough_record, rough
from hidden_score import outcome, parameters

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.result import DiagnoseError

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


def hidden(wanted: Wanted) -> dict | str:
    """The record's line of the results; why there is none, where its cause cannot be seen."""
    number, kind, causes, excitation, noise, duration = wanted[:6]
    try:
        case = draw(number, kind, causes, excitation, None, noise, duration)
    except Invisible as error:
        return str(error)
    how = rough(case) if wanted.rough else None
    with tempfile.TemporaryDirectory() as folder:
        return line(case, *answer(case, Path(folder), wanted.limit, how), how)


def answer(case: Case, folder: Path, limit: int, how: Rough | None = None) -> tuple[dict, float]:
    """What the diagnosis says of the case's file, and what it took [s of processor time].

    In a process of its own, which the kernel ends at the limit.
    """
    path = folder / "run.csv"
    write(make_record(case) if how is None else make_rough_record(case, how), path)
    output = "velocity" if case.rig.sees_speed else "position"
    with ProcessPoolExecutor(1, get_context("fork")) as pool:
        try:
            return pool.submit(_told, path, output, limit).result()
        except BrokenProcessPool:
            return {"verdict": LATE, "effects": []}, float(limit)
        except (ValueError, ArithmeticError) as error:
            return {"verdict": f"broke off: {error}", "effects": []}, math.nan


def _told(path: Path, output: str, limit: int) -> tuple[dict, float]:
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    before = process_time()
    try:
        told = diagnose([read(path)], (), Options(output=output)).as_json()
    except DiagnoseError as error:
        told = {"verdict": f"refused: {error}", "effects": []}
    return told, process_time() - before


def _told_by_file(case: Case) -> dict:
    """Effects as far as a file can tell: of a speed neither the position nor the phase of its ripple.

    The air in the oil is told at the median of the supply pressure, which no file says to be nominal or not.
    """
    values = {name: dict(group) for name, group in case.rig.effects.items()}
    if case.rig.sees_speed:
        values.get("position_ripple", {}).pop("phase", None)
        values.get("load_spring", {}).pop("centre", None)
    if air := values.get("pressure_dependent_stiffness"):
        air["air"] /= float(np.median(supply_of(case))) ** 2
    return values | ({case.causes[0]: _defect(case)} if case.defects else {})


def _defect(case: Case) -> dict[str, float]:
    names = {"jitter": "deviation", "part": "rate"}
    return {names.get(name, name): value for name, value in case.defects.items()}


def _told_by_rough_file(case: Case, how: Rough) -> dict:
    return {
        name: {
            of: how.converted(f"{name}.{of}", value, sees_speed=case.rig.sees_speed)
            for of, value in group.items()
        }
        for name, group in _told_by_file(case).items()
    }


def line(case: Case, told: dict, seconds: float, how: Rough | None = None) -> dict:
    truth = _told_by_file(case) if how is None else _told_by_rough_file(case, how)
    judged = told if how is None else how.forgiven(case.causes, told)
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
        "verdict": told["verdict"],
        "named": [each["name"] for each in told["effects"]],
        "as_well": [each["indistinguishable_from"] for each in told["effects"]],
        "parameters": parameters(truth, judged),
        "before": (told.get("baseline") or {}).get("holdout_nrmse"),
        "after": (told.get("extended") or {}).get("holdout_nrmse"),
        "floor": told.get("noise_floor_nrmse"),
        "found_plant": [(told.get("extended") or {}).get(name) for name in ("K_L", "omega_n", "zeta")],
        "seconds": seconds,
    }
