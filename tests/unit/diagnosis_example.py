"""A diagnosis whose residual is known: a kernel's truth with friction, and two models of it."""

from __future__ import annotations

import math

import numpy as np

from seod.diagnose.result import (
    Candidate,
    Diagnosis,
    FoundEffect,
    Gain,
    NextExperiment,
    Parameter,
    Score,
    Unexplained,
    Whole,
    Window,
)
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state

NONE = np.empty(0)
K_L, OMEGA_N, ZETA, LEVEL, NOISE, RATE = 17.0, 60.0, 0.4, 250.0, 1e-4, 1000.0
FRICTION = {"coulomb_friction": {"level": LEVEL}}


def command(n, seed=1):
    """A multisine of 0.5 to 12 Hz."""
    random = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    lines = np.arange(1, 25) / 2.0
    return (
        0.4
        * sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(lines, random.uniform(0, 6, 24), strict=True))
        / 3
    )


def simulate(u, effects):
    """Readings, speeds and pressures from rest."""
    p = parameters(K_L, OMEGA_N, ZETA, effects)
    s = new_state(p, 0.0, 0.0)
    t = np.arange(len(u)) / RATE
    y, v, a = np.empty((3, len(u)))
    for k in range(len(u)):
        follow(
            p[0],
            s[0],
            t[max(0, k - 1) : k],
            u[max(0, k - 1) : k],
            t[k : k + 1],
            *[NONE] * 4,
            y[k : k + 1],
        )
        v[k], a[k] = s["velocity"][0], s["pressure"][0]
    return t, y, v, a


def example(windows=4, seconds=2.0, found=True):
    """Windows of a truth with friction; the baseline is the same plant without it."""
    n = int(seconds * RATE)
    made = [_window(k, n, found) for k in range(windows)]
    error = np.concatenate([w.y - w.y_baseline for w in made])
    spread = np.concatenate([w.y - w.y.mean() for w in made])
    nrmse = math.sqrt(float(np.mean(error**2) / np.mean(spread**2)))
    floor = NOISE / float(np.std(spread))
    baseline = Score(K_L, OMEGA_N, 1.5 * ZETA, nrmse, 2.0 * nrmse, False)
    extended = (
        Score(K_L, OMEGA_N, ZETA, 1.05 * floor, 2.0 * floor, False, FRICTION, {"zeta": 0.002})
        if found
        else baseline
    )
    level = Parameter(LEVEL, "unit/s^2", (245.0, 255.0))
    effect = FoundEffect(
        "coulomb_friction", {"level": level}, Gain(nrmse, 1.05 * floor), 1e-9, ("load_spring",)
    )
    candidates = (
        Candidate("coulomb_friction", 3.0, True),
        Candidate("backlash", 0.4, False),
        Candidate("valve_lag", math.nan, False),
    )
    w = made[0]
    return Diagnosis(
        verdict="effects" if found else "clean",
        baseline=baseline,
        effects=(effect,) if found else (),
        extended=extended,
        noise_floor_nrmse=floor,
        unexplained=Unexplained(0.012, ("velocity",)) if found else Unexplained(0.0),
        next_experiment=NextExperiment(
            "relay of 0.2 V",
            "the spring alone bends it",
            ("coulomb_friction", "load_spring"),
            "seod simulate x",
        )
        if found
        else None,
        output="position",
        noise_sd=(NOISE,),
        adequacy=1.02,
        windows=tuple(made),
        whole=(Whole(w.t, w.y, w.y_baseline, w.y_extended),),
        candidates=candidates,
    )


def _window(k, n, found):
    u = command(n, k)
    t, y, v, a = simulate(u, FRICTION)
    linear = simulate(u, {})[1]
    scored = np.arange(n) >= n // 5
    y = y + np.random.default_rng(k).normal(0, NOISE, n)
    extended = simulate(u, FRICTION)[1] if found else linear
    return Window(
        0,
        (k * n, (k + 1) * n),
        t + k * n / RATE,
        u,
        y,
        None,
        None,
        linear,
        extended,
        v,
        extended,
        a,
        scored,
        bool(k % 2),
    )
