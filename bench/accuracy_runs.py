"""What each estimator says of one record, and the lines of the file that keeps it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import baselines
import kept_runs
import numpy as np
from accuracy_cases import TICK, Case
from accuracy_truth import CYCLES, K_L, Run, bound, make

from seod.estimate import make_estimator

if TYPE_CHECKING:
    from seod.estimate.base import Estimate, Row

BLOCK = 25
"""Runs in a line of the file."""
DAEMON = ("wave", "exact", "peaks")
USERS = ("EKF", "RLS")
METHODS = (*DAEMON, *USERS)
COMPARED = 1
"""Blocks of a case in which all methods run; in the others only `wave`, whose intervals want many runs."""

Numbers = list[float]
"""Relative error and standard deviation of omega_n, then of zeta."""


class Said(NamedTuple):
    """By one method of one record."""

    quality: str
    last: Numbers | None
    """At its end; None where the method has no number."""
    first_after: float | None = None
    """Cycles from the start to the first `ok`."""
    first: Numbers | None = None
    """That answer."""


class Heard(NamedTuple):
    """Of one record: the bound of the relative errors of omega_n and zeta, and what each method said."""

    bound: list[float]
    said: dict[str, Said]


def hear(case: Case, seed: int, compared: bool = True) -> Heard:
    """One record and `wave`, or all methods that suit it."""
    run = make(case, seed)
    rows = run.rows()
    begin, said = run.t[-1] - (CYCLES + 0.5) * run.period, {}
    for method in DAEMON if compared else DAEMON[:1]:
        answers = _answers(method, run, rows)
        said[method] = _of_daemon(run, answers)
        if method == "wave" and answers and answers[-1].lag_s:
            begin = answers[-1].t - 2.0 * answers[-1].lag_s
    if compared and not (case.speed or case.free):
        said |= _of_users(run, seed)
    return Heard([float(f"{x:.5g}") for x in bound(run, begin)], said)


def _answers(method: str, run: Run, rows: list[Row]) -> list[Estimate]:
    estimator = make_estimator(run.settings(method))
    return [answer for row in rows if (answer := estimator.update(row)) is not None]


def _of_daemon(run: Run, answers: list[Estimate]) -> Said:
    if not answers:
        return Said("settling", None)
    good = next((a for a in answers if a.quality == "ok"), None)
    if good is None:
        return Said(answers[-1].quality, _numbers(run, answers[-1]))
    after = round(float((good.t - run.t[0]) / run.period), 3)
    return Said(answers[-1].quality, _numbers(run, answers[-1]), after, _numbers(run, good))


def _numbers(run: Run, a: Estimate) -> Numbers | None:
    if a.omega_n is None or a.zeta is None:
        return None
    omega_n_sd, zeta_sd = (math.nan if sd is None else sd for sd in (a.omega_n_sd, a.zeta_sd))
    return _relative(run, (a.omega_n, omega_n_sd, a.zeta, zeta_sd))


def _relative(run: Run, values: baselines.Answer) -> Numbers:
    omega_n, omega_n_sd, zeta, zeta_sd = values
    of_omega_n = omega_n / run.plant.omega_n - 1.0, omega_n_sd / run.plant.omega_n
    of_zeta = zeta / run.plant.zeta - 1.0, zeta_sd / run.plant.zeta
    return [float(f"{x:.5g}") for x in (*of_omega_n, *of_zeta)]


def _of_users(run: Run, seed: int) -> dict[str, Said]:
    """The baselines get the whole record; the filter's first guess is wrong by as much as it reckons with."""
    rng = np.random.default_rng([seed, 2])
    off = np.exp(np.array(baselines.GUESS) * np.clip(rng.standard_normal(2), -2.0, 2.0))
    delay, omega = run.case.delay, 2.0 * math.pi / run.period
    guess = (run.plant.omega_n * off[0], run.plant.zeta * off[1])
    found = {
        "EKF": baselines.kalman(run.y, run.u, TICK, delay, K_L, run.sigma, guess),
        "RLS": baselines.least_squares(run.y, run.u, TICK, delay, omega),
    }
    return {name: _of_user(run, answer) for name, answer in found.items()}


def _of_user(run: Run, answer: baselines.Answer | None) -> Said:
    if answer is None or not all(math.isfinite(x) for x in answer):
        return Said("out_of_range", None)
    return Said("ok", _relative(run, answer))


def line(case: Case, block: int, digest: str) -> str:
    """`BLOCK` runs of a case as a line of JSON."""
    heard = [hear(case, block * BLOCK + k, block < COMPARED) for k in range(BLOCK)]
    return json.dumps({"case": case.name, "block": block, "digest": digest, "heard": heard})


def read(path: Path, digest: str | None) -> dict[str, dict[int, list[Heard]]]:
    """What a file holds by case and block (`kept_runs.read`)."""
    return kept_runs.read(path, digest, lambda one: Heard(one[0], {k: Said(*x) for k, x in one[1].items()}))


def sources() -> str:
    """Digest of all that decides the numbers: results of other sources do not count."""
    here = Path(__file__).parent
    paths = [*sorted((here.parent / "seod" / "estimate").rglob("*.py")), here / "baselines.py"]
    paths += [here / f"accuracy_{name}.py" for name in ("cases", "truth", "runs")]
    return kept_runs.digest_of(paths)
