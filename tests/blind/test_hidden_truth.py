"""Numbers as a recording can tell them: the same movement by the plant with them, and closed forms."""

import math

import numpy as np
import pytest
from hidden_cases import Case, draw, supply_of
from hidden_records import make_record
from hidden_rig import GIVEN, Drive, Rig, simulate
from hidden_truth import told_by_file, unit_of_position
from scipy.optimize import brentq

from seod.diagnose.causes.sensor import CURVE_MARGIN

T = np.arange(0.0, 0.12, 1e-3)
U = np.repeat([1.0, -1.0, 0.6, 0.3, -0.5, 1.0], 20)


def case_of(effects):
    rig = Rig(12.0, 140.0, 0.2, effects)
    return Case(7, "two", tuple(effects), "operation", rig, 1e-3, 0.12, 1.0, 0.01, 0.0)


def test_numbers_at_the_recordings_pressure_move_the_plant_as_the_hidden_ones_do():
    air = 0.8
    effects = {"pressure_dependent_stiffness": {"air": air}, "square_root_flow": {"supply": 3000.0}}
    case = case_of(effects)
    supply = supply_of(case)
    middle = float(np.median(supply))
    told, stiffer = told_by_file(case), math.sqrt((1.0 + air) / (1.0 + air / middle**2))
    there = Rig(12.0 * math.sqrt(middle), 140.0 * stiffer, 0.2 * stiffer, told)
    hidden, _ = simulate(case.rig, T, Drive(GIVEN, U), supply=supply)
    same, _ = simulate(there, T, Drive(GIVEN, U), supply=supply / middle)
    other, _ = simulate(Rig(12.0, 140.0, 0.2, effects), T, Drive(GIVEN, U), supply=supply / middle)
    np.testing.assert_allclose(same, hidden, atol=1e-6 * np.ptp(hidden))
    assert np.max(np.abs(other - hidden)) > 1e-3 * np.ptp(hidden)


def test_a_parabola_of_a_sensor_has_slope_1_where_its_straight_part_says_so():
    case = draw(7, "one", ("backlash",), "steps", sees_speed=False, duration=2.0)
    bent = -0.3 / float(np.ptp(make_record(case).y))
    case.rig.effects["sensor_nonlinearity"] = {"parabola": bent}
    y = make_record(case).y
    low, high = np.quantile(y, (1e-3, 1.0 - 1e-3))
    middle, half = 0.5 * (low + high), 0.5 * CURVE_MARGIN * (high - low)

    def off(place):
        slope = 1.0 + 2.0 * bent * place
        return place + bent * place**2 - middle + bent * half**2 / (3.0 * slope**2)

    slope = 1.0 + 2.0 * bent * brentq(off, low - half, high + half)
    assert slope != pytest.approx(1.0, abs=0.01)
    assert unit_of_position(case) == pytest.approx(slope, rel=1e-6)
    assert told_by_file(case)["backlash"]["gap"] == pytest.approx(
        slope * case.rig.effects["backlash"]["gap"], rel=1e-6
    )


def test_without_a_curve_or_a_pressure_nothing_is_converted():
    effects = {"coulomb_friction": {"level": 30.0}, "load_spring": {"stiffness": 200.0, "centre": 0.1}}
    assert told_by_file(case_of(effects)) == effects
