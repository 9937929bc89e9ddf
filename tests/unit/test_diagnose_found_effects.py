"""What an answer lists beside a found effect."""

import math
from types import SimpleNamespace

import pytest

from seod.diagnose.verdict.effects import _unrepeated

TRAVEL = 30.0


def fitted(waves, *, sees_speed=False):
    """A ripple of which the load passes so many waves."""
    values = {"position_ripple.wavenumber": 2.0 * math.pi * waves / TRAVEL, "load_spring.stiffness": 1.0}
    scales = SimpleNamespace(travel=TRAVEL, sees_speed=sees_speed)
    return SimpleNamespace(x=None, model=SimpleNamespace(values=lambda _: values, scales=scales))


@pytest.mark.parametrize(
    ("waves", "others"), [(1.1, ["sensor_nonlinearity"]), (1.9, ["sensor_nonlinearity"]), (2.1, [])]
)
def test_a_ripple_that_is_not_seen_twice_may_be_any_curve(waves, others):
    assert _unrepeated("position_ripple", fitted(waves)) == others


def test_no_curve_is_told_where_none_is_looked_for():
    assert _unrepeated("position_ripple", fitted(1.1, sees_speed=True)) == []


@pytest.mark.parametrize("name", ["load_spring", "periodic_disturbance"])
def test_of_what_is_no_wave_over_places_nothing_is_asked(name):
    assert _unrepeated(name, fitted(1.1)) == []
