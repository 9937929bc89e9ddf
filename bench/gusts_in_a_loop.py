"""How near Eq. 1 comes to the plant where a relay answers to gusts that move the load.

    python bench/gusts_in_a_loop.py [--seeds 8] [--gusts 60 200 400 700]

Recordings of 12 s at 1 kHz are simulated apart (`tests/unit/gusty_loop.py`: K_L 20, omega_n 100 rad/s,
zeta 0.8). For each size of gusts: how much of the movement they make, over what the relay makes; the root
mean square error of K_L, omega_n and zeta of each fit; how many of its 95 % intervals hold the truth. The
reference is a fit whose noise is known: an autoregression of the same disturbance, without a command.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "unit"))

import numpy as np
from gusty_loop import DAMPED, N, by_simulation, off, relay, stepped

from seod.diagnose.account.prediction_errors import Predictions
from seod.diagnose.fitting.uncertainty import covariance

ORDER = 128
"""Rows of the known noise."""


def known_noise(gusts: float, seed: int) -> tuple[float, ...]:
    """Memory of what such gusts make of the readings, beside no command; of other random numbers."""
    y, _ = stepped(lambda _y, _k: 0.0, seed + 1000, DAMPED, gusts)
    past = np.column_stack([y[ORDER - k : N - k] for k in range(1, ORDER + 1)])
    return tuple(np.linalg.lstsq(past, y[ORDER:], rcond=None)[0].tolist())


def fits(gusts: float, seed: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of each fit errors of the three numbers, as logarithms, and their deviations as told."""
    plain, halves = by_simulation(*stepped(relay(), seed, DAMPED, gusts))
    how = Predictions(plain, halves, map, lambda: lambda: False)
    known = plain.cut.remembering(known_noise(gusts, seed))
    found = {
        "simulation": plain,
        "prediction errors": how.with_own_noise(plain),
        "noise known": how.fitted(plain.model, how.with_own_noise(plain), known),
    }
    return {name: (off(one, DAMPED), np.sqrt(np.diag(covariance(one)))) for name, one in found.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--gusts", type=float, nargs="+", default=[60.0, 200.0, 400.0, 700.0])
    asked = parser.parse_args()
    quiet = np.var(stepped(relay(), 1, DAMPED, 0.0)[0])
    for gusts in asked.gusts:
        seeds = range(1, asked.seeds + 1)
        every = [fits(gusts, seed) for seed in seeds]
        loud = np.mean([np.var(stepped(relay(), seed, DAMPED, gusts)[0]) for seed in seeds])
        share = np.sqrt(max(loud / quiet - 1.0, 0.0))
        print(f"gusts move {100.0 * share:.0f} % of what the relay does")
        for name in every[0]:
            error, sd = (np.array([one[name][k] for one in every]) for k in (0, 1))
            size = 100.0 * np.sqrt(np.mean(error**2, axis=0))
            held = np.mean(np.abs(error) < 1.96 * sd)
            print(
                f"  {name:18s} K_L {size[0]:5.1f} %  omega_n {size[1]:5.1f} %  zeta {size[2]:5.1f} %"
                f"  intervals {100.0 * held:3.0f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
