"""What the supervisor begins with, starts, hears and announces."""

from __future__ import annotations

import math
import os
import select
from typing import TYPE_CHECKING, Any

import pytest

from drivers.neutral import NoNeutral
from seod.processes import journal
from seod.processes.ring import Word

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.unit.supervisor_bench import Bench


# Before anything has started


def test_a_supervisor_begins_with_nothing(bench: Bench) -> None:
    supervisor = bench.supervisor
    assert supervisor.arguments is bench.arguments
    assert (supervisor.shared.axes, supervisor.shared.rows) == (2, 64)
    assert (supervisor.loop, supervisor.gateway, supervisor.way, supervisor.keepers) == (None, None, None, [])
    assert (supervisor.generation, supervisor.gateway_starts) == (0, 0)
    assert isinstance(supervisor.neutral, NoNeutral)
    assert supervisor.write_neutral() == "neutral not written: the loop never opened the rig"
    assert (supervisor.holding_neutral, supervisor.fenced, supervisor.death) == (False, "", {})
    assert (supervisor.ticks_seen, supervisor.still, supervisor.gateway_seen) == (-1, 0, -1)
    assert (supervisor.gateway_turned, supervisor.looked, supervisor.fed, supervisor.ticks_fed) == (
        0,
        0,
        0,
        0,
    )
    assert (supervisor.ending, supervisor.announced, supervisor.exit_code) == (False, False, 0)
    assert (supervisor.began, supervisor.ends_at, supervisor.watchdog) == (100.0, math.inf, math.inf)
    assert bench.poller.watched == {supervisor.wake_read: select.POLLIN}
    assert not os.get_blocking(supervisor.wake_read)
    assert not os.get_inheritable(supervisor.wake_read)


@pytest.mark.parametrize(
    ("hang_timeout", "polls", "poll_s"),
    [(0.0, 4, 0.02), (0.05, 4, 0.0125), (0.0801, 5, 0.01602), (0.2, 10, 0.02), (0.25, 13, 0.25 / 13)],
)
def test_a_poll_is_a_part_of_the_hang_timeout_and_at_most_20_ms(
    make: Callable[..., Bench], hang_timeout: float, polls: int, poll_s: float
) -> None:
    supervisor = make(hang_timeout=hang_timeout).supervisor
    assert supervisor.hang_polls == polls
    assert supervisor.poll_s == pytest.approx(poll_s)


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ({"panel": True}, ["panel"]),
        ({"fleet": True}, ["fleet"]),
        ({"panel": True, "fleet": True}, ["panel", "fleet"]),
    ],
)
def test_panel_and_fleet_are_kept_where_they_are_wanted(
    make: Callable[..., Bench], wanted: dict[str, bool], names: list[str]
) -> None:
    bench = make(**wanted)
    supervisor = bench.supervisor
    assert [keeper.name for keeper in supervisor.keepers] == names
    assert supervisor.way is not None
    bench.started()
    assert [child.module for child in bench.children[2:]] == [f"seod.{name}" for name in names]
    own, theirs = supervisor.way.own_end.fileno(), supervisor.way.gateway_end.fileno()
    assert {child.arguments.panel_fd for child in bench.children[2:]} == {own}
    assert bench.gateway.arguments.panel_fd == theirs
    assert bench.loop.arguments.panel_fd == -1


# Children


def test_a_child_is_given_what_it_needs_and_is_watched(bench: Bench) -> None:
    bench.supervisor.start_loop()
    given = bench.loop.arguments
    assert bench.loop.module == "seod.loop"
    assert (given.config_fd, given.shared_fd, given.supervisor_fd) == (71, bench.supervisor.shared.fd, -1)
    assert (given.supervisor_pid, given.axes, given.rows, given.generation) == (os.getpid(), 2, 64, 1)
    assert (given.record, given.config_path, given.panel_fd) == (None, "/etc/seod/press.yaml", -1)
    for fd in (bench.loop.pidfd, bench.loop.link.fileno()):
        assert bench.poller.watched[fd] == select.POLLIN


def test_generations_count_the_loops_and_the_gateway_is_told(bench: Bench) -> None:
    bench.supervisor.start_gateway()
    assert bench.gateway.module == "seod.gateway"
    assert bench.gateway.arguments.panel_fd == -1
    assert bench.gateway.arguments.generation == 0
    for generation in (1, 2):
        bench.supervisor.start_loop()
        assert bench.loop.arguments.generation == generation
        assert bench.gateway.heard() == [{"loop": "starting", "generation": generation}]


def test_a_gateway_that_was_started_again_records_beside_the_first_recording(
    make: Callable[..., Bench],
) -> None:
    bench = make(record="/data/run.v2.mcap")
    names = []
    for _ in range(3):
        bench.supervisor.start_gateway()
        names.append(bench.gateway.arguments.record)
    assert names == ["/data/run.v2.mcap", "/data/run.v2.start2.mcap", "/data/run.v2.start3.mcap"]
    without = make()
    without.supervisor.start_gateway()
    without.supervisor.start_gateway()
    assert without.gateway.arguments.record is None


def test_an_end_of_a_childs_words_is_not_polled_again(running: Bench) -> None:
    """The pidfd tells the rest; else each poll would return at once."""
    for child, hear in (
        (running.loop, running.supervisor.hear_loop),
        (running.gateway, running.supervisor.hear_gateway),
    ):
        link = child.link.fileno()
        hear(child)  # type: ignore[operator]
        assert link in running.poller.watched, "nothing to hear is no end"
        child.hangs_up()
        hear(child)  # type: ignore[operator]
        assert link not in running.poller.watched
        assert child.pidfd in running.poller.watched
        hear(child)  # type: ignore[operator]


# What they say


def test_neutral_is_written_by_the_recipe_of_the_newest_loop(bench: Bench) -> None:
    supervisor = bench.supervisor
    supervisor.start_loop()
    for kind in ("old", "new"):
        bench.loop.says(loop="open", recipe={"kind": kind})
        supervisor.hear_loop(bench.loop)  # type: ignore[arg-type]
    assert bench.rig.recipes == [{"kind": "old"}, {"kind": "new"}]
    assert bench.rig.done == ["open", "close", "open"], "the one before is closed first"
    bench.words[Word.COMMANDS_SENT] = 77
    assert supervisor.write_neutral() == "neutral written"
    bench.rig.why = "can0 is gone"
    assert supervisor.write_neutral() == "neutral not written: can0 is gone"
    assert bench.rig.done[3:] == [77, 77]


def test_a_loop_that_is_ready_has_the_rig_and_what_it_lacks_is_told(bench: Bench) -> None:
    supervisor = bench.supervisor
    supervisor.start_loop()
    supervisor.holding_neutral, supervisor.ticks_seen, supervisor.still = True, 5, 3
    bench.loop.says(loop="ready", warnings=["no SCHED_FIFO", "no locked memory"])
    supervisor.hear_loop(bench.loop)  # type: ignore[arg-type]
    assert bench.loop.ready
    assert (supervisor.holding_neutral, supervisor.ticks_seen, supervisor.still) == (False, -1, 0)
    fields = {"RIG": "press", "CODE": "not_realtime"}
    assert bench.told == [
        ("seod: warning: not real-time: no SCHED_FIFO", journal.WARNING, fields),
        ("seod: warning: not real-time: no locked memory", journal.WARNING, fields),
    ]


@pytest.mark.parametrize("message", [{"loop": "other"}, {"loop": "ready", "warnings": "none"}])
def test_a_loop_that_says_something_else_is_no_trouble(bench: Bench, message: dict[str, Any]) -> None:
    bench.supervisor.start_loop()
    bench.loop.says(**message)
    bench.supervisor.hear_loop(bench.loop)  # type: ignore[arg-type]
    assert bench.told == []
    assert bench.loop.failure == ""


def test_a_gateway_that_listens_is_told_of(bench: Bench) -> None:
    bench.supervisor.start_gateway()
    bench.gateway.says(gateway="ready", port=4711)
    bench.supervisor.hear_gateway(bench.gateway)  # type: ignore[arg-type]
    assert bench.gateway.ready is True
    assert bench.told == [("seod: press: JSON-RPC on port 4711", journal.INFO, {"RIG": "press", "CODE": ""})]


def test_a_gateway_that_cannot_work_is_no_longer_ready(running: Bench) -> None:
    running.gateway.says(gateway="failed", why="the port is taken")
    running.supervisor.hear_gateway(running.gateway)  # type: ignore[arg-type]
    assert running.gateway.failure == "the port is taken"
    assert running.gateway.ready is False


def test_a_client_restarts_a_loop_that_is_dead_and_no_other(running: Bench) -> None:
    supervisor = running.supervisor
    first = running.loop
    running.gateway.says(op="restart_loop")
    supervisor.hear_gateway(running.gateway)  # type: ignore[arg-type]
    assert running.loop is first
    supervisor.loop_died(first)  # type: ignore[arg-type]
    running.gateway.says(op="something")
    supervisor.hear_gateway(running.gateway)  # type: ignore[arg-type]
    assert supervisor.loop is None
    running.gateway.says(op="restart_loop")
    supervisor.hear_gateway(running.gateway)  # type: ignore[arg-type]
    assert running.loop is not first
    assert running.loop.arguments.generation == 2
    assert supervisor.death == {}


# Ready


def test_the_daemon_is_announced_once_all_is_ready_and_a_tick_is_done(make: Callable[..., Bench]) -> None:
    bench = make(duration=30.0, panel=True)
    supervisor = bench.supervisor

    def silent() -> bool:
        supervisor.announce()
        return not bench.notified and not supervisor.announced and supervisor.keepers[0].child is None

    bench.words[Word.TICKS] = 1
    assert silent()
    supervisor.start_loop()
    assert silent()
    bench.loop.ready = True
    assert silent()
    supervisor.start_gateway()
    assert silent()
    bench.gateway.ready, bench.loop.ready = True, False
    assert silent()
    bench.loop.ready = True
    bench.words[Word.TICKS] = 0
    assert silent(), "no tick yet"
    bench.words[Word.TICKS] = 1
    supervisor.announce()
    assert supervisor.announced
    assert bench.notified == ["READY=1\nSTATUS=press: running"]
    assert supervisor.ends_at == 130.0
    assert len(bench.children) == 3
    supervisor.announce()
    assert len(bench.notified) == 1
    assert len(bench.children) == 3


def test_without_a_duration_it_runs_until_it_is_ended(running: Bench) -> None:
    assert running.supervisor.ends_at == math.inf
