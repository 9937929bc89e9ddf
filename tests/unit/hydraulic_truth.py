"""A servo motor written apart from `sim.hydraulics`, for scipy: plain functions in SI."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

ATMOSPHERE = 101325.0


def stiffness(pressure, oil=1.4e9, air=0.01, n=1.4):
    """Volume change per pressure of a unit volume of oil plus air compressed from atmosphere, inverted."""
    absolute = pressure + ATMOSPHERE
    gas = air * (ATMOSPHERE / absolute) ** (1 / n)
    compliance = 1 / oil + gas / (n * absolute)
    return (1 + gas) / compliance


def root(drop, laminar=5e4):
    if abs(drop) >= laminar:
        return math.copysign(math.sqrt(abs(drop)), drop)
    x = drop / laminar
    return math.sqrt(laminar) * (1.25 * x - 0.25 * x**3)


def motor(volts, t, p):
    """Spool, two chambers and an inertia under held `volts` at `t`; rows of (pa, pb, speed, position)."""
    k = p["rated_flow"] / p["rated_volts"] / math.sqrt(p["rated_drop"] / 2)

    def slope(_, z):
        x, dx, pa, pb, w, _y = z
        forth, back = k * (max(x, 0) + p["gap"]), k * (max(-x, 0) + p["gap"])
        qa = forth * root(p["ps"] - pa) - back * root(pa)
        qb = back * root(p["ps"] - pb) - forth * root(pb)
        across = p["cross"] * (pa - pb)
        D, V = p["D"], p["V"]
        return [
            dx,
            p["omega"] ** 2 * (volts - x) - 2 * p["zeta"] * p["omega"] * dx,
            stiffness(pa, p["oil"], p["air"]) / V * (qa - D * w - across),
            stiffness(pb, p["oil"], p["air"]) / V * (qb + D * w + across),
            (D * (pa - pb) - p["b"] * w) / p["J"],
            w,
        ]

    begin = [0.0, 0.0, p["ps"] / 2, p["ps"] / 2, 0.0, 0.0]
    found = solve_ivp(slope, (t[0], t[-1]), begin, "DOP853", t, rtol=1e-9, atol=1e-9)
    return np.array([found.y[2], found.y[3], found.y[4], found.y[5]]).T
