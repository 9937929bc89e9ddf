"""Whether the share of noise that acts on the load is told, and how well: intervals that hold it.

    python bench/load_noise.py [--seeds 3]

A plant's load is shaken by random torques of two colours and its readings have a sensor's noise (white, and
AR(1) of 0.95 and 0.99), in five proportions, over eight windows of 1.5 s at 1 kHz; three plants, positions
and speeds. The generator is that of `tests/unit/test_diagnose_load_noise.py`: exponentials of matrices.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "unit"))

from test_diagnose_load_noise import alike, coloured, shaken, windows

from seod.diagnose.account.load_noise import on_load
from seod.diagnose.account.residual import Plant

PLANTS = ((100.0, 0.3), (100.0, 1.5), (30.0, 0.1))
SHARES = (0.0, 0.1, 0.5, 0.9, 1.0)
ROUNDING = 0.01
"""Share that an interval may miss by: a proportion of 0 has no interval below it."""


def main() -> None:
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    print(f"{'y':10}{'sensor':>8}{'held':>12}{'mean width':>12}{'mean error':>12}")
    spent = count = 0.0
    for speed, memory in product((False, True), (0.0, 0.95, 0.99)):
        held, width, off = [], [], []
        for (omega_n, zeta), corner, seed in product(PLANTS, (1.0, 10.0), range(seeds)):
            plant = Plant(omega_n, zeta, speed)
            load, sensor = alike(shaken(plant, corner, 2 * seed)), alike(coloured(memory, 2 * seed + 1))
            for share in SHARES:
                parts = windows(np.sqrt(share) * load + np.sqrt(1.0 - share) * sensor)
                begin = time.process_time()
                found = on_load(parts, plant)
                spent, count = spent + time.process_time() - begin, count + 1
                held.append(found.least - ROUNDING <= share <= found.most + ROUNDING)
                width.append(found.most - found.least)
                off.append(abs(found.share - share))
        name = "speed" if speed else "position"
        rate = f"{sum(held)} of {len(held)}"
        print(f"{name:10}{memory:8}{rate:>12}{np.mean(width):12.2f}{np.mean(off):12.2f}")
    print(f"{1e3 * spent / count:.0f} ms of processor time each")


if __name__ == "__main__":
    main()
