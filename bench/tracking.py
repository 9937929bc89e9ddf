"""How `wave` follows a rig that changes: steps, drifts, supply pressure and speed (Figs. 11, 12, 15).

    python bench/tracking.py [--seeds 5]

K_L = 17, e_a = 0.5 V, 2 kHz, a window of 4 cycles, 1 % noise, on the design's three plants. The plant goes
in fifths of a tick by matrix exponentials. After the step: cycles until all answers that are `ok` lie within
2 % of the new omega_n. Under drift: lag_s in cycles; error of the newest answer against the plant of now, and
against that of lag_s ago, in % (means over answers), and the latter in stated standard deviations (RMS).
"""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm

from seod.estimate import make_estimator
from seod.estimate.base import Estimate, EstimatorSettings, Row

if TYPE_CHECKING:
    from collections.abc import Callable

    Course = Callable[[float], float]

K_L, E_A, TICK, PARTS = 17.0, 0.5, 5e-4, 5
PLANTS = ((0.21, 117.0), (0.45, 145.0), (0.8, 60.0))
STEP_AT = 0.6
CLOSE = 0.02
DRIFTS = (
    ("nothing", 0.0, 0.0, 0.0, 0.0),
    ("omega_n +5 %/s", 0.05, 0.0, 0.0, 0.0),
    ("omega_n +20 %/s", 0.2, 0.0, 0.0, 0.0),
    ("zeta +20 %/s", 0.0, 0.2, 0.0, 0.0),
    ("supply: K_L +20 %/s", 0.0, 0.0, 0.2, 0.0),
    ("supply: K_L, omega_n, zeta +20, +5, -10 %/s", 0.05, -0.1, 0.2, 0.0),
    ("speed: 30 rad/s^2", 0.0, 0.0, 0.0, 30.0),
    ("speed: 30 rad/s^2, omega_n +10 %/s", 0.1, 0.0, 0.0, 30.0),
)
"""Rates of omega_n, zeta and K_L, and of the speed in velocity mode, which begins at 20 rad/s."""


def line(start: float, rate: float) -> Course:
    return lambda t: start * (1.0 + rate * t)


def step(size: float) -> Course:
    return lambda t: 1.0 if t < STEP_AT else 1.0 + size


def rows(
    zeta: Course, omega_n: Course, gain: Course, speed: Course | None, seconds: float, seed: int
) -> list[Row]:
    """A relay about 0, or about a speed (Fig. 6b)."""
    rng, state, signal, before, sign, acts = np.random.default_rng(seed), np.zeros(3), 0.0, 0.0, 1.0, 0.0
    scale = 1.28 * K_L * E_A / (2.0 * zeta(0.0) * omega_n(0.0))
    sigma = 0.01 * scale * (omega_n(0.0) if speed else 1.0)
    state[1] = speed(0.0) if speed else 0.0
    feed = []
    for k in range(int(seconds / TICK)):
        t = k * TICK
        if k % 4 == 0:
            a, w = np.zeros((4, 4)), omega_n(t)
            a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -w * w, -2 * zeta(t) * w, w * w]]
            m = expm(a * TICK / PARTS)[:3]
        y = float(state[1 if speed else 0] + sigma * rng.standard_normal())
        error = (speed(t) if speed else 0.0) - y
        signal, before = (
            (signal + 0.5 * (error + before) * TICK if k else 0.0, error) if speed else (error, 0.0)
        )
        sign = math.copysign(1.0, signal) if abs(signal) > 0.02 * scale else sign
        bias = speed(t) / gain(t) if speed else 0.0
        u = bias + sign * E_A
        feed.append(Row(t, -signal, u, t + TICK, 0.0, E_A, bias, exciting=True, K_L=gain(t), speed=y))
        for part in range(PARTS):
            state = m[:, :3] @ state + m[:, 3] * gain(t + (part + 0.5) * TICK / PARTS) * acts
        acts = u
    return feed


def answers(feed: list[Row], speed: bool = False) -> list[Estimate]:
    known = EstimatorSettings("wave", K_L, 0.0, 0.0, TICK, cycles=4, lowpass_hz=None, integrated=speed)
    estimator = make_estimator(known)
    return [answer for row in feed if (answer := estimator.update(row))]


def cycles_to_follow(zeta: float, omega_n: float, size: float, seed: int) -> float:
    change = step(size)
    feed = rows(lambda _: zeta, lambda t: omega_n * change(t), lambda _: K_L, None, STEP_AT + 1.5, seed)
    found = [a for a in answers(feed) if a.t > STEP_AT and a.quality == "ok" and a.omega_n and a.frequency]
    new = omega_n * (1.0 + size)
    wrong = [a.t for a in found if abs(a.omega_n / new - 1.0) > CLOSE]
    first = min(a.t for a in found if a.t > max(wrong, default=STEP_AT))
    return (first - STEP_AT) * found[-1].frequency / (2.0 * math.pi)


def steps(seeds: int) -> None:
    print("step of omega_n: cycles until followed, median and worst (goal 2)")
    for zeta, omega_n in PLANTS:
        for size in (0.2, -0.2):
            found = [cycles_to_follow(zeta, omega_n, size, seed) for seed in range(seeds)]
            place = f"  {zeta:4.2f} {omega_n:4.0f} {100 * size:+4.0f} %"
            print(f"{place}  {np.median(found):5.2f} {max(found):5.2f}", flush=True)


def drifts(seeds: int) -> None:
    print(
        "drift: % of answers ok, lag in cycles; omega_n: error now, error lag_s ago, its sds; zeta likewise"
    )
    for name, *rates in DRIFTS:
        for zeta, omega_n in PLANTS:
            print(
                f"  {name:<44} {zeta:4.2f} {omega_n:4.0f} {followed(zeta, omega_n, rates, seeds)}", flush=True
            )


def followed(zeta: float, omega_n: float, rates: list[float], seeds: int) -> str:
    by_omega_n, by_zeta, by_gain, by_speed = rates
    w, z, g = line(omega_n, by_omega_n), line(zeta, by_zeta), line(K_L, by_gain)
    speed = line(20.0, by_speed / 20.0) if by_speed else None
    feeds = (rows(z, w, g, speed, 2.0, seed) for seed in range(seeds))
    return summary([a for feed in feeds for a in answers(feed, speed is not None) if a.t > 0.6], w, z)


def summary(found: list[Estimate], omega_n: Course, zeta: Course) -> str:
    good = [a for a in found if a.quality == "ok"]
    lag = np.mean([a.lag_s * a.frequency / (2.0 * math.pi) for a in good])
    text = f"{100 * len(good) / len(found):4.0f} % {lag:5.2f}"
    for name, truth in (("omega_n", omega_n), ("zeta", zeta)):
        now = 100.0 * np.mean([getattr(a, name) / truth(a.t) - 1.0 for a in good])
        ago = np.array([getattr(a, name) - truth(a.t - a.lag_s) for a in good])
        part = 100.0 * np.mean(ago) / truth(1.0)
        sds = math.sqrt(np.mean((ago / [getattr(a, f"{name}_sd") for a in good]) ** 2))
        text += f"   {now:+6.2f} {part:+6.2f} {sds:5.2f}"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    seeds = parser.parse_args().seeds
    steps(seeds)
    drifts(seeds)


if __name__ == "__main__":
    main()
