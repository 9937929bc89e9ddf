"""Whether `wave` says what it does not know where gusts move the load: live answers, beside their errors.

    python bench/live_gusts.py [--seeds 8] [--gusts 0 20 60 200 400]

Recordings of 12 s at 1 kHz are simulated apart (`tests/unit/gusty_loop.py`: K_L 20, omega_n 100 rad/s; a
relay of 1 V with a hysteresis of 0.02), and fed row by row, K_L and delay known. Answers whose windows share
no sample count. The reference: the deviation that is told should be the error's, and 95 % intervals should
hold the truth in 95 of 100.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "unit"))

import numpy as np
from gusty_loop import DAMPED, TRUTH, N, T, relay, stepped

from seod.estimate import make_estimator
from seod.estimate.base import EstimatorSettings, Row

CYCLES = 6
"""Of the window; so many half cycles twice are between answers that count."""
HYSTERESIS, E_A = 0.02, 1.0


def answers(gusts: float, seed: int, truth: dict[str, float]) -> tuple[list[list[float]], list[str]]:
    """Of each answer that counts errors and deviations of omega_n and zeta, as logarithms; all qualities."""
    y, u = stepped(relay(), seed, truth, gusts)
    settings = EstimatorSettings(
        "wave", truth["K_L"], HYSTERESIS, 0.0, T[1], CYCLES, None, K_L_sd=0.0, delay_sd=0.0
    )
    estimator = make_estimator(settings)
    rows = (Row(T[k], y[k], u[k], T[k], 0.0, E_A, 0.0, exciting=True) for k in range(N))
    every = [one for row in rows if (one := estimator.update(row)) is not None]
    told = [one for one in every[20 :: 2 * CYCLES] if one.omega_n is not None and one.omega_n_sd is not None]
    numbers = [
        [
            math.log(one.omega_n / truth["omega_n"]),
            math.log(one.zeta / truth["zeta"]),
            one.omega_n_sd / one.omega_n,
            one.zeta_sd / one.zeta,
        ]
        for one in told
    ]
    return numbers, [one.quality for one in every]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--gusts", type=float, nargs="+", default=[0.0, 20.0, 60.0, 200.0, 400.0])
    asked = parser.parse_args()
    print("error (rms) / deviation as told (median), and intervals of 95 % that hold the truth")
    for truth in (DAMPED, TRUTH):
        for gusts in asked.gusts:
            every = [answers(gusts, seed, truth) for seed in range(1, asked.seeds + 1)]
            found = np.array([one for numbers, _ in every for one in numbers])
            qualities = [one for _, names in every for one in names]
            error, sd = found[:, :2], found[:, 2:]
            size, told = 100.0 * np.sqrt(np.mean(error**2, axis=0)), 100.0 * np.median(sd, axis=0)
            held = 100.0 * np.mean(np.abs(error) < 1.96 * sd, axis=0)
            print(
                f"zeta {truth['zeta']}, gusts {gusts:3.0f}: omega_n {size[0]:5.2f} / {told[0]:5.2f} %,"
                f" {held[0]:3.0f} %; zeta {size[1]:5.2f} / {told[1]:5.2f} %, {held[1]:3.0f} %;"
                f" {len(found)} answers, {100.0 * qualities.count('ok') / len(qualities):.0f} % ok",
                flush=True,
            )


if __name__ == "__main__":
    main()
