"""What a recording of a hidden case holds, and the file that a diagnosis is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from hidden_cases import channel_of, run, supply_of

if TYPE_CHECKING:
    from hidden_cases import Case


@dataclass(frozen=True)
class Record:
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    t_u: np.ndarray | None
    ps: np.ndarray | None
    f: np.ndarray | None = None


def make_record(case: Case) -> Record:
    """What the file holds: with noise and the record's defects."""
    random = np.random.default_rng([case.number, 4])
    y, u = run(case, random.normal(0.0, case.noise, len(case.t)))
    y = with_defects(case, y, random)
    supply = supply_of(case)
    t_u = case.t + case.latency if case.latency else None
    return Record(case.t, u, y, t_u, None if supply is None else 7e6 * supply, channel_of(case))


def with_defects(case: Case, y, random):
    """Readings with the outliers and the holes of a case."""
    if "rate" in case.defects:
        off = random.random(len(y)) < case.defects["rate"]
        y = y + off * random.normal(0.0, case.defects["size"], len(y))
    if "part" in case.defects:
        y = np.where(_holes(len(y), case.defects, random), np.nan, y)
    return y


def _holes(n, defects, random):
    holes = np.zeros(n, bool)
    for at in np.flatnonzero(random.random(n) < defects["part"] / defects["length"]):
        holes[at : at + int(random.geometric(1.0 / defects["length"]))] = True
    return holes


def write(record: Record, path) -> None:
    """A CSV file with nothing in it but the measured data."""
    columns = {"t": record.t, "u": record.u, "y": record.y, "t_u": record.t_u, "ps": record.ps, "f": record.f}
    present = {name: x for name, x in columns.items() if x is not None}
    table = np.column_stack(list(present.values()))
    with path.open("w", encoding="ascii") as file:
        file.write(",".join(present) + "\n")
        for row in table.tolist():
            file.write(",".join("" if math.isnan(x) else f"{x:.9g}" for x in row) + "\n")
