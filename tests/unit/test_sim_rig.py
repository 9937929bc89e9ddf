"""The simulated rig: when commands count, when the watchdog bites, what can be seen of it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from sim.actuator import HISTORY
from sim.config import PlantConfig, SimulationConfig
from sim.rig import SimulatedRig
from tests.unit.linear_plant import LinearPlant

START = 1000.0


def plant_config(**changes: object) -> PlantConfig:
    values = {"input": "valve", "output": "angle", "K_L": 17.0, "omega_n": 100.0, "zeta": 0.3}
    return PlantConfig.model_validate({**values, **changes})


def make_rig(
    watchdog_s: float = 0.02, constants: dict[str, float] | None = None, **changes: object
) -> SimulatedRig:
    config = SimulationConfig(
        plants={"motor": plant_config(**changes)}, constants=constants or {}, watchdog_s=watchdog_s
    )
    return SimulatedRig(config, START)


def test_each_command_counts_from_its_own_time() -> None:
    rig = make_rig()
    rig.apply(START + 0.0031, {"valve": 0.5})
    rig.apply(START + 0.0107, {"valve": -0.2})
    reading = rig.measure(START + 0.0200)["angle"]
    plant = LinearPlant(17.0, 100.0, 0.3)
    plant.advance(0.0031, 0.0)
    plant.advance(0.0076, 0.5)
    plant.advance(0.0093, -0.2)
    assert reading == pytest.approx(plant.position, rel=2e-6)
    assert reading > 0.01


@given(looks=st.lists(st.floats(0.0, 0.1), max_size=20))
def test_looking_changes_nothing(looks: list[float]) -> None:
    watched, unwatched = make_rig(), make_rig()
    for rig in (watched, unwatched):
        rig.apply(START + 0.01, {"valve": 0.5})
    for look in sorted(looks):
        watched.measure(START + look)
    end = START + 0.1
    assert watched.measure(end)["angle"] == pytest.approx(unwatched.measure(end)["angle"], rel=2e-6)
    assert watched.state(end)["motor"]["watchdog_trips"] == 1


def test_the_watchdog_trips_exactly_at_its_time() -> None:
    rig = make_rig(watchdog_s=0.02)
    rig.apply(START, {"valve": 0.5})
    assert rig.state(START + 0.02)["motor"]["voltage"] == 0.5
    state = rig.state(START + 0.05)["motor"]
    assert state["voltage"] == 0.0
    assert state["watchdog_tripped"] is True
    assert state["neutral_since"] == pytest.approx(START + 0.02)
    plant = LinearPlant(17.0, 100.0, 0.3)
    plant.advance(0.02, 0.5)
    plant.advance(0.03, 0.0)
    assert state["position"] == pytest.approx(plant.position, rel=2e-6)


def test_commands_that_keep_coming_keep_the_watchdog_quiet() -> None:
    rig = make_rig(watchdog_s=0.02)
    for k in range(10):
        rig.apply(START + 0.019 * k, {"valve": 0.5})
    state = rig.state(START + 0.19)["motor"]
    assert (state["watchdog_trips"], state["voltage"], state["commands"]) == (0, 0.5, 10)


def test_a_new_command_ends_a_trip() -> None:
    rig = make_rig(watchdog_s=0.02)
    rig.apply(START, {"valve": 0.5})
    rig.apply(START + 1.0, {"valve": 0.3})
    state = rig.state(START + 1.0)["motor"]
    assert (state["watchdog_tripped"], state["watchdog_trips"], state["voltage"]) == (False, 1, 0.3)
    assert state["neutral_since"] is None


def test_a_rig_that_was_never_commanded_has_not_tripped() -> None:
    state = make_rig().state(START + 5.0)["motor"]
    assert state["watchdog_tripped"] is False
    assert state["last_command_age"] is None
    assert state["neutral_since"] == START


def test_commands_after_neutral_are_counted_and_remembered() -> None:
    rig = make_rig()
    rig.apply(START + 0.001, {"valve": 0.5})
    assert rig.state(START + 0.001)["motor"]["commands_since_neutral"] == 0
    rig.apply(START + 0.002, {"valve": 0.0})
    assert rig.state(START + 0.003)["motor"]["commands_since_neutral"] == 0
    rig.apply(START + 0.004, {"valve": 0.0})
    state = rig.state(START + 0.03)["motor"]
    assert state["neutral_since"] == START + 0.002
    assert state["commands_since_neutral"] == 1
    assert state["last_command_age"] == pytest.approx(0.026)
    assert list(rig.actuators["motor"].history) == [
        (START + 0.001, 0.5),
        (START + 0.002, 0.0),
        (START + 0.004, 0.0),
    ]


def test_the_history_is_bounded() -> None:
    rig = make_rig()
    for k in range(HISTORY + 5):
        rig.apply(START + k * 1e-3, {"valve": float(k)})
    history = rig.actuators["motor"].history
    assert (len(history), history[0][1]) == (HISTORY, 5.0)


def test_the_valve_saturates_but_what_was_asked_is_remembered() -> None:
    rig = make_rig(effects={"valve_saturation": {"limit": 2.0}})
    rig.apply(START, {"valve": -7.0})
    state = rig.state(START)["motor"]
    assert (state["voltage"], state["spool"]) == (-7.0, -2.0)
    assert rig.actuators["motor"].history[-1] == (START, -7.0)


@pytest.mark.parametrize("volts", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_number_is_neutral(volts: float) -> None:
    rig = make_rig()
    rig.apply(START, {"valve": 0.5})
    rig.apply(START + 0.001, {"valve": volts})
    assert rig.state(START + 0.001)["motor"]["neutral_since"] == START + 0.001


def test_time_never_goes_back() -> None:
    rig = make_rig()
    rig.measure(START + 0.01)
    rig.apply(START + 0.005, {"valve": 0.5})
    assert list(rig.actuators["motor"].history) == [(START + 0.01, 0.5)]


def test_plants_do_not_share_noise_commands_or_watchdogs() -> None:
    plants = {
        "pitch": plant_config(input="u1", output="y1", noise=0.01),
        "roll": plant_config(input="u2", output="y2", noise=0.01),
    }
    rig = SimulatedRig(SimulationConfig(plants=plants, constants={"estop": 1.0}), START)
    rig.apply(START, {"u1": 0.5, "stranger": 9.0})
    state = rig.state(START + 0.01)
    assert (state["pitch"]["commands"], state["roll"]["commands"]) == (1, 0)
    readings = make_rig(noise=0.01).measure(START), rig.measure(START)
    assert readings[1]["y1"] != readings[1]["y2"]
    assert readings[1]["estop"] == 1.0


def test_the_seed_decides_the_noise() -> None:
    def readings(seed: int) -> list[float]:
        rig = SimulatedRig(SimulationConfig(plants={"motor": plant_config(noise=0.01)}, seed=seed), START)
        return [rig.measure(START)["angle"] for _ in range(5)]

    assert readings(1) == readings(1)
    assert readings(1) != readings(2)


def test_parameters_change_from_their_time_on_and_the_truth_with_them() -> None:
    rig = make_rig(watchdog_s=1.0)
    rig.apply(START, {"valve": 0.5})
    rig.actuators["motor"].change(START + 0.05, {"omega_n": 60.0, "stops": [-1.0, 5.0]})
    assert rig.truth() == {"motor": {"K_L": 17.0, "omega_n": 60.0, "zeta": 0.3}}
    plant = LinearPlant(17.0, 100.0, 0.3)
    plant.advance(0.05, 0.5)
    plant.change(17.0, 60.0, 0.3, 0.0)
    plant.advance(0.05, 0.5)
    assert rig.measure(START + 0.1)["angle"] == pytest.approx(plant.position, rel=2e-6)
    rig.actuators["motor"].change(START + 0.1, {"position": 3.0})
    assert rig.measure(START + 0.1)["angle"] == 3.0


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"omega_n": -1.0}, "omega_n"),
        ({"omega": 5.0}, "omega"),
        ({"input": "other"}, "input"),
        ({"K_L": "2"}, "K_L"),
    ],
)
def test_impossible_parameters_are_refused_by_name(values: dict[str, object], named: str) -> None:
    rig = make_rig()
    with pytest.raises(ValueError, match=named):
        rig.actuators["motor"].change(START, values)
    assert rig.truth()["motor"]["omega_n"] == 100.0


@pytest.mark.parametrize(
    "section",
    [
        {"plants": {"a": plant_config(), "b": plant_config(output="other")}},
        {"plants": {"a": plant_config(), "b": plant_config(input="other")}},
        {"plants": {"a": plant_config()}, "constants": {"angle": 1.0}},
    ],
)
def test_a_channel_with_two_sources_is_refused(section: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match="used twice"):
        SimulationConfig.model_validate(section)


def test_a_load_outside_its_stops_is_refused() -> None:
    with pytest.raises(ValidationError, match="between the stops"):
        plant_config(position=2.0, stops=(-1.0, 1.0))
