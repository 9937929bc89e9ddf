"""Recordings of a plant under a relay, by the one written apart, and models to fit to them."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
from diagnose_models import sized_model
from plant_truth import PLACE, Plant

from seod.data import Recording
from seod.diagnose.causes.scales import Scales
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments, sparse
from seod.diagnose.starts.relay.grid import grid_plants

TICK, N, VOLTS = 1e-3, 6000, 1.85
T = np.arange(N) * TICK
ROWS = {"lost": 8000}
"""Of what is lost between the grid's points: how its limit cycle grew shows in more than `N`."""
NOISE = 0.01
TRUTH = {"K_L": 13.0, "omega_n": 113.0, "zeta": 0.17}
STALLS = {"coulomb_friction": {"level": 5400.0}}
GIVES = {"coulomb_friction": {"level": 1500.0}, "lugre_friction": {"stiffness": 1e5, "damping": 150.0}}
PLAYS = {"backlash": {"gap": 0.15}}
BOTH = {"coulomb_friction": {"level": 2500.0}, "backlash": {"gap": 0.1}}
LOST = {"coulomb_friction": {"level": 5000.0}, "backlash": {"gap": 0.3}}
SWINGS = {"load_resonance": {"inertia": 1.0, "omega": 190.0, "zeta": 0.05}}
LOCKS = {"periodic_disturbance": {"amplitude": 9000.0, "omega": 88.0, "phase": 0.4}}
WAVES = {"position_ripple": {"amplitude": 0.08, "wavenumber": 20.0, "phase": 0.3}}


@cache
def recorded(kind):
    """Series of the plant written apart under a relay, whose threshold it crosses between samples."""
    every = {"stalls": STALLS, "gives": GIVES, "plays": PLAYS, "both": BOTH, "waves": WAVES, "locks": LOCKS}
    effects = (every | {"swings": SWINGS, "lost": LOST})[kind]
    plant, n = Plant(*TRUTH.values(), effects), ROWS.get(kind, N)
    t = np.arange(n) * TICK
    y, u, places = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        plant.advance(t[k])
        y[k], places[k] = plant.reading(plant.w), plant.w[PLACE]
        u[k] = -VOLTS if y[k] > 0.0 else VOLTS
        plant.command(u[k])
    y = y + np.random.default_rng(3).normal(0.0, NOISE * np.std(y), n)
    rows = np.arange(1, n + 1)
    return series(Recording((Path("relay.csv"),), t, u, y, None, None, None, rows, {}, {}, ())), places


GRIDS = {}


def grid_once(few):
    """Plants of the grid; of the same samples in the same windows they are found once, in some seconds."""
    key = (few.windows, *(each.tobytes() for one in few.series for each in (one.t, one.u, one.y, one.good)))
    if key not in GRIDS:
        GRIDS[key] = grid_plants(few)
    return GRIDS[key]


def gridded(kind):
    """Its plants of the grid."""
    return grid_once(sparse(segments(cut([recorded(kind)[0]])[0])))


def model_of(one, *names):
    """A model with these effects, in sizes of the recording."""
    rough = Scales(VOLTS, 10.0, 600.0, 0.0, 1.0, 0.5, 100.0, 8.0, TICK)
    return sized_model(one, rough, TRUTH, names)


def searched(model, effects, **base):
    values = {f"{name}.{of}": value for name, own in effects.items() for of, value in own.items()}
    for name in {"position_ripple"} & effects.keys():
        own = effects[name]
        values[f"{name}.cosine"] = own["amplitude"] * math.sin(own["phase"])
        values[f"{name}.sine"] = own["amplitude"] * math.cos(own["phase"])
    return model.searched(TRUTH | base | values)


def noise_of(kind):
    """Mean log squared error of nothing but the noise."""
    return 2.0 * math.log(NOISE * np.std(recorded(kind)[0].y) / math.hypot(1.0, NOISE))
