"""Two benchmarks of nonlinearbenchmark.org: fitted on the estimation part, scored in a free run of the test.

    python bench/public.py FOLDER [--open-test] [--rig positioning|drives]

FOLDER holds `DATA_EMPS.mat` and `DATA_EMPS_PULSES.mat` (electro-mechanical positioning system: A. Janot,
M. Gautier, M. Brunot, 2019) and `DATAUNIF.MAT` (coupled electric drives: T. Wigren, M. Schoukens, 2017). The
data carry no licence and are not part of this repository; without them nothing is done.

Only the estimation part is fitted. Without `--open-test` its own end takes the place of the test part (the
last sixth of the drives, the last third of the positioning record), so that work on the diagnosis never looks
at the test part. Official splits: of each drives record the first 300 samples are for estimation, the other
200 for the test, simulated on from the first sample of the record; the positioning test is another record.
Printed are root mean squares of the error in the board's units beside published ones, the causes named with
their intervals, and the processor time, whose limit is 120 s each.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.io import loadmat

from seod.data import Recording, read
from seod.diagnose.extend.model import Model
from seod.diagnose.pipeline import Options, diagnose
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from seod.diagnose.result import Diagnosis

DRIVES_TICK_S, DRIVES_FITTED = 0.02, 300
LIMIT_S = 120.0


@dataclass(frozen=True)
class Part:
    """A record in SI, and the first row that is scored."""

    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    scored: int = 0


@dataclass(frozen=True)
class Rig:
    """One benchmark.

    Attributes:
        fitted: Records, and what is scored of each.
        scored: Records whose rows from `scored` on are.
        output: What `y` is.
        unit: Of the board, and its size in SI.
        published: What others reached.
    """

    name: str
    fitted: tuple[Part, ...]
    scored: tuple[Part, ...]
    output: str
    unit: tuple[str, float]
    published: str


def positioning(folder: Path, open_test: bool) -> Rig:
    """Motor command [V] to position [m], 1 kHz."""
    fitted = _positioning(folder / "DATA_EMPS.mat")
    if open_test:
        scored = _positioning(folder / "DATA_EMPS_PULSES.mat")
    else:
        row = 2 * len(fitted.t) // 3
        scored = Part(fitted.t, fitted.u, fitted.y, row)
        fitted = Part(fitted.t[:row], fitted.u[:row], fitted.y[:row])
    published = "best black box 2.64 (dynoNet and others), published friction model about 4"
    return Rig("positioning", (fitted,), (scored,), "position", ("mm", 1e-3), published)


def _positioning(path: Path) -> Part:
    data = loadmat(path)
    return Part(*(np.asarray(data[name], float).ravel() for name in ("t", "vir", "qm")))


def drives(folder: Path, open_test: bool) -> Rig:
    """Sum of two motors' voltages to the absolute value of a pulley's speed, 50 Hz."""
    data = loadmat(folder / "DATAUNIF.MAT")
    end = 500 if open_test else DRIVES_FITTED
    fitted = DRIVES_FITTED if open_test else 5 * DRIVES_FITTED // 6
    t = DRIVES_TICK_S * np.arange(end)
    every = [
        (np.asarray(data[f"u1{k}"], float).ravel(), np.asarray(data[f"z1{k}"], float).ravel()) for k in "12"
    ]
    return Rig(
        "drives",
        tuple(Part(t[:fitted], u[:fitted], y[:fitted]) for u, y in every),
        tuple(Part(t, u[:end], y[:end], fitted) for u, y in every),
        "velocity",
        ("ticks/s", 1.0),
        "0.062 and 0.047 (best), 0.074 and 0.086",
    )


def written(parts: tuple[Part, ...], folder: Path, name: str) -> list[Recording]:
    """As `seod` reads them."""
    out = []
    for k, part in enumerate(parts):
        path = folder / f"{name}{k}.csv"
        table = np.column_stack([part.t, part.u, part.y])
        np.savetxt(path, table, fmt="%.12g", delimiter=",", header="t,u,y", comments="")
        out.append(read(path))
    return out


def errors(rig: Rig, told: Diagnosis) -> Iterator[tuple[float, float]]:
    """Of each scored record: the error's root mean square in one run, and that of a mean [board's unit]."""
    simulated = told.whole[len(rig.fitted) :]
    for part, run in zip(rig.scored, simulated, strict=True):
        rows = slice(part.scored, None)
        error = run.y - run.y_extended
        plain = run.y[rows] - np.nanmean(run.y[rows])
        yield tuple(float(np.sqrt(np.nanmean(each**2))) / rig.unit[1] for each in (error[rows], plain))  # type: ignore[misc]


def at_mean_load(rig: Rig, told: Diagnosis) -> Iterator[float]:
    """Likewise where the load stays at its mean over the record that was fitted, from the measured start."""
    fitted, plant = rig.fitted[0], told.extended
    model = Model(plant.K_L, plant.omega_n, plant.zeta, plant.effects).steady(float(np.ptp(fitted.t)))
    if model.effects == plant.effects:
        return
    p = parameters(model.K_L, model.omega_n, model.zeta, model.effects, accuracy=0.3)
    for part in rig.scored:
        state = new_state(p, float(part.t[0]), float(part.y[0]))
        y, none = np.empty(len(part.t)), np.empty(0)
        follow(p[0], state[0], part.t, part.u, part.t, none, none, none, none, y)
        yield float(np.sqrt(np.mean((part.y - y)[part.scored :] ** 2))) / rig.unit[1]


def report(rig: Rig, effort: str) -> None:
    """Fit, score, print."""
    import tempfile

    begin = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        given = written(rig.fitted, folder, "fitted"), written(rig.scored, folder, "scored")
        told = diagnose(*given, Options(rig.output, effort=effort))  # type: ignore[arg-type]
    used = time.process_time() - begin
    late = "" if used <= LIMIT_S else f", over {LIMIT_S:.0f} s"
    print(f"{rig.name}: {told.verdict}, {used:.0f} s of processor time{late}")
    for each in told.effects:
        numbers = ", ".join(
            f"{name} {p.value:.4g} [{p.ci95[0]:.4g}, {p.ci95[1]:.4g}] {p.unit}".rstrip()
            for name, p in each.parameters.items()
        )
        print(f"  {each.name}: {numbers}")
    plant = told.extended
    print(f"  K_L {plant.K_L:.4g}, omega_n {plant.omega_n:.4g} rad/s, zeta {plant.zeta:.4g}")
    for k, ((rms, mean), run) in enumerate(
        zip(errors(rig, told), told.extended.free_runs[len(rig.fitted) :], strict=True)
    ):
        measured = f", from the measured start at rest {run.from_measured / rig.unit[1]:.3g}"
        more = measured if rig.scored[k].scored == 0 else ""
        print(
            f"  free run {k + 1}: {rms:.4g} {rig.unit[0]}{more}; a mean {mean:.3g}; published {rig.published}"
        )
    for rms in at_mean_load(rig, told):
        print(f"  from the measured start, the load at its mean as fitted: {rms:.4g} {rig.unit[0]}")
    for each in told.remarks:
        print(f"  {each}")


RIGS: dict[str, Callable[[Path, bool], Rig]] = {"positioning": positioning, "drives": drives}


def main() -> None:
    """Print what is found of each rig whose data are there."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--rig", choices=RIGS, action="append")
    parser.add_argument("--open-test", action="store_true", help="score the test part: once")
    parser.add_argument("--effort", choices=("quick", "normal", "thorough"), default="normal")
    asked = parser.parse_args()
    if asked.folder is None:
        print("no folder with the benchmarks' data given: nothing done")
        return
    for name in asked.rig or RIGS:
        report(RIGS[name](asked.folder, asked.open_test), asked.effort)


if __name__ == "__main__":
    main()
