"""The closed form that other tests take as truth, against the matrix exponential."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from tests.unit.linear_plant import LinearPlant

ZETAS = [0.02, 0.3, 0.999999999, 1.0, 1.000000001, 1.5, 10.0]


@pytest.mark.parametrize("zeta", ZETAS)
@pytest.mark.parametrize("dt", [1e-6, 5e-4, 0.02, 0.3])
def test_a_step_is_the_matrix_exponential(zeta: float, dt: float) -> None:
    plant = LinearPlant(17.0, 110.0, zeta, bias=0.2, position=0.4)
    plant.velocity, plant.acceleration = -3.0, 250.0
    # Augmented with the held input, so that the particular solution comes from the same exponential.
    augmented = np.zeros((4, 4))
    augmented[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -(110.0**2), -2 * zeta * 110.0, 17.0 * 110.0**2]]
    expected = (expm(augmented * dt) @ [0.4, -3.0, 250.0, 0.7 - 0.2])[:3]
    plant.advance(dt, 0.7)
    found = [plant.position, plant.velocity, plant.acceleration]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-11)
