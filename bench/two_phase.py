"""How soon and how well two-phase excitation tells K_L, beside Cramer and Rao's bound.

    python bench/two_phase.py [--runs 30]

A sampled relay (0.5 ms, K_L = 17, e_a = 0.5 V, 0.4 ms of delay, 1 % noise) on the exact linear plant at rest.
Nothing is known of K_L (first guess 5) and of the delay. The relay is the loop's; the second phase is chosen
from the first estimate that is `ok`, as in the gateway. Times are from relay on to the first answer whose
95 % interval of K_L is within 0.5 %. The errors are those of the last answer within 1 s, in % of the truth:
"rms" over the runs, "stated" the mean of what the answers state, "bound" Cramer and Rao's, by differences of
the plant's motion under the voltages of one run's window, with K_L, the delay, the start and a load unknown.
The last columns tell how many of all answers' 95 % intervals hold K_L.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from scipy.linalg import expm

from seod.estimate import make_estimator
from seod.estimate.base import Estimate, EstimatorSettings, Row
from seod.estimate.plant.free_motion import Dynamics
from seod.estimate.two_phase.relay_run import Drive
from seod.estimate.two_phase.second_phase import Choice, Reach, Seen, choose
from seod.loop.two_phase import SecondPhase, TwoPhaseRelay

K_L, E_A, TICK, DELAY, NOISE, CYCLES, SHIFT = 17.0, 0.5, 5e-4, 4e-4, 0.01, 3, 0.25
PLANTS = ((0.21, 117.0), (0.45, 145.0), (0.8, 60.0))
GOAL = 0.005
DESIGN = {PLANTS[0]: 0.10, PLANTS[1]: 0.07, PLANTS[2]: 0.04}
"""The design's bounds on K_L with 3 + 3 cycles [%]."""
NAMES = ("K_L", "zeta", "omega_n")
FREE = Reach(math.inf, math.inf, math.inf, math.inf)


class Plant:
    """Eq. 1 between ticks."""

    def __init__(self, zeta: float, omega_n: float, gain: float = K_L, load: float = 0.0) -> None:
        a = np.eye(4, k=1)
        a[2, 1:] = -(omega_n**2), -2.0 * zeta * omega_n, gain * omega_n**2
        self.a, self.load, self.moves = a, load, {}
        self.state = np.zeros(4)

    def go(self, u: float, seconds: float) -> None:
        key = round(seconds * 1e12)
        if key > 0:
            if key not in self.moves:
                self.moves[key] = expm(self.a * seconds)
            self.state[3] = u - self.load
            self.state = self.moves[key] @ self.state


def amplitude(zeta: float, omega_n: float) -> float:
    return 1.28 * K_L * E_A / (2.0 * zeta * omega_n)


def excite(
    zeta: float, omega_n: float, seed: int, seconds: float = 1.0
) -> tuple[list[Row], list[Estimate], Choice]:
    """Rows, answers and the second phase chosen, from relay on."""
    rng = np.random.default_rng(seed)
    plant, relay, before, choice = Plant(zeta, omega_n), TwoPhaseRelay(0.0, 0.0, E_A, 0.0), 0.0, None
    estimator = make_estimator(
        EstimatorSettings("wave", 5.0, 0.0, 0.0, TICK, 2 * CYCLES, None, K_L_sd=math.inf, delay_sd=math.inf)
    )
    rows, answers = [], []
    for k in range(round(seconds / TICK)):
        t = k * TICK
        y = float(plant.state[0] + NOISE * amplitude(zeta, omega_n) * rng.standard_normal())
        u = relay.step(t, -y)
        rows.append(Row(t, y, u, t, 0.0, E_A, 0.0, exciting=True, second=relay.second))
        plant.go(before, DELAY)
        plant.go(u, TICK - DELAY)
        before = u
        answer = estimator.update(rows[-1])
        if answer is not None:
            answers.append(answer)
        if choice is None and answer is not None and answer.quality == "ok":
            choice = chosen(answer)
            relay.take(SecondPhase(choice.late, CYCLES, choice.period, E_A, math.inf))
    assert choice is not None
    return rows, answers, choice


def chosen(first: Estimate) -> Choice:
    plant = Dynamics(first.omega_n, first.zeta, first.delay_s)
    found = choose(
        Seen(plant, first.zeta_sd, first.K_L, first.amplitude),
        Drive(E_A, 0.0, 0.0, TICK),
        FREE,
        CYCLES,
        SHIFT,
    )
    assert isinstance(found, Choice), found
    return found


def bound(zeta: float, omega_n: float, rows: list[Row]) -> np.ndarray:
    """On the relative deviations of `NAMES`, [%]."""
    unknowns = np.zeros(8)  # relative: K_L, zeta, omega_n; delay; position, speed, acceleration, load
    steps = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-4, 1e-2, 1.0, 1e-4])

    def motion(x: np.ndarray) -> np.ndarray:
        plant = Plant(zeta * (1.0 + x[1]), omega_n * (1.0 + x[2]), K_L * (1.0 + x[0]), x[7])
        plant.state[:3] = x[4:7]
        delay, y = DELAY * (1.0 + x[3]), []
        for before, row in zip([rows[0], *rows], rows, strict=False):
            y.append(plant.state[0])
            plant.go(before.u, delay)
            plant.go(row.u, TICK - delay)
        return np.array(y)

    columns = [
        (motion(unknowns + step) - motion(unknowns - step)) / (2.0 * size)
        for step, size in zip(np.diag(steps), steps, strict=True)
    ]
    jacobian = np.stack(columns) / (NOISE * amplitude(zeta, omega_n))
    scale = 1.0 / np.linalg.norm(jacobian, axis=1)
    covariance = np.linalg.inv((jacobian @ jacobian.T) * np.outer(scale, scale)) * np.outer(scale, scale)
    return np.asarray(100.0 * np.sqrt(covariance.diagonal()[:3]))


def window(rows: list[Row]) -> list[Row]:
    """The newest 2 `CYCLES` cycles that have ended, by the relay's switches."""
    switches = [k for k in range(1, len(rows)) if rows[k].u != rows[k - 1].u]
    return rows[switches[-min(4 * CYCLES + 2, len(switches))] : switches[-1]]


def report(zeta: float, omega_n: float, runs: int) -> None:
    true = dict(zip(NAMES, (K_L, zeta, omega_n), strict=True))
    off, stated, times, inside, shifts, rows = [], [], [], [], [], []
    for seed in range(runs):
        rows, answers, choice = excite(zeta, omega_n, seed)
        good = [answer for answer in answers if answer.quality == "ok"]
        off.append([100.0 * (getattr(good[-1], name) / value - 1.0) for name, value in true.items()])
        stated.append([100.0 * getattr(good[-1], f"{name}_sd") / value for name, value in true.items()])
        times.append(next(a.t for a in good if 1.96 * a.K_L_sd < GOAL * a.K_L))
        inside += [abs(a.K_L - K_L) < 1.96 * a.K_L_sd for a in good]
        shifts.append(choice.shift)
    rms, says = np.sqrt(np.mean(np.square(off), axis=0)), np.mean(stated, axis=0)
    bounds = bound(zeta, omega_n, window(rows))
    print(
        f"{zeta:4.2f} {omega_n:5.0f}  {np.median(shifts):5.2f}  {np.median(times):5.2f} {max(times):5.2f}",
        end="",
    )
    print(f"   {np.max(np.abs(np.array(off)[:, 0])):5.3f} (goal {100 * GOAL:g})", end="")
    for one, two, three in zip(rms, says, bounds, strict=True):
        print(f"   {one:5.3f} {two:5.3f} {three:5.3f} {one / three:4.2f}", end="")
    print(f"   {100 * np.mean(inside):3.0f} of {len(inside)}   design: {DESIGN[zeta, omega_n]:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=30, help="for each plant")
    runs = parser.parse_args().runs
    print(
        f"{runs} runs a plant        time [s]    K_L at 1 s   K_L [%]                     zeta [%]   ", end=""
    )
    print("                 omega_n [%]                 K_L in")
    print("zeta omega_n shift  median  max   worst [%]          ", end="")
    print("   rms stated bound rms/b" * 3, "  95 % intervals")
    for zeta, omega_n in PLANTS:
        report(zeta, omega_n, runs)


if __name__ == "__main__":
    main()
