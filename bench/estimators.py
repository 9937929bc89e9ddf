"""Bias and scatter of the estimators on the three plants of the design, and what they cost.

    python bench/estimators.py [--seconds 8]

A sampled relay (0.5 ms, K_L = 17, e_a = 0.5 V) on the exact linear plant; the output acts `delay` ticks after
the sample; noise is white, in % of the limit cycle's amplitude. Errors in % of the true value: mean and
standard deviation of the answers that are `ok`; "stated" is the mean standard deviation that they state.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.linalg import expm

from seod.estimate import make_estimator
from seod.estimate.base import Estimate, EstimatorSettings, Row
from seod.estimate.limit_cycle.closed_form import correction_factors
from seod.estimate.limit_cycle.inversion import Measured, invert, invert_eq8, sensitivity

K_L, E_A, TICK = 17.0, 0.5, 5e-4
METHODS = ("peaks", "exact", "wave")
PLANTS = ((0.21, 117.0), (0.45, 145.0), (0.8, 60.0))
PAPER = {PLANTS[0]: "-1.7 / -1.7", PLANTS[1]: "-4.5 / -4.6", PLANTS[2]: "-3.0 / -2.7"}
"""The design's figures for the paper's arithmetic with one tick of delay, omega_n / zeta in %."""


def relay_rows(zeta: float, omega_n: float, delay: int, noise: float, seconds: float) -> list[Row]:
    a = np.zeros((4, 4))
    a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -(omega_n**2), -2 * zeta * omega_n, K_L * omega_n**2]]
    m = expm(a * TICK)
    sigma = noise * correction_factors(zeta)[1] * K_L * E_A / (2 * zeta * omega_n)
    rng = np.random.default_rng(1)
    state, line, rows = np.zeros(3), [E_A] * (delay + 1), []
    for k in range(int(seconds / TICK)):
        t, y = k * TICK, float(state[0] + sigma * rng.standard_normal())
        line = [*line[1:], -E_A if y > 0.0 else E_A]
        rows.append(Row(t, y, line[-1], t + delay * TICK, 0.0, E_A, 0.0, exciting=True))
        state = m[:3, :3] @ state + m[:3, 3] * line[0]
    return rows


def feed(method: str, rows: list[Row]) -> tuple[list[Estimate], float, float]:
    """The answers, and the median time of a row without and with an answer [us]."""
    settings = EstimatorSettings(method, K_L, 0.0, 0.0, TICK, cycles=4, lowpass_hz=None)
    estimator = make_estimator(settings)
    answers, plain, half_cycles = [], [], []
    for row in rows:
        start = time.thread_time_ns()
        answer = estimator.update(row)
        spent = (time.thread_time_ns() - start) / 1e3
        (plain if answer is None else half_cycles).append(spent)
        if answer is not None and answer.quality == "ok":
            answers.append(answer)
    return answers, float(np.median(plain)), float(np.median(half_cycles))


def report(method: str, zeta: float, omega_n: float, answers: list[Estimate]) -> str:
    nan = float("nan")  # `peaks` states none
    wn = 100.0 * np.array([[e.omega_n / omega_n - 1.0, (e.omega_n_sd or nan) / omega_n] for e in answers])
    z = 100.0 * np.array([[e.zeta / zeta - 1.0, (e.zeta_sd or nan) / zeta] for e in answers])
    inside = np.mean([np.abs(x[:, 0]) < 1.96 * x[:, 1] for x in (wn, z)])
    numbers = [(x[:, 0].mean(), x[:, 0].std(), x[:, 1].mean()) for x in (wn, z)]
    text = " ".join(f"{bias:+8.2f} {sd:6.2f} {stated:6.2f}  " for bias, sd, stated in numbers)
    return f"{method:>6} {text} {100 * inside:5.0f} {np.mean([e.fitness for e in answers]):8.3f}"


def accuracy(seconds: float) -> dict[str, list[tuple[float, float]]]:
    print("                              omega_n: bias     sd stated   zeta: bias     sd stated")
    print("zeta omega_n delay noise method      %      %      %           %      %      %   in95%  fitness")
    costs: dict[str, list[tuple[float, float]]] = {method: [] for method in METHODS}
    for zeta, omega_n in PLANTS:
        for delay in range(4):
            for noise in (0.0, 0.002, 0.01):
                rows = relay_rows(zeta, omega_n, delay, noise, seconds)
                for method in METHODS:
                    answers, plain, half_cycle = feed(method, rows)
                    costs[method].append((plain, half_cycle))
                    place = f"{zeta:4.2f} {omega_n:7.0f} {delay:5d} {100 * noise:4.1f}% "
                    paper = PAPER[zeta, omega_n] if (method, delay, noise) == ("peaks", 1, 0.0) else ""
                    print(
                        place + report(method, zeta, omega_n, answers), f" design: {paper}" if paper else ""
                    )
    return costs


def median_us(call, count: int = 300) -> float:
    spent = []
    for _ in range(count):
        start = time.thread_time_ns()
        call()
        spent.append((time.thread_time_ns() - start) / 1e3)
    return float(np.median(spent))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="length of each record")
    costs = accuracy(parser.parse_args().seconds)
    print()
    for method, spent in costs.items():
        plain, half_cycle = np.median(spent, axis=0)
        print(f"{method}: {plain:.1f} us a row, {half_cycle:.0f} us an answer (processor time, medians)")
    measured = Measured(0.0226, 0.0224, 0.0007, 0.0008, 0.079)
    plant = invert(measured, 0.002, K_L, E_A)
    print(f"inversion: exact {median_us(lambda: invert(measured, 0.002, K_L, E_A)):.0f} us,", end=" ")
    print(
        f"its derivatives {median_us(lambda: sensitivity(plant, measured, 0.002, K_L, E_A)):.0f} us,", end=" "
    )
    print(f"Eqs. 5-8 {median_us(lambda: invert_eq8(140.0, 0.08, K_L, E_A)):.1f} us")


if __name__ == "__main__":
    main()
