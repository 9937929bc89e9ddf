"""One rig written apart, by exact transitions of short steps: a record of it, to be told in any unit."""

import numpy as np
from scipy.linalg import expm

RATE = 250.0
K_L, OMEGA_N, ZETA = 0.08, 60.0, 0.4
"""Of a cylinder: 80 mm/s/V."""
SUBSTEPS = 16
"""Of a sampling interval, in which friction is held."""


def record(
    seconds, *, friction=0.0, stiffness=0.0, gap=0.0, noise=0.01, seed=3, speeds=False, through=lambda u: u
):
    """Commands [V] and noisy positions [m] at `RATE`, from rest; with `speeds` speeds [m/s], without a gap.

    `friction` is an acceleration [m/s^2], `stiffness` of a spring [1/s^2], `gap` [m]. `through` tells
    what commands become on their way to the plant.
    """
    random = np.random.default_rng(seed)
    u = multisine(round(seconds * RATE), random)
    places, fast = moved(through(u), friction, stiffness)
    y = fast if speeds else behind(places, gap)
    return u, y + random.normal(0.0, noise * np.std(y), len(y))


def multisine(n, random, volts=2.0):
    """All multiples of half a hertz up to 20 Hz."""
    t = np.arange(n) / RATE
    lines = np.arange(0.5, 20.0, 0.5)
    u = np.cos(2.0 * np.pi * np.outer(t, lines) + random.uniform(0.0, 2.0 * np.pi, len(lines))).sum(axis=1)
    return volts * u / np.max(np.abs(u))


def moved(u, friction, stiffness):
    """Position [m] and speed [m/s] of the load, shape (2, n); pressure is the third of its states.

    Each command holds until the next row.
    """
    dynamics = np.array(
        [[0.0, 1.0, 0.0], [-stiffness, 0.0, 1.0], [0.0, -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N]]
    )
    inputs = np.array([[0.0, 0.0], [0.0, -1.0], [K_L * OMEGA_N**2, 0.0]])
    moves = stepped(dynamics, inputs)
    dynamics[:2], inputs[:2] = 0.0, 0.0
    rests = stepped(dynamics, inputs)
    state, slides, out = (0.0, 0.0, 0.0), 0, np.empty((2, len(u)))
    for k, volts in enumerate(u.tolist()):
        out[:, k] = state[:2]
        for _ in range(SUBSTEPS):
            pushed = state[2] - stiffness * state[0]
            if slides == 0 and abs(pushed) > friction:
                slides = 1 if pushed > 0.0 else -1
            x, v, p = applied(moves if slides else rests, state, volts, slides * friction)
            if slides * v < 0.0:
                slides, v = 0, 0.0
            state = x, v, p
    return out


def stepped(dynamics, inputs):
    """Transition of a short step: by state rows of weights of the state, of the volts and of the friction."""
    whole = np.zeros((5, 5))
    whole[:3, :3], whole[:3, 3:] = dynamics, inputs
    return expm(whole / (RATE * SUBSTEPS))[:3].tolist()


def applied(rows, state, volts, held):
    """The state after it."""
    x, v, p = state
    return tuple(a * x + b * v + c * p + d * volts + e * held for a, b, c, d, e in rows)


def behind(positions, gap):
    """What a sensor behind a gap sees [m]."""
    seen, out = positions[0], np.empty(len(positions))
    for k, at in enumerate(positions.tolist()):
        seen = min(max(seen, at - 0.5 * gap), at + 0.5 * gap)
        out[k] = seen
    return out
