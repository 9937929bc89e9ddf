"""Which sizes may be none, how sure they are, and what is at its limit."""

from dataclasses import replace

import numpy as np
import pytest
from account_truth import fitted_lag

from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.uncertainty import at_limits, covariance, is_at_null, p_value, reaches_null


@pytest.fixture(scope="module")
def lagging():
    return fitted_lag()


def test_a_size_that_may_be_none_is_no_cause(lagging):
    spread = covariance(lagging)
    assert not reaches_null(lagging, "valve_lag", spread, 1)
    k = [c.place for c in lagging.model.coordinates].index("valve_lag.time")
    sure = spread[k, k]
    vague = spread.copy()
    vague[k, k] = sure * (0.7 * lagging.x[k] / np.sqrt(sure)) ** 2
    assert reaches_null(lagging, "valve_lag", vague, 1)
    vague[k, k] = (0.4 * lagging.x[k]) ** 2  # 2.5 standard deviations: the largest of 24 by chance
    assert not reaches_null(lagging, "valve_lag", vague, 1)
    assert reaches_null(lagging, "valve_lag", vague, 24)
    at_none = replace(lagging, x=np.where(np.arange(4) == k, lagging.model.bounds[0], lagging.x))
    assert reaches_null(at_none, "valve_lag", spread, 1)
    assert at_limits(at_none) == []
    assert is_at_null(at_none, "valve_lag")
    assert not is_at_null(lagging, "valve_lag")
    far = replace(lagging, x=np.where(np.arange(4) == k, lagging.model.bounds[1], lagging.x))
    assert not reaches_null(far, "valve_lag", spread, 1)
    assert not is_at_null(far, "valve_lag")
    assert at_limits(far) == ["valve_lag.time"]
    low, high = lagging.model.bounds
    near = replace(far, x=far.x - 1e-5 * np.where(np.arange(4) == k, high - low, 0.0))
    assert at_limits(near) == ["valve_lag.time"]
    assert at_limits(replace(far, x=far.x - 0.01 * np.where(np.arange(4) == k, high - low, 0.0))) == []


def test_a_cause_of_several_sizes_may_be_none_only_if_all_of_them_may(lagging):
    """Of a sensor that never saw the other sign only the power is known."""
    model = lagging.model.without("valve_lag").with_effect("rectified_sensor")
    x = model.searched(
        {
            "K_L": 17.0,
            "omega_n": 117.0,
            "zeta": 0.3,
            "rectified_sensor.part": 0.9,
            "rectified_sensor.power": 1.3,
        }
    )
    fitted = replace(lagging, model=model, x=x)
    places = [c.place for c in model.coordinates]
    part, power = (places.index(f"rectified_sensor.{of}") for of in ("part", "power"))

    def spread(of_part, of_power):
        out = 1e-8 * np.eye(len(x))
        out[part, part], out[power, power] = of_part**2, of_power**2
        return out

    assert not reaches_null(fitted, "rectified_sensor", spread(9.0, 0.02), 1)
    assert not reaches_null(fitted, "rectified_sensor", spread(0.02, 9.0), 1)
    assert reaches_null(fitted, "rectified_sensor", spread(9.0, 9.0), 1)


def test_an_interval_is_never_of_no_width(lagging):
    """Nor that of a fit which ended before its first step."""
    ended = fit(lagging.model, lagging.cut, lagging.x, lagging.start, ended=lambda: True)
    np.testing.assert_allclose(
        np.sqrt(covariance(ended).diagonal()), np.sqrt(covariance(lagging).diagonal()), rtol=0.05
    )


def test_chance_counts_as_often_as_causes_were_tried(lagging):
    held = simulate_held_out(lagging.model, lagging.x, lagging.cut)
    worse = replace(held, simulated=held.simulated + 1e-4 * np.sin(np.arange(len(held.simulated)) / 50.0))
    once = p_value(worse, held)
    assert 0.0 < once < 0.9
    assert p_value(worse, held, 7) == pytest.approx(min(1.0, 7.0 * once))
