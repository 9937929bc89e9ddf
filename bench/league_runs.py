"""What each method of the league says of one seed's records, and the lines of the file that keeps it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import kept_runs
from accuracy_cases import TICK, Case
from accuracy_truth import CYCLES, E_A, K_L, Run, bound, cycles_of, make
from league_cases import two_phases, unequal_levels
from league_rivals import TABLE
from league_rivals.base import Told, last_cycles

from seod.estimate import make_estimator

if TYPE_CHECKING:
    from league_rivals import Rival
    from league_rivals.base import Record

    from seod.estimate.base import Estimate

BLOCK = 10
"""Runs in a line of the file."""
COMPARED = 2
"""Blocks of a case with noise in which all methods run; in the others only `wave`."""
OURS = ("wave", "exact", "two-phase")
METHODS = (*OURS, "peaks", *TABLE)
STATES_INTERVALS = OURS
FAR = 2.0
"""An answer that is off by more than this factor counts as none: of rivals it would decide every mean."""
FED = 3
"""Cycles that ours are fed before the last window; those before tell them nothing."""
NOTHING_KNOWN = ("K_L", "delay")


class Said(NamedTuple):
    """By one method of one record."""

    quality: str
    """`ok`, or why there is no answer."""
    bound: list[float]
    """Cramer and Rao's of the relative errors of omega_n and zeta, for this record and what was told."""
    numbers: list[float] | None = None
    """Relative error and standard deviation of omega_n, then of zeta; nan where no deviation is stated."""


Heard = dict[str, Said]
"""By method."""


def hear(case: Case, seed: int, compared: bool = True) -> Heard:
    """The three records of a seed: under the relay as it is, with unequal levels, with two phases."""
    plain = make(case, seed)
    said = {"wave": _of_ours("wave", plain)}
    if not compared:
        return said
    limit = said["wave"].bound
    said |= {name: _of_ours(name, plain, limit) for name in ("exact", "peaks")}
    said["two-phase"] = _of_ours("wave", make(two_phases(case), seed))
    unequal = make(unequal_levels(case), seed)
    limits = {plain.case: limit, unequal.case: _bound(unequal)}
    for name, rival in TABLE.items():
        run = unequal if rival.unequal else plain
        here = _bound(run, NOTHING_KNOWN) if rival.told == "nothing" else limits[run.case]
        said[name] = _of_rival(rival, run, here)
    return said


def _of_ours(method: str, run: Run, limit: list[float] | None = None) -> Said:
    """By the daemon's estimator, fed row by row; the bound of its own window unless one is given."""
    estimator = make_estimator(run.settings(method))
    begins = run.t[-1] - (cycles_of(run.case) + FED) * run.period
    rows = (row for row in run.rows() if row.t >= begins)
    answers = [answer for row in rows if (answer := estimator.update(row)) is not None]
    last = answers[-1] if answers else None
    begin = last.t - 2.0 * last.lag_s if last and last.lag_s else None
    unknown = NOTHING_KNOWN if run.case.two_phase else ()
    here = limit or _bound(run, unknown, begin)
    if last is None or last.quality != "ok":
        return Said(last.quality if last else "settling", here)
    return _judged(here, _relative(run, last))


def _bound(run: Run, unknown: tuple[str, ...] = (), begin: float | None = None) -> list[float]:
    """For the window from `begin` [s] on, or the last whole cycles, which the rivals have."""
    return _rounded(bound(run, run.t[-1] - CYCLES * run.period if begin is None else begin, unknown))


def _relative(run: Run, answer: Estimate) -> list[float]:
    omega_n, zeta = run.plant.omega_n, run.plant.zeta
    omega_n_sd, zeta_sd = (math.nan if sd is None else sd for sd in (answer.omega_n_sd, answer.zeta_sd))
    return [answer.omega_n / omega_n - 1.0, omega_n_sd / omega_n, answer.zeta / zeta - 1.0, zeta_sd / zeta]


def told(run: Run) -> Told:
    """What a rival may know."""
    return Told(K_L, E_A, run.hysteresis, TICK, run.case.delay * TICK)


def cycles(run: Run) -> Record | None:
    """The last whole cycles of a record, as rivals get them."""
    return last_cycles(run.t, run.y, run.t_u, run.u, CYCLES)


def _of_rival(rival: Rival, run: Run, limit: list[float]) -> Said:
    record = cycles(run)
    found = rival.find(record, told(run)) if record else None
    if found is None:
        return Said("none", limit)
    errors = found.omega_n / run.plant.omega_n - 1.0, found.zeta / run.plant.zeta - 1.0
    return _judged(limit, [errors[0], math.nan, errors[1], math.nan])


def _judged(limit: list[float], numbers: list[float]) -> Said:
    ratios = 1.0 + numbers[0], 1.0 + numbers[2]
    if not all(math.isfinite(x) and 1.0 / FAR < x < FAR for x in ratios):
        return Said("far off", limit)
    return Said("ok", limit, _rounded(numbers))


def _rounded(numbers) -> list[float]:
    return [float(f"{x:.5g}") for x in numbers]


def line(case: Case, block: int, digest: str) -> str:
    """`BLOCK` runs of a case as a line of JSON."""
    compared = block < COMPARED
    heard = [hear(case, block * BLOCK + k, compared) for k in range(BLOCK)]
    return json.dumps({"case": case.name, "block": block, "digest": digest, "heard": heard})


def read(path: Path, digest: str | None) -> dict[str, dict[int, list[Heard]]]:
    """What a file holds by case and block (`kept_runs.read`)."""
    return kept_runs.read(path, digest, lambda said: {name: Said(*x) for name, x in said.items()})


def sources() -> str:
    """Digest of all that decides the numbers: results of other sources do not count."""
    here = Path(__file__).parent
    paths = [
        *sorted((here.parent / "seod" / "estimate").rglob("*.py")),
        *sorted(here.glob("league_rivals/*.py")),
    ]
    paths += [
        here / f"{name}.py" for name in ("accuracy_cases", "accuracy_truth", "league_cases", "league_runs")
    ]
    return kept_runs.digest_of(paths)
