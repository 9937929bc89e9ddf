"""Two measured rigs in one simulation of the whole record: Eq. 1 and effects, beside the published figures.

    python bench/real_rigs.py FOLDER [--rig chirp|positioning]

FOLDER holds `servohydraulic_chirp.csv.gz` and `electromechanical_positioning.csv.gz`; without it nothing is
done. First what `seod diagnose` finds; then effects that are given here, by least squares on the whole
record: fitted are the samples of every other block of 2 s; the errors are those of the blocks between, and
of the whole record. Of a motor under friction Eq. 1 is a first-order lag: zeta is held at 20 there.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from seod.data import Recording, read
from seod.diagnose.pipeline import Options, diagnose
from sim.effects import EFFECTS
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state

if TYPE_CHECKING:
    from collections.abc import Callable

BLOCK_S = 2.0
NONE = np.empty(0)
PLAY = "valve_hysteresis.half_width"
Plant = tuple[float, float, float, dict[str, dict[str, float]]]
"""K_L, omega_n, zeta and effects."""


@dataclass
class Case:
    """One model of one rig: how searched numbers make a plant, and where they begin."""

    name: str
    plant: Callable[[np.ndarray], Plant]
    start: list[float]


def motor(x: np.ndarray) -> Plant:
    """K_L, the lag's rate, then Coulomb friction and load."""
    effects = {"coulomb_friction": {"level": abs(x[2])}} if len(x) > 2 else {}
    return (
        x[0],
        40.0 * abs(x[1]),
        20.0,
        effects | {"load_bias": {"acceleration": x[-1] if len(x) > 2 else 0.0}},
    )


def actuator(*more: str) -> Callable[[np.ndarray], Plant]:
    """K_L, omega_n, zeta, then the delay [ms] and one parameter of each further effect."""

    def plant(x: np.ndarray) -> Plant:
        effects = {"transport_delay": {"time": min(0.05, abs(1e-3 * x[3]))}}
        for place, value in zip(more, x[4:], strict=True):
            name, _, of = place.partition(".")
            effects[name] = {of: abs(value)}
        return x[0], abs(x[1]), abs(x[2]), effects

    return plant


RIGS = {
    "positioning": (
        "electromechanical_positioning.csv.gz",
        False,
        "published: linear 74.6 %, with friction and a plain stiction rule 4.6 %",
        [
            Case("Eq. 1", motor, [0.08, 3.0]),
            Case("coulomb_friction, load_bias", motor, [0.173, 2.14, 0.2143, -0.0333]),
        ],
    ),
    "chirp": (
        "servohydraulic_chirp.csv.gz",
        True,
        "published model 5.25 %, refitted 5.03 %, with a delay 4.40 %",
        [
            Case("transport_delay", actuator(), [1.02, 316.0, 3.7, 3.4]),
            Case("with coulomb_friction", actuator("coulomb_friction.level"), [1.0, 251.0, 2.9, 3.2, 10.0]),
            Case(
                "with valve_hysteresis",
                actuator("valve_hysteresis.half_width"),
                [1.0, 142.0, 1.67, 1.5, 0.046],
            ),
        ],
    ),
}


def simulated(data: Recording, plant: Plant, speed: bool) -> np.ndarray:
    """The whole record at once, from where it begins."""
    p = parameters(*plant, accuracy=0.3, measures_speed=float(speed))
    s = new_state(p, float(data.t[0]), 0.0 if speed else float(data.y[0]))
    s["velocity"] = data.y[0] if speed else 0.0
    y = np.empty(len(data.t))
    follow(p[0], s[0], data.t, data.u, data.t, NONE, NONE, NONE, NONE, y)
    return y


def fitted(data: Recording, case: Case, speed: bool, steps: int) -> tuple[np.ndarray, float, float]:
    """Numbers found, error of the blocks that were not fitted, and of the whole record."""
    fit = (((data.t - data.t[0]) // BLOCK_S) % 2 == 0).astype(bool)

    def left(x: np.ndarray) -> np.ndarray:
        error = data.y - simulated(data, case.plant(x), speed)
        return np.asarray((error - (error[fit].mean() if speed else 0.0)) / np.std(data.y))

    scale = np.maximum(np.abs(case.start), 1e-3)
    x = least_squares(lambda x: left(x)[fit], case.start, x_scale=scale, diff_step=1e-3, max_nfev=steps).x
    error = left(x)
    spread = np.std(data.y[~fit]) / np.std(data.y)
    return x, float(np.sqrt(np.mean(error[~fit] ** 2)) / spread), float(np.sqrt(np.mean(error**2)))


def searched(data: Recording, speed: bool) -> None:
    """Two lines: what `seod diagnose` starts from, and what it finds."""
    begun = time.process_time()
    d = diagnose([data], (), Options("velocity" if speed else "position"))
    names = ", ".join(effect.name for effect in d.effects if EFFECTS[effect.name].enters != "record")
    for name, score in (("seod diagnose: baseline", d.baseline), (names or "nothing", d.extended)):
        errors = f"held out {100 * score.holdout_nrmse:6.2f} %, whole {100 * score.whole_nrmse:6.2f} %"
        numbers = f"K_L {score.K_L:.4g}, omega_n {score.omega_n:.4g}, zeta {score.zeta:.3g}"
        print(f"  {name:44} {errors}   {numbers}", flush=True)
    effects = {name: d.extended.effects[name] for name in names.split(", ") if name in d.extended.effects}
    print(f"  {effects}, {d.verdict}, {time.process_time() - begun:.0f} s of processor time", flush=True)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=Path())
    parser.add_argument("--rig", choices=RIGS, default=None)
    parser.add_argument("--steps", type=int, default=12)
    options = parser.parse_args()
    for rig, (name, speed, published, cases) in RIGS.items():
        if options.rig not in (None, rig):
            continue
        if not (options.folder / name).exists():
            print(f"{rig}: left out, {options.folder / name} is not there")
            continue
        data = read(options.folder / name)
        print(f"{rig}: {published}")
        searched(data, speed)
        for case in cases:
            x, held_out, whole = fitted(data, case, speed, options.steps)
            numbers = ", ".join(f"{each:.4g}" for each in x)
            print(f"  {case.name:28} held out {held_out:6.2%}  whole {whole:6.2%}  ({numbers})", flush=True)


if __name__ == "__main__":
    main()
