"""Where the search for a disturbance begins."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from plant_truth import Plant

from seod.data import Recording
from seod.diagnose.begin import baseline, scales
from seod.diagnose.budget import Budget
from seod.diagnose.screen import screen
from seod.diagnose.select import excess
from seod.diagnose.windows import cut, pieces, series

T = np.arange(6000) / 500.0


def test_a_disturbance_that_was_taken_for_the_plant_s_own_swinging_is_found():
    shaken = {"periodic_disturbance": {"amplitude": 440.0, "omega": 34.2, "phase": 0.1}}
    plant, y = Plant(29.0, 42.7, 0.16, shaken), np.empty(len(T))
    steps = np.random.default_rng(5).uniform(-0.4, 0.4, 24)
    u = steps[(T / 0.5).astype(int)]
    for k in range(len(T)):
        plant.advance(T[k])
        plant.command(u[k])
        y[k] = plant.reading(plant.w)
    y += np.random.default_rng(6).normal(0.0, 0.01 * np.std(y), len(T))
    one = series(Recording((Path("run.csv"),), T, u, y, None, None, None, np.arange(len(T)), {}, {}, ()))
    small = pieces(cut([one])[0])
    screened = screen(small, map, Budget(time.process_time, 1e6))
    begun = baseline(screened.cut, False, {}).best
    assert abs(begun.model.values(begun.x)["omega_n"] - 34.2) < 0.2  # not 42.7
    parent = replace(begun, model=replace(begun.model, scales=scales(begun, screened.cut)))
    best = screened.extended([parent])[0]
    assert best.model.names == ("periodic_disturbance",)
    assert excess(best, screened.cut) < 1.1
