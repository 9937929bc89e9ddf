"""Coverage and width of the live 95 % intervals on rigs whose latency nobody told.

    python bench/coverage_live.py [--runs 20] [--seconds 10] [--late 0] [--scatter 0] [--alone]

A sampled relay on Eq. 1 (2 kHz, K_L known), written apart from what is measured (`coverage_truth.py`). Its
commands take 0 to 2 ticks longer than their times say. Rows go through the gateway's `Axis` with the settings
of a rig file that says nothing of the delay; `--alone` writes `delay_sd: unknown`: each window stands alone.

Answers of one excitation share what they learnt of the delay, and are no independent trials: one answer of
each excitation counts, at its first `ok`, after 2 s, and at its end. With `--alone` all windows count that
share no samples. In brackets Wilson's 95 % interval. Widths are stated standard deviations, as they are and
over three Cramer-Rao bounds: of that window alone with the delay unknown (`untold`), with the delay known
(`told`), and where windows like it told the same delay ever since the start (`learnt`; the first cycles,
which tell more than those after them, bring an answer below it).
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from accuracy_summary import wilson
from coverage_truth import HYSTERESIS, K_L, PLANTS, TICK, Bound, Rig, bound, record

from seod.config.load import load_rig
from seod.estimate import make_estimator
from seod.files.shipped import configs_dir
from seod.observe.estimation import Axis

if TYPE_CHECKING:
    from seod.estimate.base import Estimate

LATENCIES = (0.0, 0.1, 0.5, 1.0, 1.5, 2.0)
NOISES = (0.01, 0.002)
CYCLES = 4.5
"""In the longest window."""
STEADY_S = 1.5
"""From here on one window's bound is like another's."""
INTERVAL = 1.96


class Heard(NamedTuple):
    """One answer: when, errors in stated deviations, stated parts of omega_n and zeta, over three bounds."""

    place: str
    errors: tuple[float, float]
    stated: tuple[float, float]
    untold: tuple[float, float]
    told: tuple[float, float]
    learnt: tuple[float, float]


def axis_of(rig: Rig, alone: bool) -> Axis:
    """As the gateway has it: of a shipped rig file that leaves the delay out."""
    config = load_rig(configs_dir() / "virtual.yaml").axes["motor"]
    estimator = config.estimator.model_copy(update={"delay": 0.0, "delay_sd": "unknown" if alone else None})
    relay = config.relay.model_copy(update={"hysteresis": HYSTERESIS * rig.amplitude})
    config = config.model_copy(update={"estimator": estimator, "relay": relay, "K_L": K_L})
    return Axis("motor", config, TICK, make_estimator)


def excite(rig: Rig, seconds: float, alone: bool, seed: tuple[int, ...]) -> list[Heard]:
    """One excitation."""
    kept = record(rig, seconds, seed)
    found = axis_of(rig, alone).feed(kept.rows())
    good = [answer for answer in found if answer.quality == "ok"]
    if not good:
        return []
    limits = [bound(rig, kept, *_window(answer)) for answer in good[:1]]
    steady = next((answer for answer in good if _window(answer)[0] > STEADY_S), good[-1])
    limits.append(bound(rig, kept, *_window(steady)))
    length = np.ptp(_window(steady))
    if alone:
        return [_heard(rig, answer, "window", limits[1], 0.0) for answer in _apart(good)]
    places = {"first": good[0], "2 s": next((a for a in good if a.t > 2.0), good[-1]), "end": good[-1]}
    return [
        _heard(rig, answer, place, limits[place != "first"], max(_window(answer)[0] / length, 0.0))
        for place, answer in places.items()
    ]


def _window(answer: Estimate) -> tuple[float, float]:
    lag = answer.lag_s or 0.0
    return max(answer.t - 2.0 * lag, 0.0), answer.t - TICK


def _apart(good: list[Estimate]) -> list[Estimate]:
    """Answers whose windows share no sample."""
    chosen: list[Estimate] = []
    for answer in good:
        if not chosen or _window(answer)[0] > chosen[-1].t:
            chosen.append(answer)
    return chosen


def _heard(rig: Rig, answer: Estimate, place: str, limit: Bound, before: float) -> Heard:
    """`before` windows of the same length told the same delay."""
    errors, stated = [], []
    for name in ("omega_n", "zeta"):
        value, sd, true = getattr(answer, name), getattr(answer, f"{name}_sd"), getattr(rig, name)
        errors.append((value - true) / sd)
        stated.append(sd / true)
    delay = 1.0 / math.sqrt((1.0 + before) / limit.delay**2)
    learnt = np.hypot(limit.told, limit.by_delay * delay)
    bounds = (limit.untold, limit.told, learnt)
    return Heard(place, tuple(errors), tuple(stated), *(tuple(each.tolist()) for each in bounds))


def table(title: str, heard: list[Heard]) -> None:
    """Lines of `heard`, by place."""
    for place in dict.fromkeys(each.place for each in heard):
        here = [each for each in heard if each.place == place]
        text = f"{title} {place:>7} {len(here):5d}"
        stated, untold, told, learnt = (
            np.array([getattr(each, name) for each in here])
            for name in ("stated", "untold", "told", "learnt")
        )
        errors = np.array([each.errors for each in here])
        for k in range(2):
            hits = int(np.sum(np.abs(errors[:, k]) < INTERVAL))
            low, high = (100.0 * x for x in wilson(hits, len(here)))
            width = math.sqrt(float(np.mean(stated[:, k] ** 2)))
            over = [math.sqrt(float(np.mean((stated / each)[:, k] ** 2))) for each in (untold, told, learnt)]
            text += f"   {100 * hits / len(here):5.1f} ({low:4.1f}-{high:5.1f}) {100 * width:6.3f} "
            text += f"{over[0]:5.2f} {over[1]:5.1f} {over[2]:5.2f}"
        print(text, flush=True)


HEAD = (
    "zeta omega_n noise late latency  answer     N   omega_n covers % (Wilson), sd %, over bound untold, "
    "told, learnt; likewise zeta"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--runs", type=int, default=20, help="excitations for each line of plant, noise, latency"
    )
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument(
        "--late", type=float, default=0.0, help="single commands later by up to so many ticks"
    )
    parser.add_argument("--scatter", type=float, default=0.0, help="of stamps, standard deviation in ticks")
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    print(HEAD)
    everything: list[Heard] = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for (zeta, omega_n), noise in product(PLANTS, NOISES):
            together: list[Heard] = []
            for latency in LATENCIES:
                rig = Rig(zeta, omega_n, latency, noise, asked.late, asked.scatter)
                seeds = [(k, int(10 * latency), int(omega_n), int(1e3 * noise)) for k in range(asked.runs)]
                work = [pool.submit(excite, rig, asked.seconds, asked.alone, seed) for seed in seeds]
                heard = [each for job in work for each in job.result()]
                table(f"{zeta:4.2f} {omega_n:7.0f} {noise:5.1%} {asked.late:4.1f} {latency:7.1f}", heard)
                together += heard
            table(f"{zeta:4.2f} {omega_n:7.0f} {noise:5.1%} {asked.late:4.1f}     all", together)
            everything += together
    table(f"{'all':>31}", everything)


if __name__ == "__main__":
    main()
