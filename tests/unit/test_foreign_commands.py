"""What the loop and the gateway make of commands that somebody else sends to our actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from seod.processes.ring import AxisState
from tests.unit.loop_bench import Bench
from tests.unit.whole_rig import WholeRig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TOLD = "another program on this computer sends our command Valve (id 0x201): voltage 5 V"
WARN = {"guard": {"foreign_command": "warn"}}


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(changes: dict[str, Any] | None = None) -> Bench:
        made.append(Bench(changes))
        made[-1].driver.tell_foreign = lambda: TOLD  # type: ignore[method-assign]
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.parametrize("state", ["idle", "exciting"])
def test_a_foreign_command_is_a_fault_in_the_next_tick(bench: Callable[..., Bench], state: str) -> None:
    rig = bench()
    if state == "exciting":
        rig.call("start")
    rig.run(1.0)
    rig.driver.foreign_commands += 3
    rig.run(rig.pacer.period)
    assert rig.state is AxisState.FAULT
    assert rig.volts == 0.0
    (fault,) = rig.take("fault")
    assert (fault["code"], fault["why"], fault["numbers"]) == ("foreign_command", TOLD, {"commands": 3.0})
    assert rig.call("reset") is None
    assert rig.call("start") is None
    rig.run(1.0)
    assert rig.state is AxisState.EXCITING, "there were no more of them"


def test_the_rig_file_may_have_a_warning_instead(bench: Callable[..., Bench]) -> None:
    rig = bench(WARN)
    rig.call("start")
    rig.run(1.0)
    for _ in range(100):
        rig.driver.foreign_commands += 1
        rig.run(0.01)
    assert rig.state is AxisState.EXCITING
    assert [(w["code"], w["why"]) for w in rig.take("warning")] == [("foreign_command", TOLD)], "told once"


@pytest.mark.slow
def test_estimates_under_somebody_elses_commands_are_of_quality_fault() -> None:
    rig = Bench(WARN)
    whole = WholeRig(rig)
    try:
        rig.call("start")
        whole.run(3.0)
        estimates = whole.hub.messages["estimate"]
        assert estimates[-1]["quality"] == "ok"
        estimates.clear()
        for _ in range(200):
            rig.driver.foreign_commands += 1
            whole.run(0.01)
        told = estimates[len(estimates) // 10 :]
        assert told
        assert {each["quality"] for each in told} == {"fault"}
        assert "foreign_command" in told[-1]["advice"]
        whole.run(5.0)
        assert estimates[-1]["quality"] == "ok"
        assert estimates[-1]["zeta"] == pytest.approx(0.21, rel=0.02)
    finally:
        whole.close()
