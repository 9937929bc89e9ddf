"""`K_L_sd` and `delay_sd` of a rig file: numbers, times with a unit, or `unknown`."""

from __future__ import annotations

import math

import pytest
from fake_loop import rig_config
from pydantic import ValidationError

from seod.config.axis import EstimatorConfig
from seod.estimate import make_estimator
from seod.observe.estimation import Axis


@pytest.mark.parametrize(
    ("written", "sd"),
    [
        ({}, (0.0, 1e-3)),  # two ticks are left open
        ({"K_L_sd": 0.2, "delay_sd": "1 ms"}, (0.2, 1e-3)),
        ({"K_L_sd": "unknown", "delay_sd": "unknown"}, (math.inf, math.inf)),
    ],
)
def test_the_estimator_gets_what_is_written(written, sd):
    config = rig_config().axes["motor"].model_copy(update={"estimator": EstimatorConfig(**written)})
    known = Axis("motor", config, 5e-4, make_estimator)._estimator_settings()
    assert (known.K_L_sd, known.delay_sd) == sd


@pytest.mark.parametrize("wrong", [-1.0, math.inf, "some", "1 V"])
@pytest.mark.parametrize("key", ["K_L_sd", "delay_sd"])
def test_anything_else_is_refused_in_one_sentence(key, wrong):
    with pytest.raises(ValidationError) as told:
        EstimatorConfig(**{key: wrong})
    assert len(told.value.errors()) == 1
