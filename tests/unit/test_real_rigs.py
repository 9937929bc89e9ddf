"""The plants that docs/diagnosis-*.md tell of two measured rigs leave what the pages say, and no more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seod.data import read
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state

DATA = Path(__file__).parents[3] / "shared" / "data"
NONE = np.empty(0)

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured records are not in {DATA}")


def left(name, plant, speed):
    """Error of one simulation of the whole record, a speed's offset apart, over its standard deviation."""
    data = read(DATA / name)
    p = parameters(*plant, accuracy=0.3, measures_speed=float(speed))
    s = new_state(p, float(data.t[0]), 0.0 if speed else float(data.y[0]))
    s["velocity"] = data.y[0] if speed else 0.0
    y = np.empty(len(data.t))
    follow(p[0], s[0], data.t, data.u, data.t, NONE, NONE, NONE, NONE, y)
    error = data.y - y
    return float(np.sqrt(np.mean((error - (error.mean() if speed else 0.0)) ** 2)) / np.std(data.y))


@pytest.mark.slow
@needs_data
def test_friction_explains_the_positioning_record_better_than_published():
    effects = {"coulomb_friction": {"level": 0.24819}, "load_bias": {"acceleration": -0.037205}}
    motor = 0.187904, 40.0 * 2.064468, 20.0
    name = "electromechanical_positioning.csv.gz"
    assert left(name, (*motor, effects), False) == pytest.approx(0.0308, abs=0.001)
    assert left(name, (*motor, {}), False) > 1.0


@pytest.mark.slow
@needs_data
def test_play_of_the_valve_explains_what_a_delay_leaves_of_the_chirp():
    effects = {"transport_delay": {"time": 1.53e-3}, "valve_hysteresis": {"half_width": 0.04587}}
    actuator = 1.00035, 142.1256, 1.67263
    name = "servohydraulic_chirp.csv.gz"
    assert left(name, (*actuator, effects), True) == pytest.approx(0.0360, abs=0.001)
    del effects["valve_hysteresis"]
    assert left(name, (*actuator, effects), True) > 0.045
