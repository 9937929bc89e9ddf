"""Two-phase excitation from the loop to the answer, on a plant that hydraulics' own equations move."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from drivers.base import Sample
from seod.processes.ring import AxisState
from tests.unit.loop_bench import RIG, Bench, merge
from tests.unit.ode_rig import Motor, OdeDriver
from tests.unit.whole_rig import WholeRig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytestmark = pytest.mark.slow

K_L = 17.0
PLANTS = [(0.21, 117.0), (0.45, 145.0), (0.8, 60.0)]


class Shaft(OdeDriver):
    """Its sensor reads the angle; commands take `delay` ticks to the valve."""

    delay = 0
    dead = 0.0
    """Half-width of the valve's dead band [V]."""

    def start(self) -> None:
        self.under_way = [0.0] * self.delay

    def read(self, t: float) -> list[Sample]:
        self.advance(t)
        return [Sample(float(self.solver.y[0]) + self.noise * self.random.standard_normal(), t)]

    def write(self, t: float, values: Any) -> float:
        opened = max(abs(values[0]) - self.dead, 0.0)
        self.under_way.append(math.copysign(opened, values[0]))
        return super().write(t, [self.under_way.pop(0)])


class ShaftBench(Bench):
    driver: Shaft  # type: ignore[assignment] # instead of the virtual one

    def __init__(self, motor: Motor, noise: float, delay: int, changes: dict[str, Any]) -> None:
        self.motor, self.noise, self.delay = motor, noise, delay
        super().__init__(changes)

    def make_driver(self) -> Shaft:  # type: ignore[override] # as above
        driver = Shaft(self.motor, self.pacer.now, self.noise)
        driver.delay = self.delay
        return driver


@pytest.fixture
def rig() -> Iterator[Callable[..., WholeRig]]:
    made: list[WholeRig] = []

    def make(zeta: float, omega_n: float, delay: int = 0, noise: float = 0.01, **axis: Any) -> WholeRig:
        size = 1.28 * K_L * 0.5 / (2.0 * zeta * omega_n)
        limits = {"amplitude": 6.0 * size, "travel": (-8.0 * size, 8.0 * size), "growth": 6.0}
        motor = {
            "K_L": {"identified": 30.0},
            "limits": limits,
            "relay": {"hysteresis": 3.0 * noise * size},
            "polarity": {"movement": 0.1 * size},
        }
        changes = merge({"axes": {"motor": motor}}, {"axes": {"motor": axis}})
        whole = WholeRig(ShaftBench(Motor(K_L, omega_n, zeta), noise * size, delay, changes))
        made.append(whole)
        whole.run(0.02)
        return whole

    yield make
    for each in made:
        each.close()


def excited(whole: WholeRig) -> WholeRig:
    assert whole.bench.call("start", 0) is None
    assert whole.run_until(lambda: whole.bench.state is AxisState.EXCITING, 4.0)
    return whole


def newest(whole: WholeRig) -> dict[str, Any]:
    return whole.newest("estimate")


def in_second(whole: WholeRig) -> bool:
    return whole.newest("sample").get("phase") == 2


def second_phase(whole: WholeRig) -> dict[str, float]:
    phase = whole.gateway.axes["motor"].second_phase
    assert phase is not None
    return phase


def phases(whole: WholeRig) -> list[str]:
    return [event["code"] for event in whole.told("event", event="two_phase")]


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_the_gain_is_found_within_a_second_and_put_in_force(
    rig: Callable[..., WholeRig], zeta: float, omega_n: float
) -> None:
    whole = excited(rig(zeta, omega_n))
    whole.run(1.0)
    found = newest(whole)
    assert found["quality"] == "ok"
    assert found["K_L"] == pytest.approx(K_L, rel=5e-3)
    assert found["zeta"] == pytest.approx(zeta, rel=0.01)
    assert found["omega_n"] == pytest.approx(omega_n, rel=5e-3)
    assert whole.newest("sample")["K_L"] == pytest.approx(K_L, rel=0.02)
    assert whole.gateway.axes["motor"].settings["K_L"] == pytest.approx(K_L, rel=0.02)
    assert {each["quality"] for each in whole.told("estimate")} == {"ok", "settling"}
    assert whole.bench.faults() == []


def test_a_delay_that_nobody_knew_of_comes_out_as_well(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.45, 145.0, delay=8))
    whole.run(1.2)
    assert newest(whole)["delay_s"] == pytest.approx(4e-3, abs=1e-4)
    assert newest(whole)["K_L"] == pytest.approx(K_L, rel=5e-3)
    assert newest(whole)["quality"] == "ok"


def test_a_dead_band_is_a_smaller_gain_and_no_damping(rig: Callable[..., WholeRig]) -> None:
    whole = rig(0.45, 145.0)
    driver: Any = whole.bench.driver
    driver.dead = 0.05
    excited(whole).run(1.0)
    found = newest(whole)
    assert found["quality"] == "ok"
    assert found["K_L"] == pytest.approx(0.9 * K_L, rel=5e-3)
    assert found["zeta"] == pytest.approx(0.45, rel=0.01)
    assert found["omega_n"] == pytest.approx(145.0, rel=5e-3)


def test_limits_are_kept_by_a_shorter_lateness(rig: Callable[..., WholeRig]) -> None:
    size = 1.28 * K_L * 0.5 / (2.0 * 0.8 * 60.0)
    whole = excited(rig(0.8, 60.0, limits={"amplitude": 2.2 * size}))
    whole.run(2.0)
    phase = whole.told("event", event="two_phase")[-1]["phase"]
    assert phase["late"] < 0.15 * phase["period"]
    swings = [abs(each["y"] - each["reference"]) for each in whole.told("sample") if each["phase"] == 2]
    assert 1.05 * size < max(swings) < 2.2 * size
    assert newest(whole)["K_L"] == pytest.approx(K_L, rel=0.01)
    assert whole.bench.faults() == []


def test_no_room_is_told_and_the_first_phase_goes_on(rig: Callable[..., WholeRig]) -> None:
    size = 1.28 * K_L * 0.5 / (2.0 * 0.8 * 60.0)
    whole = excited(rig(0.8, 60.0, limits={"amplitude": 1.25 * size}))
    whole.run(2.0)
    assert phases(whole) == []
    told = whole.told("event", event="warning", code="two_phase")
    assert len(told) == 1
    assert "swing would be" in told[0]["why"]
    assert {each["phase"] for each in whole.told("sample")} == {1}
    assert whole.bench.state is AxisState.EXCITING
    assert whole.gateway.axes["motor"].whole(0.0)["second_phase"] is None


def test_farther_than_foreseen_it_goes_back_and_tries_half_as_late(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.8, 60.0))
    assert whole.run_until(lambda: phases(whole) == ["chosen"], 2.0)
    first = second_phase(whole)
    course = whole.bench.loop.axes[0].course
    course.phases.phase = course.relay.phase._replace(swing=1.1 * newest(whole)["amplitude"])
    assert whole.run_until(lambda: "swing" in phases(whole), 2.0)
    limit = whole.bench.config.axes["motor"].limits.amplitude
    assert max(abs(each["y"] - each["reference"]) for each in whole.told("sample")) < limit
    assert whole.run_until(lambda: phases(whole)[-1] == "chosen", 2.0)
    assert second_phase(whole)["late"] == pytest.approx(0.5 * first["late"], rel=0.1)
    assert whole.bench.faults() == []


def test_turned_off_and_on_while_it_runs(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.45, 145.0))
    assert whole.run_until(lambda: in_second(whole), 2.0)
    assert whole.bench.call("set", 0, two_phase=False) is None
    whole.run(0.5)
    assert phases(whole) == ["chosen", "settings"]
    samples = whole.told("sample")
    assert {each["phase"] for each in samples[-500:]} == {1}
    assert whole.bench.call("set", 0, two_phase=True) is None
    assert whole.run_until(lambda: in_second(whole), 2.0)
    assert whole.bench.faults() == []


def test_another_amplitude_has_its_second_phase_chosen_anew(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.45, 145.0))
    assert whole.run_until(lambda: in_second(whole), 2.0)
    assert whole.bench.call("set", 0, e_a=0.8) is None
    assert whole.run_until(lambda: phases(whole) == ["chosen", "settings", "chosen"], 2.0)
    assert second_phase(whole)["e_a"] == 0.8


def test_estop_in_the_second_phase_is_neutral_and_forgets_it(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.45, 145.0))
    assert whole.run_until(lambda: in_second(whole), 2.0)
    whole.bench.call("estop")
    whole.run(0.05)
    assert whole.bench.state is AxisState.FAULT
    assert whole.newest("sample")["u"] == 0.0
    assert phases(whole)[-1] == "fault"
    assert whole.gateway.axes["motor"].second_phase is None
    assert whole.bench.call("reset", 0) is None
    assert whole.bench.loop.axes[0].course.phases.phase is None


def test_bursts_keep_it(rig: Callable[..., WholeRig]) -> None:
    burst = {"kind": "burst", "duration": 0.6, "pause": 0.1}
    whole = excited(rig(0.45, 145.0, excitation=burst, K_L={"identified": K_L}))
    assert whole.run_until(lambda: in_second(whole), 2.0)
    assert whole.run_until(lambda: whole.bench.state is AxisState.HOLDING, 2.0)
    assert whole.run_until(lambda: whole.bench.state is AxisState.EXCITING, 4.0)
    assert whole.run_until(lambda: in_second(whole), 0.5)
    assert "start" not in phases(whole)


def test_a_gain_that_is_known_stays_in_force(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.45, 145.0, K_L=20.0, excitation={"two_phase": {"enabled": True}}))
    whole.run(1.0)
    assert newest(whole)["K_L"] == pytest.approx(K_L, rel=5e-3)
    assert whole.bench.loop.axes[0].conditions.K_L == 20.0


def test_off_where_nobody_asked_for_it(rig: Callable[..., WholeRig]) -> None:
    whole = excited(rig(0.45, 145.0, K_L=K_L))
    whole.run(0.8)
    assert phases(whole) == []
    assert newest(whole)["K_L_sd"] == 0.0


@pytest.fixture
def speeds() -> Iterator[Callable[[float], WholeRig]]:
    made: list[WholeRig] = []

    def make(guess: float) -> WholeRig:
        motor = {
            "mode": "velocity",
            "reference": 32.5,
            "K_L": {"identified": guess},
            "relay": {"hysteresis": 0.004},
            "limits": {
                "output": 10.0,
                "travel": (-60.0, 190.0),
                "speed": None,
                "amplitude": 1.0,
                "growth": 6.0,
            },
            "polarity": {"movement": 3.0},
        }
        plant = {"measures": "velocity", "noise": 0.26}
        changes = {"axes": {"motor": motor}, "simulation": {"plants": {"motor": plant}}}
        sensor = {"sensors": {"angle": {"channel": "motor.angle", "unit": "rad/s"}}}
        made.append(WholeRig(Bench(merge(changes, sensor), RIG)))
        made[-1].run(0.05)
        return excited(made[-1])

    yield make
    for each in made:
        each.close()


def biases(whole: WholeRig) -> list[float]:
    return [each["bias"] for each in whole.told("sample") if each["state"] == "exciting"]


def test_speed_with_a_wrong_guess_comes_to_rest_on_the_right_gain(
    speeds: Callable[[float], WholeRig],
) -> None:
    whole = speeds(19.0)
    whole.run(0.8)
    found = newest(whole)
    assert found["quality"] == "ok"
    assert found["K_L"] == pytest.approx(K_L, rel=5e-3)
    volts = biases(whole)
    assert volts[-1] == pytest.approx(32.5 / K_L, rel=0.02)


@pytest.mark.parametrize(
    ("trim", "left"), [(0.25, 0.25 - 32.5 / 17 + 32.5 / 19), (0.05, 0.0), (-0.1, -0.1), (0.0, 0.0)]
)
def test_the_trim_gives_back_what_it_put_right(
    speeds: Callable[[float], WholeRig], trim: float, left: float
) -> None:
    mode: Any = speeds(19.0).bench.loop.axes[0].mode
    mode.trim = trim
    mode.absorb(17.0)
    assert mode.trim == pytest.approx(left)


def test_the_turns_between_the_phases_do_not_move_the_trim(speeds: Callable[[float], WholeRig]) -> None:
    whole = speeds(K_L)
    whole.run(1.5)
    late = biases(whole)[-1600:]
    assert max(late) - min(late) < 0.025
