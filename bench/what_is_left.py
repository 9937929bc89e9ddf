"""What passes for systematic by chance, and how small a systematic part shows beside noise.

    python bench/what_is_left.py [--records 320] [--first 100] [--gusts] [--moves]

Each record is a plant of its own (5 to 300 rad/s, zeta 0.1 to 1.2) under a sweep, a multisine, filtered noise
or steps (with `--moves` all under moves with rests between them), as a position or a speed, in 4 to 8
windows. What its model leaves is noise alone: AR(1) of 0 to 0.997, or with `--gusts` a coloured torque on the
load with a tenth of white noise on the reading. Printed are the records in which the black box takes it for
systematic, of which 0.2 % are meant to be, and the share of the records in which as much again of something
systematic would have been shown. Then the same of what is larger as the load moves: by chance, and with as
much again of what a plant leaves whose omega_n is 15 % off.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import expm
from scipy.signal import chirp, cont2discrete, lfilter

from seod.diagnose.account.black_box import foretold
from seod.diagnose.account.chance import usable
from seod.diagnose.account.residual import Plant, WindowResidual, mean_square
from seod.diagnose.account.with_movement import comes_with_movement
from seod.diagnose.fitting.noise_colour import colour
from seod.diagnose.tuning.account import SYSTEMATIC

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

COMMANDS = ("sweep", "multisine", "noise", "steps")
MEMORIES = (0.0, 0.9, 0.95, 0.99, 0.997)
MOVES = 0.3
"""Part of the time in which a machine moves."""
BEFORE = 5000
"""Rows of noise before the record."""


WRONG = 1.15
"""Times omega_n: of a plant that is taken for another."""


def command(kind: str, t: Array, omega_n: float, random: np.random.Generator) -> Array:
    """From -1 to 1."""
    n, tick, hertz = len(t), float(t[1]), omega_n / (2.0 * math.pi)
    if kind == "sweep":
        u = chirp(t, 0.1 * hertz, t[-1], 3.0 * hertz, method="logarithmic")
    elif kind == "multisine":
        lines = np.arange(1, 40) / (n // 8 * tick)
        lines = lines[lines < 4.0 * hertz]
        u = np.cos(2.0 * math.pi * np.outer(t, lines) + random.uniform(0.0, 6.3, len(lines))).sum(axis=1)
    elif kind == "noise":
        u = lfilter([1.0], [1.0, -math.exp(-omega_n * tick)], random.normal(size=n))
    elif kind == "moves":
        rows = int(6.0 / omega_n / tick)
        sizes = random.uniform(-1.0, 1.0, n // rows + 1) * (random.random(n // rows + 1) < MOVES)
        u = np.repeat(sizes, rows)[:n]
    else:
        rows = int(6.0 / omega_n / tick)
        u = np.repeat(random.uniform(-1.0, 1.0, n // rows + 1), rows)[:n]
    u = u - (0.0 if kind == "moves" else u.mean())
    return np.asarray(u / np.abs(u).max())


def moved(u: Array, omega_n: float, zeta: float, tick: float, spring: float = 0.0) -> Array:
    """Pressure, velocity and position of Eq. 1 with K_L = 1, by a matrix exponential; shape (3, n).

    A spring over the oil's stiffness pulls the load to the middle.
    """
    oil = omega_n**2
    a = np.array([[-2.0 * zeta * omega_n, -oil, 0.0], [1.0, 0.0, -spring * oil], [0.0, 1.0, 0.0]])
    both = np.zeros((4, 4))
    both[:3, :3], both[0, 3] = a, omega_n**2
    step = expm(both * tick)
    state, out = np.zeros(3), np.empty((3, len(u)))
    for k, volts in enumerate(u):
        out[:, k] = state
        state = step[:3, :3] @ state + step[:3, 3] * volts
    return out


def noise(n: int, memory: float, random: np.random.Generator) -> Array:
    """AR(1) of deviation 1."""
    white = random.normal(size=n + BEFORE)
    return np.asarray(math.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], white)[BEFORE:])


def gusts(n: int, plant: Plant, angle: float, random: np.random.Generator) -> Array:
    """What a coloured torque does to the reading, and white noise."""
    torque = lfilter([1.0], [1.0, -math.exp(-0.3 * angle)], random.normal(size=n + BEFORE))
    poles = np.array([1.0, 2.0 * plant.zeta, 1.0, 0.0][: 3 if plant.sees_speed else 4])
    top, bottom, _ = cont2discrete(([1.0, 2.0 * plant.zeta], poles), angle)
    y = lfilter(top.ravel(), bottom, torque)[BEFORE:]
    return np.asarray(y / y.std() + 0.1 * random.normal(size=n))


class Record(NamedTuple):
    """Its command, its plant, what noise leaves of its windows, and what noise and a wrong plant do."""

    kind: str
    plant: Plant
    noise: list[WindowResidual]
    both: list[WindowResidual]


def record(number: int, *, gusty: bool, moves: bool) -> Record:
    random, kind = np.random.default_rng(number), "moves" if moves else COMMANDS[number % 4]
    omega_n = math.exp(random.uniform(math.log(5.0), math.log(300.0)))
    plant = Plant(omega_n, math.exp(random.uniform(math.log(0.1), math.log(1.2))), bool(number // 4 % 2))
    tick = 2.0 * math.pi / omega_n / random.uniform(40.0, 120.0)
    t = np.arange(int(random.integers(6000, 14000))) * tick
    u = command(kind, t, omega_n, random)
    states, angle = moved(u, omega_n, plant.zeta, tick), omega_n * tick
    memory, n = MEMORIES[number // 8 % 5], len(t)
    error = gusts(n, plant, angle, random) if gusty else noise(n, memory, random)
    count = int(random.choice([4, 6, 8]))
    free = begun(len(t) // count, plant, angle)
    wrong = (moved(u, WRONG * omega_n, plant.zeta, tick) - states)[1 if plant.sees_speed else 2]
    left = windows(t, u, error, states, free)
    off = windows(t, u, wrong, states, free)
    as_much = math.sqrt(mean_square(left) / mean_square(off))
    both = [replace(one, error=one.error + as_much * more.error) for one, more in zip(left, off, strict=True)]
    return Record(kind, plant, left, both)


def windows(t: Array, u: Array, error: Array, states: Array, free: Array) -> list[WindowResidual]:
    """As many as rows of `free` fit in, each without it."""
    n = len(free)
    scored = np.arange(n) >= n // 10
    return [
        WindowResidual(
            0,
            t[a : a + n],
            u[a : a + n],
            without(error[a : a + n], free),
            scored,
            *states[:, a : a + n],
            bool(k % 2),
        )
        for k, a in enumerate(range(0, len(t) // n * n, n))
    ]


def moves_along(plant: Plant, parts: list[WindowResidual]) -> bool:
    """Whether what is left is larger as the load moves."""
    return comes_with_movement(parts, plant, usable(colour(parts), parts), SYSTEMATIC.chance) > 0.0


def begun(n: int, plant: Plant, angle: float) -> Array:
    """What a fit of the initial state, and of a speed's offset, takes off; shape (n, 3)."""
    poles = [1.0, 2.0 * plant.zeta, 1.0] if plant.sees_speed else [1.0, 2.0 * plant.zeta, 1.0, 0.0]
    _, discrete, _ = cont2discrete(([1.0], poles), angle)
    movements = lfilter([1.0], discrete, np.eye(len(poles) - 1, n), axis=-1)
    return np.column_stack([np.ones(n), *movements] if plant.sees_speed else [*movements])


def without(x: Array, columns: Array) -> Array:
    """Less the nearest sum of columns."""
    return x - columns @ np.linalg.lstsq(columns, x, rcond=None)[0]


def main() -> None:
    """Print a line for each kind of record."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--records", type=int, default=320)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--gusts", action="store_true")
    parser.add_argument("--moves", action="store_true")
    asked = parser.parse_args()
    told, spent = defaultdict(list), 0.0
    for number in range(asked.first, asked.first + asked.records):
        one = record(number, gusty=asked.gusts, moves=asked.moves)
        begin = time.process_time()
        found = foretold(one.noise, one.plant, swept=one.kind == "sweep", in_loop=False)
        spent += time.process_time() - begin
        assert found is not None
        black_box = found.share.significant, found.detectable <= 1.0
        movement = moves_along(one.plant, one.noise), moves_along(one.plant, one.both)
        told[one.kind, "speed" if one.plant.sees_speed else "position"].append((*black_box, *movement))
    told["all", ""] = [one for each in told.values() for one in each]
    print(f"{'':22}{'black box':>22}{'':16}{'movement':>22}")
    print(f"{'command':12}{'y':10}" + f"{'systematic by chance':>22}{'would be shown':>16}" * 2)
    for (kind, name), each in sorted(told.items()):
        line = f"{kind:12}{name:10}"
        for chance, shown in np.sum(each, axis=0).reshape(2, 2):
            line += f"{f'{chance} of {len(each)}':>22}{f'{100 * shown / len(each):.0f} %':>16}"
        print(line)
    print(f"{1e3 * spent / asked.records:.0f} ms of processor time each by the black box")


if __name__ == "__main__":
    main()
