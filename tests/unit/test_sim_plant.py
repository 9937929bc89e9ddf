"""The plant of the real-time loop: commands, looks and changes on a time line, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import plant as plant_module
from sim.parameters import parameters
from sim.plant import Plant
from tests.unit.linear_plant import LinearPlant

T = 5e4
"""The machine's clock tells large numbers."""

K_L, OMEGA_N, ZETA = 17.0, 110.0, 0.3
CLOSE = 2e-5
"""Of movements of about 1 rad: the kernel's tolerance, docs/model.md."""


def plant(effects: dict[str, dict[str, float]] | None = None, zeta: float = ZETA, **base: float) -> Plant:
    return Plant(parameters(K_L, OMEGA_N, zeta, effects, **base), T, 0.4)


@pytest.mark.parametrize("zeta", [0.02, 0.3, 1.0, 4.0])
def test_without_effects_it_is_the_linear_plant(zeta: float) -> None:
    found, truth = plant(zeta=zeta), LinearPlant(K_L, OMEGA_N, zeta, position=0.4)
    found.command(T, 0.5)
    for k in range(1, 200):
        truth.advance(1e-3, 0.5 if k // 40 % 2 == 0 else -0.5)
        assert found.measured(T + k * 1e-3) == pytest.approx(truth.position, abs=CLOSE)
        found.command(T + k * 1e-3, 0.5 if (k + 1) // 40 % 2 == 0 else -0.5)
    assert found.velocity == pytest.approx(truth.velocity, abs=CLOSE * OMEGA_N)


@given(looks=st.lists(st.floats(-0.1, 0.1), max_size=20), delay=st.sampled_from([0.0, 3e-3]))
def test_looking_changes_nothing_nor_does_looking_back(looks: list[float], delay: float) -> None:
    seen, unseen = (plant({"transport_delay": {"time": delay}, "valve_lag": {"time": 2e-3}}) for _ in "ab")
    for each in (seen, unseen):
        each.command(T + 0.01, 0.5)
    for look in looks:
        seen.measured(T + look)
    assert seen.t == T + max([0.01, *looks])
    assert seen.measured(T + 0.1) == pytest.approx(unseen.measured(T + 0.1), abs=CLOSE)


def test_a_delayed_command_is_an_early_one_seen_late_to_any_fraction() -> None:
    late, prompt = plant({"transport_delay": {"time": 3.21e-3}}), plant()
    for k in range(40):  # several are under way at each moment
        volts = 0.5 if k % 20 < 10 else -0.3
        late.command(T + k * 1e-3, volts)
        prompt.command(T + k * 1e-3 + 3.21e-3, volts)
    assert late.measured(T + 0.06) == pytest.approx(prompt.measured(T + 0.06), abs=CLOSE)


def test_a_shorter_delay_does_not_let_a_command_overtake_another() -> None:
    changed = plant({"transport_delay": {"time": 5e-3}})
    changed.command(T, 1.0)
    changed.change(T + 1e-3, parameters(K_L, OMEGA_N, ZETA))
    changed.command(T + 1e-3, -1.0)
    changed.measured(T + 4e-3)
    assert changed.spool == 0.0  # the newer command waits behind the one under way
    changed.measured(T + 6e-3)
    assert changed.spool == -1.0


@pytest.mark.parametrize(
    ("effects", "spool"),
    [
        ({"valve_saturation": {"limit": 0.3}}, 0.3),
        ({"valve_hysteresis": {"half_width": 0.1}}, 0.4),
        ({"valve_lag": {"time": 1e-3}}, 0.5 * (1.0 - math.exp(-1.0))),
        ({"transport_delay": {"time": 2e-3}}, 0.0),
    ],
)
def test_the_spool_is_where_the_valves_effects_put_it(
    effects: dict[str, dict[str, float]], spool: float
) -> None:
    found = plant(effects)
    found.command(T, 0.5)
    found.advance(T + 1e-3)
    assert found.spool == pytest.approx(spool)


def test_a_speed_is_measured_where_the_sensor_sees_speed() -> None:
    found = plant(measures_speed=1.0)
    found.command(T, 0.5)
    assert found.measured(T + 1.0) == pytest.approx(K_L * 0.5)
    assert found.measured(T + 1.0) == found.velocity


def test_changed_parameters_count_from_their_time_on_and_the_movement_goes_on() -> None:
    found, truth = plant(), LinearPlant(K_L, OMEGA_N, ZETA, position=0.4)
    found.command(T, 0.5)
    truth.advance(0.05, 0.5)
    found.change(T + 0.05, parameters(9.0, 40.0, 2.0))
    truth.change(9.0, 40.0, 2.0, 0.0)
    truth.advance(0.05, 0.5)
    assert found.measured(T + 0.1) == pytest.approx(truth.position, abs=CLOSE)


@pytest.mark.parametrize(
    "effects",
    [
        {"sensor_lag": {"time": 5e-3}},
        {"backlash": {"gap": 0.02}},
        {"load_resonance": {"inertia": 0.5, "omega": 300.0}},
        {"coulomb_friction": {"level": 50.0}, "lugre_friction": {"stiffness": 1e5}},
        {"valve_lag": {"time": 5e-3}, "spool_inertia": {"omega": 300.0}},
        {"parameter_drift": {"K_L": 0.5}},
        {"periodic_disturbance": {"amplitude": 100.0}},
    ],
)
def test_an_effect_switched_on_late_makes_no_jump(effects: dict[str, dict[str, float]]) -> None:
    found, without = plant(), plant()
    for each in (found, without):
        each.command(T, 0.5)
        each.advance(T + 20.0)
    found.change(T + 20.0, parameters(K_L, OMEGA_N, ZETA, effects))
    step = K_L * 0.5 * 1e-4
    assert found.measured(T + 20.0 + 1e-4) == pytest.approx(without.measured(T + 20.0), abs=0.011 + 2 * step)
    assert found.velocity == pytest.approx(without.velocity, abs=0.05)


def test_a_load_that_is_moved_takes_all_along_and_leaves_its_stop() -> None:
    effects = {"backlash": {"gap": 0.01}, "sensor_lag": {"time": 1e-3}, "load_resonance": {"inertia": 0.5}}
    found = plant(effects, stop_high=0.6)
    found.command(T, 0.5)
    found.advance(T + 1.0)
    assert found.position == 0.6
    found.command(T + 1.0, 0.0)
    found.advance(T + 2.0)
    found.place(T + 2.0, 0.1)
    assert found.position == 0.1
    assert found.measured(T + 2.0) == pytest.approx(0.1, abs=0.006)
    found.command(T + 2.0, 0.1)
    assert 0.15 < found.measured(T + 2.1) < 0.35


def test_whole_numbers_are_numbers_too_and_nothing_is_compiled_for_them() -> None:
    found = Plant(parameters(K_L, OMEGA_N, ZETA), 0)
    found.command(1, 1)
    found.command(np.float32(1.5), np.int64(1))
    assert found.measured(2) == pytest.approx(K_L * (1.0 - 2.0 * ZETA / OMEGA_N))
    entries: list[Any] = [plant_module.arrive, plant_module.look]
    assert [len(entry.signatures) for entry in entries] == [1, 1]


def test_it_follows_pressure_and_temperature() -> None:
    effects: dict[str, Any] = {
        "square_root_flow": {"supply": 1e6},
        "parameter_drift": {"K_L_thermal": -0.01},
    }
    found = plant(effects, measures_speed=1.0)
    found.command(T, 0.5)
    nominal = found.measured(T + 1.0)
    assert nominal == pytest.approx(K_L * 0.5, rel=1e-3)
    found.condition(T + 1.0, 0.25, 0.0)
    assert found.measured(T + 2.0) == pytest.approx(0.5 * nominal, rel=1e-3)
    found.condition(T + 2.0, 1.0, 20.0)
    assert found.measured(T + 3.0) == pytest.approx(0.8 * nominal, rel=1e-3)
