"""The virtual driver on a clock that the test moves, and on the real one."""

from __future__ import annotations

import math
import time
from itertools import pairwise

import pytest

from drivers.base import DriverError, DriverStateError
from drivers.virtual import VirtualDriver, VirtualOptions
from sim.config import PlantConfig, SimulationConfig
from tests.unit.linear_plant import LinearPlant


class ManualClock:
    """A clock that stands until it is moved."""

    def __init__(self) -> None:
        self.t = 50.0

    def __call__(self) -> float:
        return self.t


def make_options(realtime: bool = False) -> VirtualOptions:
    plant = PlantConfig(input="valve", output="angle", K_L=17.0, omega_n=100.0, zeta=0.3)
    simulation = SimulationConfig(plants={"motor": plant}, constants={"estop": 1.0}, watchdog_s=0.02)
    return VirtualOptions(kind="virtual", realtime=realtime, simulation=simulation)


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def driver(clock: ManualClock) -> VirtualDriver:
    driver = VirtualDriver(make_options(), clock)
    driver.open(["angle", "estop"], ["valve"])
    driver.start()
    return driver


def test_it_reads_at_the_tick_and_commands_at_the_clock(driver: VirtualDriver, clock: ManualClock) -> None:
    t = clock.t
    clock.t = t + 0.0005
    assert driver.write(t, [0.5]) == t + 0.0005
    angle, estop = driver.read(t + 0.010)
    plant = LinearPlant(17.0, 100.0, 0.3)
    plant.advance(0.0095, 0.5)
    assert angle.t == t + 0.010
    assert angle.value == pytest.approx(plant.position, rel=1e-6)
    assert estop == (1.0, t + 0.010)


def test_neutral_stands_and_a_forgotten_plant_trips_its_watchdog(
    driver: VirtualDriver, clock: ManualClock
) -> None:
    driver.write(clock.t, [0.5])
    clock.t += 0.01
    assert driver.neutral(clock.t) == clock.t
    assert driver.rig is not None
    assert driver.rig.state(clock.t)["motor"]["neutral_since"] == clock.t
    driver.read(clock.t + 1.0)
    assert dict(zip(driver.counter_names, driver.counters, strict=True)) == {
        "samples": 1,
        "commands": 2,
        "watchdog_trips": 1,
    }


def test_simulated_time_is_never_waited_for(driver: VirtualDriver, clock: ManualClock) -> None:
    period = 1 / 2000
    start = clock.t
    assert driver.wait(start + 0.5 * period) is False
    assert [driver.wait(start + 3.5 * period) for _ in range(4)] == [True, True, True, False]
    assert clock.t == start


def test_samples_that_passed_unseen_are_not_made_up(driver: VirtualDriver, clock: ManualClock) -> None:
    period = 1 / 2000
    clock.t += 10.5 * period
    assert driver.wait(clock.t) is True
    assert driver.wait(clock.t) is False
    assert driver.wait(clock.t + period) is True


def test_in_real_time_a_sample_is_waited_for() -> None:
    driver = VirtualDriver(make_options(realtime=True), time.monotonic)
    driver.open(["angle"], ["valve"])
    driver.start()
    start = time.monotonic()
    ticks = []
    for _ in range(20):
        assert driver.wait(math.inf) is True
        ticks.append(time.monotonic())
    assert ticks[-1] - start >= 20 / 2000
    assert all(later > earlier for earlier, later in pairwise(ticks))
    driver.close()


def test_truth_and_channels_come_from_the_options() -> None:
    driver = VirtualDriver(make_options(), ManualClock())
    assert driver.truth() == {"motor": {"K_L": 17.0, "omega_n": 100.0, "zeta": 0.3}}
    assert [(c.name, c.direction, c.unit) for c in driver.channels(make_options())] == [
        ("valve", "output", ""),
        ("angle", "input", ""),
        ("estop", "input", ""),
    ]


def test_without_a_simulation_it_says_what_is_missing() -> None:
    options = VirtualOptions(kind="virtual")
    with pytest.raises(DriverError, match="needs a simulation: section"):
        VirtualDriver.channels(options)
    with pytest.raises(DriverError, match="needs a simulation: section"):
        VirtualDriver(options, ManualClock())


@pytest.mark.parametrize(("inputs", "outputs"), [(["valve"], []), (["angle"], ["estop"]), (["nothing"], [])])
def test_an_unknown_channel_is_refused_with_the_known_ones(inputs: list[str], outputs: list[str]) -> None:
    driver = VirtualDriver(make_options(), ManualClock())
    with pytest.raises(DriverError, match=r"there are .*(angle|valve)"):
        driver.open(inputs, outputs)


def test_calls_in_the_wrong_state_say_what_to_call_first(driver: VirtualDriver, clock: ManualClock) -> None:
    with pytest.raises(DriverStateError, match="close it first"):
        driver.open(["angle"], ["valve"])
    driver.close()
    driver.close()
    with pytest.raises(DriverStateError, match="open"):
        driver.read(clock.t)
    with pytest.raises(DriverStateError, match="open"):
        driver.write(clock.t, [0.0])
    with pytest.raises(DriverStateError, match="open"):
        driver.neutral(clock.t)
    with pytest.raises(DriverStateError, match="open"):
        driver.start()
    with pytest.raises(DriverStateError, match="start"):
        driver.wait(clock.t)


def test_another_process_cannot_write_its_neutral() -> None:
    assert VirtualDriver(make_options(), ManualClock()).neutral_recipe()["kind"] == "none"
