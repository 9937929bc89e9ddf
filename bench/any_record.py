"""Records of any scale, rate, length and shape through `seod diagnose`: how many end in a traceback.

    python bench/any_record.py [--count 500] [--first 0] [--budget 0.02] [--keep FOLDER]

Each record is a small CSV file that its number makes: a plant of second order at 0.1 Hz to 100 kHz, in a unit
of 1e-9 to 1e9, driven in one of several ways, then damaged in up to three: a staircase, clipping, repeated or
missing cells, one value, two rows and the like. An answer is right, and so is a sentence (`ReadError`,
`DiagnoseError`); anything else is a failure. `--budget` is the work of a search over the usual one: with
little most of the time goes into what every diagnosis does. Goal: no failure of 500.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import cont2discrete, lfilter

from seod.api.diagnoses import diagnose
from seod.data import ReadError
from seod.diagnose.result import DiagnoseError
from seod.diagnose.search.budget import EFFORTS

if TYPE_CHECKING:
    from collections.abc import Callable

    Random = np.random.Generator
    Array = np.ndarray[tuple[int], np.dtype[np.float64]]

BUDGET = 0.02
"""Work of a search, over the usual one: a third of a second."""
FEWEST, MOST = 200, 3000
"""Rows of most records."""


def relay(random: Random, t: Array) -> Array:
    period = random.uniform(8.0, 300.0)
    return np.where(np.arange(len(t)) % period < 0.5 * period, 1.0, -1.0)


def multisine(random: Random, t: Array) -> Array:
    waves = random.integers(1, max(2, len(t) // 10), 6)
    place = np.linspace(0.0, 1.0, len(t))
    return np.sum([np.sin(2.0 * np.pi * (k * place + random.random())) for k in waves], axis=0) / 3.0


def steps(random: Random, t: Array) -> Array:
    hold = int(random.integers(1, 1 + max(2, len(t) // 6)))
    return np.repeat(random.uniform(-1.0, 1.0, len(t)), hold)[: len(t)]


def sweep(random: Random, t: Array) -> Array:
    place = np.linspace(0.0, 1.0, len(t))
    return np.sin(random.uniform(0.05, 0.5) * len(t) * place**2)


def white(random: Random, t: Array) -> Array:
    return random.normal(size=len(t))


COMMANDS: tuple[Callable[[Random, Array], Array], ...] = (relay, multisine, steps, sweep, white)


def staircase(random: Random, y: Array) -> Array:
    step = 10.0 ** random.uniform(-2.5, 0.5) * (np.std(y) or 1.0)
    return step * np.round(y / step)


def clipped(random: Random, y: Array) -> Array:
    low, high = np.sort(random.choice(y, 2))
    return np.clip(y, low, high)


def repeated(random: Random, y: Array) -> Array:
    every = int(random.integers(2, 30))
    return y[np.arange(len(y)) // every * every]


def missing(random: Random, y: Array) -> Array:
    return np.where(
        random.random(len(y)) < random.choice([0.01, 0.3, 0.9, 1.0], p=[0.5, 0.3, 0.15, 0.05]), np.nan, y
    )


def frozen(random: Random, y: Array) -> Array:
    a, b = np.sort(random.integers(0, len(y) + 1, 2))
    return np.concatenate([y[:a], np.full(b - a, y[a : a + 1].sum()), y[b:]])


def rectified(_: Random, y: Array) -> Array:
    return np.abs(y)


def hit(random: Random, y: Array) -> Array:
    off = random.random(len(y)) < 0.02
    return y + off * random.normal(0.0, 10.0 ** random.uniform(0.0, 4.0) * (np.std(y) or 1.0), len(y))


def far(random: Random, y: Array) -> Array:
    return y + 10.0 ** random.uniform(0.0, 6.0) * (np.std(y) or 1.0)


def one_value(_: Random, y: Array) -> Array:
    return np.full(len(y), y[0])


DAMAGES: tuple[Callable[[Random, Array], Array], ...] = (
    *(staircase, clipped, repeated, missing, frozen, rectified, hit, far),
    one_value,
)
LIKELY = np.array([3.0, 3.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 0.3])


def length(random: Random) -> int:
    """Rows; of few records fewer than a diagnosis can do with."""
    return (
        int(random.choice([2, 3, 10, 60, 150]))
        if random.random() < 0.08
        else int(random.integers(FEWEST, MOST))
    )


def moved(random: Random, u: Array) -> Array:
    """A plant of second order with sampling interval 1, as position or as speed."""
    omega, zeta = 10.0 ** random.uniform(-3.0, -0.2), 10.0 ** random.uniform(-1.5, 0.7)
    plant = [omega**2], [1.0, 2.0 * zeta * omega, omega**2]
    if random.random() < 0.7:
        plant = plant[0], [*plant[1], 0.0]
    top, bottom, _ = cont2discrete(plant, 1.0)
    delay = int(random.choice([0, 0, 1, 5, 30]))
    y = lfilter(top[0], bottom, np.concatenate([np.zeros(delay), u])[: len(u)])
    noise = 10.0 ** random.uniform(-5.0, 0.3) * (np.std(y) or 1.0)
    return y + random.normal(0.0, random.choice([0.0, noise]), len(y))


def times(random: Random, rows: int) -> Array:
    tick = 10.0 ** random.uniform(-5.0, 1.0)
    t = np.arange(rows) * tick
    if random.random() < 0.2:
        t = t + random.uniform(0.0, 0.4 * tick, rows)
    if random.random() < 0.1 and rows > 10:
        t[rows // 2 :] += tick * 10.0 ** random.uniform(0.0, 12.0)
    return t + random.choice([0.0, 0.0, 1e3, 1.7e9])


def record(number: int) -> str:
    """The text of the file that has this number."""
    random = np.random.default_rng(number)
    t = times(random, length(random))
    u = COMMANDS[random.integers(len(COMMANDS))](random, t)
    y = random.choice([-1.0, 1.0]) * moved(random, u)
    how = random.choice(len(DAMAGES), int(random.integers(0, 4)), replace=False, p=LIKELY / LIKELY.sum())
    for k in how:
        y = DAMAGES[k](random, y)
    if random.random() < 0.05:
        u = one_value(random, u)
    if random.random() < 0.1:
        u = missing(random, u)
    u = u * 10.0 ** random.uniform(-4.0, 5.0)
    size = np.std(y[np.isfinite(y)]) if np.isfinite(y).any() else 0.0
    y = y * 10.0 ** random.uniform(-9.0, 9.0) / (size if size > 0.0 else 1.0)
    rows = "\n".join(f"{a:.9f},{b:.9g},{c:.9g}" for a, b, c in zip(t, u, y, strict=True))
    return f"t,u,y\n{rows}\n"


def outcome(number: int, folder: Path, output: str | None = None) -> tuple[str, str]:
    """`answer`, `sentence` or the place of a failure, and its text."""
    path = folder / f"{number}.csv"
    path.write_text(record(number))
    asked = output or ("position", "velocity", None)[number % 3]
    try:
        told = diagnose(path, output=asked, effort="quick")
        return "answer", json.dumps(told.to_dict()) if number % 4 > 1 else told.summary()
    except (DiagnoseError, ReadError) as error:
        return "sentence", str(error)
    except Exception as error:  # noqa: BLE001 - what is counted
        last = traceback.extract_tb(error.__traceback__)[-1]
        return (
            f"{type(error).__name__} at {Path(last.filename).name}:{last.name}: {error}",
            traceback.format_exc(),
        )


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--count", type=int, default=500)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--budget", type=float, default=BUDGET)
    asked.add_argument("--keep", type=Path, help="where files that fail stay")
    given = asked.parse_args()
    EFFORTS["quick"] = given.budget
    counts: Counter[str] = Counter()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.first, given.first + given.count):
            begun = time.monotonic()
            what, text = outcome(number, Path(folder))
            counts[what if what in {"answer", "sentence"} else "failure"] += 1
            took = time.monotonic() - begun
            if what not in {"answer", "sentence"} or took > 20.0:
                print(f"{number}: {took:.1f} s: {what}", flush=True)
                if given.keep:
                    (given.keep / f"{number}.txt").write_text(text)
            if what == "sentence" and given.keep:
                print(f"    {number}: {text.split(': ', 1)[-1][:100]}", flush=True)
    print(dict(counts), f"{time.monotonic() - began:.0f} s; goal: no failure")


if __name__ == "__main__":
    main()
