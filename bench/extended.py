"""The virtual rig made from a recording beside the rig that made it: does the limit cycle come back?

Each case hides effects in `configs/virtual.yaml`, records its relay, has `seod diagnose` find them, and lets
the extended rig swing by itself. Its frequency and amplitude, of the settled half, stand as deviations from
the recording's, beside those of the baseline (Eq. 1 as it was fitted).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from seod.config.edit import edited
from seod.data import read
from seod.files.shipped import configs_dir

CASES = {
    "friction": ["coulomb_friction.level=500"],
    "delay and friction": ["transport_delay.time=1.5e-3", "coulomb_friction.level=300"],
    "backlash": ["backlash.gap=0.02"],
    "overlap": ["valve_deadband.half_width=0.08"],
    "stiction of the spool": ["valve_hysteresis.half_width=0.05"],
    "spring and bias": ["load_spring.stiffness=1500", "load_bias.acceleration=300"],
    "square-root flow": ["square_root_flow.supply=1500"],
}


def seod(*words: object) -> str:
    """What a command prints."""
    command = [sys.executable, "-m", "seod.cli", *map(str, words)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def limit_cycle(path: Path) -> tuple[float, float]:
    """Frequency [Hz] and amplitude [unit] of the settled half."""
    data = read(path)
    half = slice(len(data.t) // 2, None)
    rows = np.flatnonzero(np.diff(np.sign(data.u[half] - np.mean(data.u[half]))) > 0)
    t, y = data.t[half], data.y[half]
    swings = [np.ptp(y[a:b]) / 2.0 for a, b in pairwise(rows)]
    return (len(rows) - 1) / float(t[rows[-1]] - t[rows[0]]), float(np.median(swings))


def case(name: str, effects: list[str], folder: Path, seconds: float) -> None:
    """One line of the table."""
    recording, found = folder / "run.csv", folder / "found"
    words = [word for effect in effects for word in ("--effect", effect)]
    seod("simulate", configs_dir() / "virtual.yaml", "--out", recording, "--duration", seconds, *words)
    answer = json.loads(seod("diagnose", recording, "--units", "y=rad", "--out", found, "--json"))
    extended = found / "extended.yaml"
    base = {key: answer["baseline"][key] for key in ("K_L", "omega_n", "zeta")} | {"effects": {}}
    places = {("simulation", "plants", "plant", key): value for key, value in base.items()}
    (found / "baseline.yaml").write_text(edited(extended.read_text(), places))
    cycles = [limit_cycle(recording)]
    for rig in ("baseline", "extended"):
        seod("simulate", found / f"{rig}.yaml", "--out", folder / f"{rig}.csv", "--duration", seconds)
        cycles.append(limit_cycle(folder / f"{rig}.csv"))
    told = ", ".join(effect["name"] for effect in answer["effects"]) or "-"
    ratios = [
        f"{100 * (a / b - 1):+7.2f} %" for each in cycles[1:] for a, b in zip(each, cycles[0], strict=True)
    ]
    print(f"{name:20} {told:40} {cycles[0][0]:7.3f} {cycles[0][1]:8.4f}  {' '.join(ratios)}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--case", choices=CASES, default=None)
    options = parser.parse_args()
    print(f"{'hidden':20} {'found':40} {'Hz':>7} {'rad':>8}  baseline: Hz, rad    extended: Hz, rad")
    for name, effects in CASES.items():
        if options.case in (None, name):
            with tempfile.TemporaryDirectory() as folder:
                case(name, effects, Path(folder), options.seconds)


if __name__ == "__main__":
    main()
