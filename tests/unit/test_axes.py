"""Several axes in one loop, on simulated time: independence, fault policy, order of excitation, estimates."""

from __future__ import annotations

import math
from statistics import median
from typing import TYPE_CHECKING, Any

import pytest

from seod.estimate import TABLE
from seod.observe.estimation import Axis as GatewayAxis
from seod.processes.ring import AxisState
from tests.unit.loop_bench import PERIOD, RIG, Bench, merge

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PLANTS = {
    "pitch": {"K_L": 0.2, "omega_n": 145.0, "zeta": 0.45, "noise": 2e-6},
    "roll": {"K_L": 0.9, "omega_n": 117.0, "zeta": 0.21, "noise": 2e-5},
    "rudder": {"K_L": 0.3, "omega_n": 80.0, "zeta": 0.3, "noise": 1e-5},
    "stabilator": {"K_L": 0.2, "omega_n": 95.0, "zeta": 0.35, "noise": 1e-5},
}
MOVEMENT = {"pitch": 3e-4, "roll": 1e-3, "rudder": 5e-4, "stabilator": 5e-4}


def rig(*names: str) -> dict[str, Any]:
    """The bench's rig with these axes instead of its motor."""
    motor = RIG["axes"]["motor"]

    def axis(name: str) -> dict[str, Any]:
        own = {"sensor": name, "output": name, "K_L": PLANTS[name]["K_L"]}
        return merge(motor, {**own, "polarity": {"movement": MOVEMENT[name]}})

    return RIG | {
        "sensors": {name: {"channel": f"{name}.angle", "unit": "rad"} for name in names},
        "outputs": {name: {"channel": f"{name}.valve"} for name in names},
        "axes": {name: axis(name) for name in names},
        "simulation": {
            "plants": {
                name: PLANTS[name] | {"input": f"{name}.valve", "output": f"{name}.angle"} for name in names
            },
            "constants": {"estop": 1.0},
        },
    }


SEAT = ("pitch", "roll")


class Axes(Bench):
    """A bench whose axes have names."""

    def index(self, name: str) -> int:
        return [axis.name for axis in self.loop.axes].index(name)

    def states(self) -> dict[str, str]:
        return {axis.name: axis.course.state.name.lower() for axis in self.loop.axes}

    def voltage(self, name: str) -> float:
        assert self.driver.rig is not None
        return self.driver.rig.actuators[name].voltage

    def history(self, name: str) -> list[tuple[str, str]]:
        return [(e["state"], e["why"]) for e in self.take("state") if e["axis"] == name]

    def break_sensor(self, name: str, value: float) -> None:
        read, at = self.driver.read, self.index(name)

        def broken(t: float) -> Any:
            samples = read(t)
            samples[at] = samples[at]._replace(value=value)
            return samples

        self.driver.read = broken  # type: ignore[method-assign] # a sensor that lies

    def whole_rows(self) -> list[dict[str, dict[str, float]]]:
        """Rows by axis name."""
        names = [axis.name for axis in self.loop.axes]
        return [dict(zip(names, axes, strict=True)) for _, _, axes in self.axis_rows()]


@pytest.fixture
def bench() -> Iterator[Callable[..., Axes]]:
    made: list[Axes] = []

    def make(names: tuple[str, ...] = SEAT, changes: dict[str, Any] | None = None) -> Axes:
        made.append(Axes(changes, rig(*names)))
        made[-1].run(0.05)
        return made[-1]

    yield make
    for each in made:
        each.close()


def policy(name: str) -> dict[str, Any]:
    return {"guard": {"fault_policy": name}}


def in_turn(turn: float = 0.5) -> dict[str, Any]:
    return {"excitation": {"order": "in_turn", "turn": turn}}


def test_all_axes_are_excited_together(bench: Callable[..., Axes]) -> None:
    seat = bench()
    assert seat.call("start") is None
    seat.run(1.0)
    assert seat.states() == {"pitch": "exciting", "roll": "exciting"}
    assert seat.call("stop", seat.index("pitch")) is None
    seat.run(1.5)
    assert seat.states() == {"pitch": "idle", "roll": "exciting"}
    assert seat.voltage("pitch") == 0.0
    assert abs(seat.voltage("roll")) == 0.5


def test_an_axis_fault_stops_the_whole_rig_by_default(bench: Callable[..., Axes]) -> None:
    seat = bench()
    seat.call("start")
    seat.run(1.0)
    seat.break_sensor("roll", 3.0)
    seat.run(PERIOD)
    assert seat.states() == {"pitch": "fault", "roll": "fault"}
    assert seat.voltage("pitch") == seat.voltage("roll") == 0.0
    (fault,) = seat.take("fault")
    assert (fault["axis"], fault["latched"], fault["code"]) == ("roll", ["pitch", "roll"], "travel")


def test_under_the_axis_policy_the_others_go_on(bench: Callable[..., Axes]) -> None:
    rig4 = bench(tuple(PLANTS), policy("axis"))
    rig4.call("start")
    rig4.run(1.0)
    rig4.rows()
    rig4.break_sensor("rudder", 3.0)
    rig4.run(PERIOD)
    assert rig4.voltage("rudder") == 0.0  # in the tick that saw it
    rig4.run(0.5)
    others = {name: "exciting" for name in PLANTS if name != "rudder"}
    assert rig4.states() == {**others, "rudder": "fault"}
    assert all(abs(rig4.voltage(name)) == 0.5 for name in others)
    (fault,) = rig4.take("fault")
    assert (fault["axis"], fault["latched"]) == ("rudder", ["rudder"])
    rows = rig4.whole_rows()
    assert {row["rudder"]["u"] for row in rows[1:]} == {0.0}
    assert all({row[name]["u"] for row in rows} == {0.5, -0.5} for name in others)


def test_each_axis_is_reset_and_started_by_itself(bench: Callable[..., Axes]) -> None:
    seat = bench(changes=policy("axis"))
    seat.call("start")
    seat.run(1.0)
    read = seat.driver.read
    seat.break_sensor("pitch", 3.0)
    seat.run(0.1)
    seat.driver.read = read  # type: ignore[method-assign] # the sensor is whole again
    assert seat.call("start", seat.index("pitch")) == "pitch is in fault: reset first"
    assert seat.call("reset", seat.index("roll")) is None
    assert seat.states() == {"pitch": "fault", "roll": "exciting"}
    assert seat.call("reset", seat.index("pitch")) is None
    assert seat.call("start", seat.index("pitch")) is None
    seat.run(1.0)
    assert seat.states() == {"pitch": "exciting", "roll": "exciting"}


def test_wrong_polarity_of_one_axis_is_its_own_affair(bench: Callable[..., Axes]) -> None:
    null = {"axes": {"pitch": {"relay": {"bias": 0.1}}}}
    seat = bench(changes={**policy("axis"), **null, "outputs": {"pitch": {"scale": -1.0}}})
    seat.call("start")
    while not seat.faults():
        seat.run(PERIOD)
    assert seat.voltage("pitch") == 0.0  # without the bias too, and in that tick
    seat.run(1.5)
    assert seat.states() == {"pitch": "fault", "roll": "exciting"}
    assert seat.faults() == ["polarity"]


@pytest.mark.parametrize("code", ["estop", "link", "hang", "exception"])
def test_what_concerns_the_rig_stops_all_axes_under_either_policy(
    bench: Callable[..., Axes], code: str
) -> None:
    seat = bench(changes=policy("axis"))
    seat.call("start")
    seat.run(1.0)
    if code == "estop":
        seat.call("estop")
    elif code == "link":
        seat.driver.trouble = "interface vcan0 is down"
    elif code == "hang":
        seat.pacer.lateness = 0.2
    else:
        seat.loop.axes[0].course.controller.step = lambda t, e: 1 / 0  # type: ignore[method-assign] # a bug
        with pytest.raises(ZeroDivisionError):
            seat.loop.run()
    if code != "exception":
        seat.run(PERIOD)
    assert seat.states() == {"pitch": "fault", "roll": "fault"}
    (fault,) = seat.take("fault")
    assert (fault["axis"], fault["code"], fault["latched"]) == (None, code, list(SEAT))


def test_an_estop_after_an_axis_fault_is_told_for_those_that_still_moved(bench: Callable[..., Axes]) -> None:
    seat = bench(changes=policy("axis"))
    seat.call("start")
    seat.run(1.0)
    seat.break_sensor("roll", 3.0)
    seat.run(0.1)
    seat.call("estop")
    assert [(e["code"], e["latched"]) for e in seat.take("fault")] == [
        ("travel", ["roll"]),
        ("estop", ["pitch"]),
    ]


@pytest.mark.slow
def test_axes_take_turns_until_stopped(bench: Callable[..., Axes]) -> None:
    seat = bench(changes=in_turn())
    assert seat.call("start") is None
    excited: list[str] = []
    for _ in range(800):
        seat.run(0.005)
        now = [name for name, state in seat.states().items() if state == "exciting"]
        assert len(now) <= 1
        assert not seat.faults()
        if now and excited[-1:] != now:
            excited += now
    assert len(excited) >= 4
    assert excited == (["pitch", "roll"] * len(excited))[: len(excited)]
    assert seat.history("roll")[:4] == [
        ("armed", "start"),
        ("holding", "waiting for its turn"),
        ("exciting", "relay on"),
        ("holding", "its turn is over"),
    ]
    assert seat.call("stop") is None
    seat.run(3.5)
    assert seat.states() == {"pitch": "idle", "roll": "idle"}


def test_a_turn_lasts_as_long_as_it_should_and_its_neighbour_holds(bench: Callable[..., Axes]) -> None:
    seat = bench(changes=in_turn(1.5))  # longer than the pause between bursts
    seat.call("start")
    seat.run(3.0)
    events = [e for e in seat.take("state") if e["axis"] == "pitch"]
    on = next(e["t"] for e in events if e["state"] == "exciting")
    off = next(e["t"] for e in events if e["why"] == "its turn is over")
    assert off - on == pytest.approx(1.5, abs=2 * PERIOD)
    ticks = [r for r in seat.whole_rows() if on <= r["pitch"]["t"] <= off]
    assert {r["roll"]["state"] for r in ticks[1:]} == {AxisState.HOLDING}
    assert max(abs(r["roll"]["u"]) for r in ticks) < 0.1  # it stands, and is kept there
    assert {r["roll"]["e_a"] for r in ticks} == {0.0}


def test_a_fault_leaves_the_round_to_the_others(bench: Callable[..., Axes]) -> None:
    rig4 = bench(tuple(PLANTS), merge(policy("axis"), in_turn(0.2)))
    rig4.call("start")
    rig4.run(0.3)
    assert rig4.states()["pitch"] == "exciting"
    rig4.break_sensor("pitch", 3.0)
    rig4.run(PERIOD)
    assert rig4.states()["roll"] == "exciting"  # at once: nobody comes back any more
    rig4.call("stop", rig4.index("rudder"))
    rig4.run(4.0)
    turns = [e["axis"] for e in rig4.take("state") if e["state"] == "exciting"]
    assert turns[:5] == ["pitch", "roll", "stabilator", "roll", "stabilator"]


def test_one_that_has_left_the_round_and_is_started_by_name_goes_on_beside_it(
    bench: Callable[..., Axes],
) -> None:
    rig4 = bench(("pitch", "roll", "rudder"), in_turn(0.5))
    rig4.call("start")
    rig4.run(0.3)
    rig4.call("stop", rig4.index("rudder"))
    rig4.run(0.1)
    assert rig4.states() == {"pitch": "exciting", "roll": "holding", "rudder": "idle"}
    rig4.call("start", rig4.index("rudder"))
    rig4.run(3.0)
    assert rig4.states()["rudder"] == "exciting"
    assert [why for _, why in rig4.history("rudder")].count("its turn is over") == 0


def test_a_named_axis_starts_at_once_whatever_the_order(bench: Callable[..., Axes]) -> None:
    seat = bench(changes=in_turn())
    seat.call("start", seat.index("pitch"))
    seat.call("start", seat.index("roll"))
    seat.run(1.0)
    assert seat.states() == {"pitch": "exciting", "roll": "exciting"}


def test_no_axis_starts_if_one_cannot(bench: Callable[..., Axes]) -> None:
    seat = bench(changes=in_turn())
    seat.break_sensor("roll", 3.0)
    error = seat.call("start")
    assert error is not None
    assert error.startswith("roll: position 3")
    seat.run(4.0)
    assert seat.states() == {"pitch": "idle", "roll": "idle"}


@pytest.mark.slow
@pytest.mark.parametrize("order", ["together", "in_turn"])
def test_estimates_of_both_axes_are_true_at_once(bench: Callable[..., Axes], order: str) -> None:
    seat = bench(changes={"excitation": {"order": order, "turn": 1.0}})
    seat.call("start")
    seat.run(3.5)
    rows = seat.axis_rows()
    for index, axis in enumerate(seat.loop.axes):
        gateway = GatewayAxis(axis.name, axis.config, PERIOD, lambda s: TABLE[s.method](s))
        fed: Any = [tuple(axes[index].values()) for _, _, axes in rows]
        answers = [e for e in gateway.feed(fed) if e.quality == "ok"]
        assert len(answers) > 20
        for name in ("omega_n", "zeta"):
            found = median(getattr(e, name) for e in answers)
            assert found == pytest.approx(PLANTS[axis.name][name], rel=0.02), (axis.name, name)


def test_each_axis_has_the_time_its_own_command_left(bench: Callable[..., Axes]) -> None:
    """Two command frames leave one after the other; the second one's echo may come too late for the row."""
    rig = bench()
    later = iter([2e-4, math.nan] * 100)
    rig.driver.left = lambda: [t + dt for t in rig.loop.log.values[:1] for dt in (1e-4, next(later))]  # type: ignore[method-assign] # echoes
    rig.run(0.05)
    rig.axis_rows()
    rig.run(0.05)
    seen = [[axis["t_u"] - t for axis in axes] for _, t, axes in rig.axis_rows()]
    assert [first for first, _ in seen] == pytest.approx([1e-4] * 100, abs=1e-9)
    assert sorted(second for _, second in seen) == pytest.approx([0.0] * 50 + [2e-4] * 50, abs=1e-9)
