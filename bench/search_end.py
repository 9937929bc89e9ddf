"""Whether a search ends where noise alone is left, of any colour, and goes on where a spring is left too.

    python bench/search_end.py [--records 200] [--first 100]

Each record is a plant of its own (5 to 300 rad/s, zeta 0.1 to 1.2) under a sweep, a multisine, filtered noise
or steps, as a position or a speed, with noise of 1 %, AR(1) of 0 to 0.997. Eq. 1 is fitted to the record as
it is, and with a spring that changes the movement by as much as the noise, and three times that. Printed are
the records in which a cause promises more than chance would: 1 % are meant to be where nothing is hidden.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from what_is_left import COMMANDS, MEMORIES, command, moved, noise

from seod.data import Recording
from seod.diagnose.causes.scales import Scales
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.noise_alone import nothing_promised
from seod.diagnose.search.screen import screen

if TYPE_CHECKING:
    from what_is_left import Array

NOISE = 0.01
HIDDEN = (0.0, 1.0, 3.0)
"""[-] What a spring changes of the movement, over the noise."""


class Rig(NamedTuple):
    """A plant and its commands."""

    t: Array
    u: Array
    omega_n: float
    zeta: float
    speed: bool
    noise: Array

    def seen(self, spring: float) -> Array:
        """The position or the speed, without noise."""
        _, speed, place = moved(self.u, self.omega_n, self.zeta, float(self.t[1]), spring)
        return speed if self.speed else place


def drawn(number: int) -> tuple[float, Rig]:
    """The noise's memory, and the rig."""
    random, kind = np.random.default_rng(number), COMMANDS[number % 4]
    omega_n = math.exp(random.uniform(math.log(5.0), math.log(300.0)))
    zeta = math.exp(random.uniform(math.log(0.1), math.log(1.2)))
    t = np.arange(int(random.integers(4000, 9000))) * 2.0 * math.pi / omega_n / random.uniform(40.0, 120.0)
    memory = MEMORIES[number // 8 % 5]
    u = command(kind, t, omega_n, random)
    return memory, Rig(t, u, omega_n, zeta, bool(number // 4 % 2), noise(len(t), memory, random))


def promised(rig: Rig, spring: float) -> bool:
    """Whether a cause promises something where Eq. 1 was fitted."""
    y = rig.seen(spring)
    size, tick, omega_n = float(np.std(y)), float(rig.t[1]), rig.omega_n
    y = y + NOISE * size * rig.noise
    rows = np.arange(1, len(y) + 1)
    read = Recording((Path("rig.csv"),), rig.t, rig.u, y, None, None, None, rows, {}, {}, ())
    place, speed = (size / omega_n, size) if rig.speed else (size, size * omega_n)
    screened = screen(fitted_windows(cut([series(read, sees_speed=rig.speed)])[0]), map, Budget())
    length = float(rig.t[-1])
    sizes = Scales(1.0, speed, speed * omega_n, 0.0, place, size, omega_n, length, tick)
    model = baseline_model(sizes, 1.0, rig.speed, {})
    x = model.searched({"K_L": 1.0, "omega_n": omega_n, "zeta": rig.zeta})
    found = fit(model, screened.every, x, simulated_states(model, x, screened.every), 40)
    return not nothing_promised(found, screened)


def spring_of(rig: Rig, part: float) -> float:
    """The spring that changes the movement by so many times the noise, roughly."""
    little = 1e-6
    change = float(np.std(rig.seen(little) - rig.seen(0.0)) / np.std(rig.seen(0.0)))
    return part * NOISE * little / change


def main() -> None:
    """Print a line for each memory."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--first", type=int, default=100)
    asked = parser.parse_args()
    told = defaultdict(list)
    for number in range(asked.first, asked.first + asked.records):
        memory, rig = drawn(number)
        told[memory].append([promised(rig, spring_of(rig, part)) for part in HIDDEN])
    print(f"{'memory':8}{'records':>8}{'nothing hidden':>16}{'as much':>10}{'thrice':>10}")
    every = [*told.items(), ("all", [one for each in told.values() for one in each])]
    for memory, each in every:
        chance, much, thrice = np.sum(each, axis=0)
        print(f"{memory!s:8}{len(each):8}{chance:16}{much:10}{thrice:10}")


if __name__ == "__main__":
    main()
