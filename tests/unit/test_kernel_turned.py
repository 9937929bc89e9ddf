"""An actuator wired the other way round: gain and commands have the other sign, and it moves the same."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_cases import ALL_PAIRS, EFFECTS_ON, K_L, OMEGA_N, ZETA, apart, chosen, follow, record, steps

TURNED = {
    "null_shift": ("voltage",),
    "asymmetric_gain": ("ratio",),
    "static_valve_map": ("tilt_1", "tilt_2", "tilt_3"),
}
"""Numbers that belong to a sign of the command."""
T = np.arange(0.0, 0.4, 0.001)


def turned(effects):
    """The same valve, its command of the other sign."""
    return {
        name: {of: -value if of in TURNED.get(name, ()) else value for of, value in group.items()}
        for name, group in effects.items()
    }


def difference(names, **options):
    t_u, u = steps(T[-1])
    y, _ = follow(record(names, **options), t_u, u, T)
    other = record(names, plant=(-K_L, OMEGA_N, ZETA), effects=turned(chosen(*names)), **options)
    again, state = follow(other, t_u, -u, T)
    return apart(again, y), state["steps"]


@pytest.mark.parametrize("sees_speed", [False, True], ids=["position", "speed"])
@pytest.mark.parametrize("names", [(name,) for name in EFFECTS_ON], ids=EFFECTS_ON)
def test_each_effect_is_the_same(names, sees_speed):
    assert difference(names, sees_speed=sees_speed)[0] < 1e-9


@pytest.mark.slow
def test_every_pair_is_the_same():
    far = {names: by for names in ALL_PAIRS if (by := difference(names)[0]) > 1e-6}
    assert far == {}


@pytest.mark.parametrize("name", ["square_root_flow", "lugre_friction"])
def test_it_takes_as_many_steps(name):
    t_u, u = steps(T[-1])
    _, state = follow(record((name,)), t_u, u, T)
    assert difference((name,))[1] == state["steps"]
