"""The whole daemon under simulated faults; and that the simulation would see what it should."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from cobs import cobs

import seod.supervisor.process
from drivers.neutral import SerialNeutral, SocketcanNeutral
from drivers.serial_frame import encode
from drivers.serial_inputs import SerialInputs
from seod.loop.guard import AxisGuard
from seod.loop.tick import Loop
from tests.dst.checks import Checks
from tests.dst.clients import Operator
from tests.dst.exchange import System
from tests.dst.faults import Fault
from tests.dst.line import Stream, frame, stuffed, unstuffed
from tests.dst.rig import Plant
from tests.dst.run import faults_of, rig_config, run
from tests.dst.shrink import shrunk
from tests.dst.world import World

if TYPE_CHECKING:
    from collections.abc import Callable

REPO = Path(__file__).parents[2]
SECONDS = 10.0
SEEDS = 4
"""A test; `make dst SEEDS=1000` runs more."""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.mark.parametrize(
    ("wire", "first"),
    [
        *(("can", first) for first in range(100_001, 100_025, SEEDS)),
        *(("serial", first) for first in range(100_001, 100_005, SEEDS)),
    ],
)
def test_nothing_unguarded_leaves_whatever_happens(wire: str, first: int) -> None:
    for seed in range(first, first + SEEDS):
        outcome = run(seed, SECONDS, wire=wire)
        assert not outcome.failures, f"make dst SEEDS=1 FIRST={seed} WIRE={wire}: {outcome.failures}"
        assert outcome.commands > 500


def test_a_seed_is_the_same_run_in_each_process() -> None:
    here = run(7, 3.0)
    code = "from tests.dst.run import run; print(run(7, 3.0).digest)"
    there = subprocess.run(
        [sys.executable, "-c", code],
        cwd=REPO,
        env=os.environ | {"PYTHONHASHSEED": "12345"},
        check=True,
        capture_output=True,
        text=True,
    )
    assert there.stdout.split() == [here.digest]
    assert run(8, 3.0).digest != here.digest


def test_a_seed_is_the_same_run_wherever_its_objects_lie() -> None:
    """Found by seed 200011: a gateway ended its requests in the order of their addresses."""
    faults = [fault for fault in faults_of(200011, 60.0, "can") if fault.t < 12.7]
    kept, digests = [], set()
    for k in range(6):
        kept.append([object() for _ in range(1000 * k)])
        digests.add(run(200011, 12.0, faults).digest)
    assert len(digests) == 1


def _beyond_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AxisGuard, "pass_command", lambda *_: 9.0)


def _no_neutral_by_the_supervisor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SocketcanNeutral, "write", lambda *_: "")


def _no_neutral_to_the_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SerialNeutral, "write", lambda *_: "")


def _no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Loop, "estop", lambda *_: None)
    monkeypatch.setattr(AxisGuard, "inspect", lambda *_: None)


def _faults_that_leave_by_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    tick = Loop.tick

    def forgetful(loop: Loop, t: float) -> None:
        for axis in loop.axes:
            axis.course.reset(t)
        tick(loop, t)

    monkeypatch.setattr(Loop, "tick", forgetful)


def _a_supervisor_that_does_not_look(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seod.supervisor.process.Supervisor, "watch_ticks", lambda _: None)


STARTED = Fault(3.9, "client_gone", {"who": "watcher"})


@pytest.mark.parametrize(
    ("break_it", "fault", "said"),
    [
        (_beyond_limits, STARTED, "limits.output"),
        (
            _no_neutral_by_the_supervisor,
            Fault(5.0, "kill", {"who": "loop", "points": 0}),
            "after the loop died",
        ),
        (_no_verdict, Fault(5.0, "silent", {"for": 0.5}), "samples stopped coming"),
        (_no_verdict, Fault(5.0, "estop_line", {"for": 0.5}), "e-stop line"),
        (_faults_that_leave_by_themselves, Fault(5.0, "silent", {"for": 0.2}), "reset"),
        (
            _a_supervisor_that_does_not_look,
            Fault(5.0, "stop", {"who": "loop", "for": 3.0, "points": 0}),
            "after the loop stood still",
        ),
    ],
)
def test_each_invariant_can_fail(
    break_it: Callable[[pytest.MonkeyPatch], None], fault: Fault, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not run(1, 4.0, [fault]).failures
    break_it(monkeypatch)
    outcome = run(1, 4.0, [fault])
    assert said in " ".join(outcome.failures)


def _a_driver_that_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SerialInputs, "_count", lambda *_: None)


KILLED = Fault(5.0, "kill", {"who": "loop", "points": 0})


@pytest.mark.parametrize(
    ("break_it", "fault", "said"),
    [
        (_beyond_limits, STARTED, "limits.output"),
        (_no_neutral_to_the_port, KILLED, "after the loop died"),
        (_no_verdict, Fault(5.0, "estop_line", {"for": 0.5}), "e-stop line"),
        (_a_driver_that_does_not_count, KILLED, "samples were read"),
    ],
)
def test_each_invariant_can_fail_on_a_serial_line(
    break_it: Callable[[pytest.MonkeyPatch], None], fault: Fault, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not run(1, 4.0, [fault], wire="serial").failures
    break_it(monkeypatch)
    outcome = run(1, 4.0, [fault], wire="serial")
    assert said in " ".join(outcome.failures)


def test_the_simulated_board_frames_as_the_driver_does() -> None:
    for content in (b"\x02\x07" + bytes(9), bytes(range(1, 200)), b"\0", b"\0\0a\0"):
        assert stuffed(content) == cobs.encode(content) + b"\0"
        assert unstuffed(stuffed(content)[:-1]) == content
    assert frame(0x83, 257, b"\0\1") == encode(0x83, 1, b"\0\1")
    stream, sound = Stream(), frame(0x83, 1, b"ab")
    damaged = bytes([sound[0], sound[1] ^ 1]) + sound[2:]
    assert stream.feed(damaged + sound[:4]) == []
    assert stream.feed(sound[4:]) == [(0x83, 1, b"ab")]


def test_a_gateway_that_starts_after_the_loop_died_knows_of_it(capfd: pytest.CaptureFixture[str]) -> None:
    """Found by seed 1019: else a reset waited for a loop that was not there, for good."""
    kill = {"points": 0}
    faults = [Fault(5.0, "kill", {"who": "loop", **kill}), Fault(5.0001, "kill", {"who": "gateway", **kill})]
    assert not run(1, 4.0, faults).failures
    assert "loop process killed by signal 9 (SIGKILL); neutral written" in capfd.readouterr().err


def test_an_interface_that_goes_while_it_is_off_the_bus_is_taken_again() -> None:
    """Found by seed 3004: nobody told the new socket that the controller was on the bus."""
    faults = [Fault(5.0, "bus_off", {"for": 0.3}), Fault(5.2, "gone", {"for": 0.3})]
    assert not run(1, 4.0, faults).failures


def test_a_fenced_loop_is_killed_before_neutral_is_written() -> None:
    """Found by seed 20087: stopped before a send, its supervisor dead by then, it sent what it had held."""
    supervisor = Fault(11.7673, "kill", {"who": "supervisor", "points": 2})
    for k in range(3):
        stop = Fault(11.8587 + 0.0005 * k, "stop", {"who": "loop", "for": 0.84, "points": 5})
        assert not run(20087, 15.0, [supervisor, stop]).failures


def test_a_client_that_leaves_in_the_turn_of_its_request_leaves_no_error_behind() -> None:
    """Found by seed 190005: the journal told of an exception that nobody had fetched."""
    faults = [
        Fault(4.9878, "stop", {"who": "gateway", "for": 0.98195, "points": 2}),
        Fault(5.4713, "kill", {"who": "loop", "points": 10}),
        Fault(6.1032, "client_gone", {"who": "operator"}),
    ]
    assert not run(190005, 5.0, faults).failures


@pytest.mark.parametrize(("seed", "left"), [(1, 5.9), (2, 5.26)])
def test_a_client_that_leaves_while_a_new_loop_fails_leaves_no_error_behind(seed: int, left: float) -> None:
    """Found by seed 300047: nobody fetched why the new loop had failed."""
    faults = [
        Fault(5.0, "gone", {"for": 2.0}),
        Fault(5.001, "kill", {"who": "loop", "points": 0}),
        Fault(left, "client_gone", {"who": "operator"}),
    ]
    assert not run(seed, 5.0, faults).failures


def test_a_late_frame_does_not_open_the_estop_line_again() -> None:
    """Found by seed 300010: the checks took the e-stop in a frame that came behind a newer one for news."""
    world = World(1)
    checks = Checks(world, System(world), rig_config("can", 200))
    for counter, run_enable in ((1, True), (2, True), (4, True), (3, False), (4, False), (60, False)):
        checks.sensed(run_enable, True, counter)
    assert checks.estop_open_at == -math.inf
    checks.sensed(False, True, 5)
    assert checks.estop_open_at == world.now


def test_a_sensor_that_shows_another_axis_from_the_start_lets_none_excite(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[tuple[float, str, str]] = []
    answered = Operator._answered

    def notes(operator: Operator, method: str, result: Any) -> None:
        answered(operator, method, result)
        if method == "get" and result:
            seen.append((operator.world.now, result["state"], (result["fault"] or {}).get("code", "")))

    monkeypatch.setattr(Operator, "_answered", notes)
    for seed in range(1, 4):
        seen.clear()
        swapped = Fault(0.01, "exchanged", {"value": "still", "for": 60.0})
        assert not run(seed, 8.0, [swapped], wire="serial").failures
        begun = seen[0][0]
        while_swapped = [(state, code) for t, state, code in seen if t < begun + 8.0]
        assert ("fault", "polarity") in while_swapped
        assert not {state for state, _ in while_swapped} & {"exciting", "holding"}


def test_a_failing_run_is_shrunk_to_its_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    _no_neutral_by_the_supervisor(monkeypatch)
    cause = Fault(5.0, "kill", {"who": "loop", "points": 0})
    others = [Fault(4.0 + 0.1 * k, "clock", {"by": 1.0}) for k in range(7)]
    outcome = run(1, 4.0, [*others[:4], cause, *others[4:]])
    assert outcome.failures
    assert shrunk(outcome, 4.0).faults == (cause,)


def test_the_simulated_rig_is_equation_1() -> None:
    plant, dt = Plant(0.0), 1e-5
    plant.u = 0.3
    speed = slope = position = 0.0
    for _ in range(50_000):  # half a second of small steps, another way
        slope += dt * (400.0 * (17.0 * 0.3 - speed) - 2.0 * 0.3 * 20.0 * slope)
        speed += dt * slope
        position += dt * speed
    for k in range(1, 11):
        plant.advance(0.05 * k)
    assert plant.speed == pytest.approx(speed, rel=1e-3)
    assert plant.position == pytest.approx(position, rel=1e-3)
