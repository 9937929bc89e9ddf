"""The supervisor step by step: whom it watches, when it writes neutral, restarts, gives up; what it tells."""

from __future__ import annotations

import json
import math
import os
import select
import signal
import sys
from typing import TYPE_CHECKING, Any

import pytest

from drivers.neutral import NoNeutral
from seod.processes import journal
from seod.processes.ring import Word
from seod.supervisor import process as supervising
from seod.supervisor.arguments import SupervisorArguments, become
from tests.unit.supervisor_bench import Bench, FakeChild

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def one(**changes: Any) -> Bench:
        made.append(Bench(monkeypatch, **changes))
        return made[-1]

    yield one
    for bench in made:
        bench.close()


@pytest.fixture
def bench(make: Callable[..., Bench]) -> Bench:
    return make()


@pytest.fixture
def running(bench: Bench) -> Bench:
    return bench.started()


def silence(bench: Bench) -> None:
    """The loop does not tick until it is fenced."""
    for _ in range(bench.supervisor.hang_polls + 1):
        bench.supervisor.watch_ticks()


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


# A loop that hangs


def test_a_loop_that_does_not_tick_is_fenced_and_killed(running: Bench) -> None:
    supervisor, words = running.supervisor, running.words
    words[Word.COMMANDS_SENT] = 9
    supervisor.watch_ticks()
    for _ in range(3):
        supervisor.watch_ticks()
    assert supervisor.still == 3
    assert running.loop.done == []
    assert running.rig.done == []
    supervisor.watch_ticks()
    assert running.loop.done == ["SIGKILL"]
    assert running.loop.failure == "hung: no tick for 62 ms, so it was fenced and killed"
    assert running.rig.done == [9]
    assert words[Word.FENCE] == 1
    assert supervisor.fenced == "neutral written"
    assert running.loop.ready is False
    assert supervisor.still == 0
    for _ in range(10):
        supervisor.watch_ticks()
    assert running.loop.done == ["SIGKILL"], "once is enough"


def test_each_tick_is_a_proof_of_life(running: Bench) -> None:
    for tick in range(2, 12):
        running.words[Word.TICKS] = tick
        for _ in range(4):
            running.supervisor.watch_ticks()
    assert running.loop.done == []
    assert running.supervisor.ticks_seen == 11


def test_a_loop_that_is_not_ready_or_on_simulated_time_may_stand_still(make: Callable[..., Bench]) -> None:
    simulated = make(hang_timeout=0.0).started()
    silence(simulated)
    assert simulated.loop.done == []
    starting = make()
    starting.supervisor.watch_ticks()
    starting.supervisor.start_loop()
    silence(starting)
    assert starting.loop.done == []


def test_a_hang_is_what_is_told_of_the_death_that_follows(
    running: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neutral was written as it was fenced: that the queue is full of it now is no trouble."""
    supervisor = running.supervisor
    silence(running)
    running.rig.why = "no room"
    loop = running.loop
    monkeypatch.setattr(loop, "end_of", lambda: "killed by signal 9 (SIGKILL)")
    supervisor.loop_died(loop)  # type: ignore[arg-type]
    why = "the loop process hung: no tick for 62 ms, so it was fenced and killed"
    assert running.told[0][0] == f"seod: {why}; neutral written"
    assert supervisor.death["why"] == why
    assert supervisor.fenced == ""


def test_neutral_that_could_not_be_written_as_it_was_fenced_may_be_written_later(running: Bench) -> None:
    running.rig.why = "no room"
    silence(running)
    assert running.supervisor.fenced == "neutral not written: no room"
    running.supervisor.loop_died(running.loop)  # type: ignore[arg-type]
    assert running.supervisor.death["neutral"] == "neutral not written: no room"


# A loop that died


def test_a_loop_that_died_is_followed_by_neutral_until_another_is_ready(running: Bench) -> None:
    supervisor = running.supervisor
    loop = running.loop
    running.words[Word.COMMANDS_SENT] = 5
    watched = (loop.pidfd, loop.link.fileno())
    running.now = 123.0
    supervisor.loop_died(loop)  # type: ignore[arg-type]
    assert running.words[Word.FENCE] == 1
    assert running.rig.done == [5]
    assert supervisor.loop is None
    assert loop.done == ["closed"]
    assert not set(watched) & set(running.poller.watched)
    why = "the loop process ended with exit code 1"
    fields = {"RIG": "press", "CODE": "loop_died"}
    assert running.told == [(f"seod: {why}; neutral written", journal.ERROR, fields)]
    assert running.notified == [f"STATUS=press: fault: {why}"]
    death = {"loop": "died", "t": 123.0, "generation": 1, "why": why, "neutral": "neutral written"}
    assert supervisor.death == death
    assert running.gateway.heard() == [death]
    assert (supervisor.ending, supervisor.exit_code) == (False, 0)
    supervisor.watch_ticks()
    supervisor.watch_ticks()
    assert running.rig.done == [5, 5, 5]
    supervisor.start_loop()
    supervisor.watch_ticks()
    assert len(running.rig.done) == 4, "until it is ready"
    running.loop.says(loop="ready", warnings=[])
    supervisor.hear_loop(running.loop)  # type: ignore[arg-type]
    supervisor.watch_ticks()
    assert len(running.rig.done) == 4


def test_the_last_words_of_a_loop_tell_why_it_died(running: Bench) -> None:
    running.loop.says(loop="failed", why="the bus is off")
    running.supervisor.loop_died(running.loop)  # type: ignore[arg-type]
    assert running.supervisor.death["why"] == "the loop process the bus is off"


def test_a_loop_that_dies_before_the_daemon_was_ready_ends_it(bench: Bench) -> None:
    bench.supervisor.start_loop()
    bench.supervisor.loop_died(bench.loop)  # type: ignore[arg-type]
    assert (bench.supervisor.ending, bench.supervisor.exit_code) == (True, 1)
    assert bench.told[0][0].endswith("; neutral not written: the loop never opened the rig")


def test_a_loop_that_dies_while_the_daemon_ends_anyway_is_no_failure(bench: Bench) -> None:
    bench.supervisor.start_loop()
    bench.supervisor.ending = True
    bench.supervisor.loop_died(bench.loop)  # type: ignore[arg-type]
    assert bench.supervisor.exit_code == 0


def test_a_gateway_that_starts_after_a_loop_died_knows_of_it(running: Bench) -> None:
    running.supervisor.loop_died(running.loop)  # type: ignore[arg-type]
    running.supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]
    assert running.gateway.heard() == [running.supervisor.death]
    running.supervisor.start_loop()
    running.supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]
    assert running.gateway.heard() == []


# A gateway that hangs or dies


def test_a_gateway_that_does_not_turn_is_killed(running: Bench) -> None:
    supervisor = running.supervisor

    def turn(seconds: float) -> None:
        running.now += seconds
        supervisor.watch_gateway()

    running.words[Word.GATEWAY_BEAT] = 7
    turn(0.0)
    assert (supervisor.gateway_seen, supervisor.gateway_turned, supervisor.looked) == (7, 100.0, 100.0)
    for _ in range(32):
        turn(1 / 32)
    assert running.now == 101.0
    assert running.gateway.done == [], "so long it may be silent"
    turn(1 / 128)
    assert running.gateway.done == ["SIGKILL"]
    assert running.gateway.failure == "hung: no turn for 1000 ms, so it was killed"
    assert running.gateway.ready is False
    for _ in range(64):
        turn(1 / 32)
    assert running.gateway.done == ["SIGKILL"]


def test_each_turn_is_a_proof_of_the_gateways_life(running: Bench) -> None:
    for beat in range(1, 200):
        running.words[Word.GATEWAY_BEAT] = beat // 20
        running.now += 1 / 32
        running.supervisor.watch_gateway()
    assert running.gateway.done == []


def test_a_pause_of_the_machine_is_no_silence_of_the_gateway(running: Bench) -> None:
    """Four polls may pass between two looks; more, and the machine stood still, the gateway with it."""
    supervisor = running.supervisor
    supervisor.watch_gateway()
    for _ in range(20):
        running.now += 0.07
        supervisor.watch_gateway()
        assert supervisor.gateway_turned == running.now
    assert running.gateway.done == []
    running.now += 0.0625
    supervisor.watch_gateway()
    assert supervisor.gateway_turned < running.now


def test_a_gateway_that_is_not_ready_or_not_there_may_be_silent(bench: Bench) -> None:
    for _ in range(2):
        for _ in range(64):
            bench.now += 1 / 32
            bench.supervisor.watch_gateway()
        if bench.supervisor.gateway is None:
            bench.supervisor.start_gateway()
    assert bench.gateway.done == []
    assert bench.supervisor.gateway_turned == bench.now


def test_a_gateway_that_died_stops_the_rig_and_is_started_again(running: Bench) -> None:
    supervisor = running.supervisor
    gateway = running.gateway
    supervisor.gateway_died(gateway)  # type: ignore[arg-type]
    assert running.loop.done == ["SIGUSR1"]
    assert gateway.done == ["waited for", "closed"]
    assert running.gateway is not gateway
    assert supervisor.gateway_starts == 2
    fields = {"RIG": "press", "CODE": "gateway_died"}
    assert running.told == [("seod: the gateway process ended with exit code 1", journal.ERROR, fields)]
    assert not supervisor.ending


def test_the_last_words_of_a_gateway_tell_why_it_died(running: Bench) -> None:
    running.gateway.says(gateway="failed", why="the disk is full")
    running.supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]
    assert running.told[0][0] == "seod: the gateway process the disk is full"


def test_a_loop_that_is_not_ready_is_not_signalled(running: Bench) -> None:
    running.loop.ready = False
    running.supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]
    assert running.loop.done == []
    running.supervisor.loop_died(running.loop)  # type: ignore[arg-type]
    running.supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]


def test_a_gateway_is_started_again_five_times(running: Bench) -> None:
    supervisor = running.supervisor
    for starts in range(2, 7):
        supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]
        assert supervisor.gateway_starts == starts
        assert not supervisor.ending
    supervisor.gateway_died(running.gateway)  # type: ignore[arg-type]
    assert supervisor.gateway is None
    assert (supervisor.ending, supervisor.exit_code) == (True, 1)


def test_a_gateway_that_dies_before_the_daemon_was_ready_ends_it(bench: Bench) -> None:
    bench.supervisor.start_gateway()
    bench.supervisor.gateway_died(bench.gateway)  # type: ignore[arg-type]
    assert bench.supervisor.gateway is None
    assert (bench.supervisor.ending, bench.supervisor.exit_code) == (True, 1)


# Descriptors


def test_each_descriptor_leads_to_whose_it_is(
    make: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make(panel=True, fleet=True).started()
    supervisor = bench.supervisor
    heard: list[tuple[str, object]] = []
    for name in ("loop_died", "gateway_died", "hear_loop", "hear_gateway"):
        monkeypatch.setattr(supervisor, name, lambda child, name=name: heard.append((name, child)))
    loop, gateway = bench.loop, bench.gateway
    for fd in (loop.pidfd, gateway.pidfd, loop.link.fileno(), gateway.link.fileno()):
        supervisor.serve(fd)
    assert heard == [
        ("loop_died", loop),
        ("gateway_died", gateway),
        ("hear_loop", loop),
        ("hear_gateway", gateway),
    ]
    assert not supervisor.ending
    supervisor.serve(12345)  # of a child that was dropped in the same turn
    assert len(heard) == 4
    os.write(supervisor.wake_write, b"x" * 100)
    supervisor.serve(supervisor.wake_read)
    assert supervisor.ending
    assert os.read(supervisor.wake_read, 100) == b"x" * 36


def test_a_descriptor_of_a_child_that_is_gone_is_nobodys(bench: Bench) -> None:
    bench.supervisor.serve(12345)


@pytest.mark.parametrize("number", [0, 1])
def test_panel_and_fleet_are_heard_and_started_again(
    make: Callable[..., Bench], number: int, capfd: pytest.CaptureFixture[str]
) -> None:
    bench = make(panel=True, fleet=True).started()
    supervisor = bench.supervisor
    child, other = bench.children[2 + number], bench.children[3 - number]
    name = child.module.removeprefix("seod.")
    child.says(says=["on port 8080"])
    supervisor.serve(child.link.fileno())
    assert capfd.readouterr().err == "seod: on port 8080\n"
    link = child.link.fileno()
    assert link in bench.poller.watched
    child.hangs_up()
    supervisor.serve(link)
    assert link not in bench.poller.watched
    supervisor.serve(child.pidfd)
    assert child.done == ["closed"]
    assert capfd.readouterr().err == f"seod: the {name} process ended with exit code 1\n"
    assert len(bench.children) == 5
    assert bench.children[4].module == child.module
    assert supervisor.keepers[number].child is bench.children[4]
    assert supervisor.keepers[1 - number].child is other
    assert other.done == []


# systemd's watchdog, the time


def test_the_watchdog_is_fed_as_often_as_it_asks_while_ticks_are_done(running: Bench) -> None:
    supervisor = running.supervisor
    supervisor.watchdog = 0.5
    supervisor.fed = 100.0
    running.now = math.nextafter(100.5, 0.0)
    running.words[Word.TICKS] = 10
    supervisor.feed_watchdog()
    assert running.notified == []
    running.now = 100.5
    supervisor.feed_watchdog()
    assert running.notified == ["WATCHDOG=1"]
    assert (supervisor.fed, supervisor.ticks_fed) == (100.5, 10)
    running.now = 102.0
    supervisor.feed_watchdog()
    assert len(running.notified) == 1, "no tick was done"
    running.loop.ready = False
    supervisor.feed_watchdog()
    assert len(running.notified) == 2
    running.loop.ready = True
    supervisor.loop_died(running.loop)  # type: ignore[arg-type]
    running.now = 104.0
    supervisor.feed_watchdog()
    assert running.notified[-1] == "WATCHDOG=1"


def test_without_a_watchdog_none_is_fed(running: Bench) -> None:
    running.now, running.words[Word.TICKS] = 1e9, 99
    running.supervisor.feed_watchdog()
    assert running.notified == []


def test_it_ends_when_its_time_is_up(make: Callable[..., Bench]) -> None:
    bench = make(duration=8.0).started()
    bench.now = math.nextafter(108.0, 0.0)
    bench.supervisor.watch_times()
    assert not bench.supervisor.ending
    bench.now = 108.0
    bench.supervisor.watch_times()
    assert (bench.supervisor.ending, bench.supervisor.exit_code) == (True, 0)
    assert bench.told == []


def test_a_start_may_take_a_minute_and_no_longer(bench: Bench) -> None:
    bench.now = 160.0
    bench.supervisor.watch_times()
    assert not bench.supervisor.ending
    bench.now = math.nextafter(160.0, 200.0)
    bench.supervisor.watch_times()
    assert (bench.supervisor.ending, bench.supervisor.exit_code) == (True, 1)
    text = "seod: loop and gateway were not ready within 60 s"
    assert bench.told == [(text, journal.ERROR, {"RIG": "press", "CODE": "start"})]


def test_once_it_is_ready_a_minute_is_nothing(running: Bench) -> None:
    running.now = 1e6
    running.supervisor.watch_times()
    assert not running.supervisor.ending


def test_what_is_told_goes_to_the_terminal_where_there_is_no_journal(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.supervisor.say("hello")
    assert bench.told == [("seod: hello", journal.INFO, {"RIG": "press", "CODE": ""})]
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(supervising.journal, "tell", lambda *_, **__: False)
    bench.supervisor.say("hello", journal.ERROR, "start")
    assert capfd.readouterr().err == "seod: hello\n"


# The end


def test_the_end_is_loop_neutral_beside_gateway(
    make: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make(panel=True, fleet=True).started()
    order: list[str] = []

    def ends(child: FakeChild) -> Callable[..., None]:
        def end(meanwhile: Callable[[], None] | None = None) -> None:
            order.append(child.module)
            if meanwhile is not None:
                meanwhile()
            assert child is not bench.loop or not bench.rig.done
            order.extend(str(message) for message in child.heard())

        return end

    for child in bench.children:
        monkeypatch.setattr(child, "end", ends(child))
    supervisor = bench.supervisor
    bench.words[Word.COMMANDS_SENT] = 4
    supervisor.shut_down()
    assert order == ["seod.loop", "seod.panel", "seod.fleet", "seod.gateway", "{'stop': True}"]
    assert bench.rig.done == [4, "close"]
    assert bench.words[Word.FENCE] == 1
    assert bench.notified == ["STOPPING=1", "WATCHDOG=1", "WATCHDOG=1"], "the two that may take long"
    assert supervisor.exit_code == 0
    assert supervisor.way is not None
    assert supervisor.way.own_end.fileno() == supervisor.way.gateway_end.fileno() == -1


@pytest.mark.parametrize(("code", "exit_code"), [(0, 0), (1, 1), (2, 1), (-9, 0)])
def test_a_recording_that_lacks_something_makes_the_end_a_failure(
    running: Bench, code: int, exit_code: int
) -> None:
    running.gateway.process.returncode = code
    running.supervisor.shut_down()
    assert running.supervisor.exit_code == exit_code


def test_nothing_is_ended_where_nothing_runs(bench: Bench) -> None:
    bench.supervisor.shut_down()
    assert bench.notified == ["STOPPING=1"]
    assert bench.rig.done == []
    assert bench.words[Word.FENCE] == 0


# The whole


def test_a_run_from_start_to_end(make: Callable[..., Bench]) -> None:
    bench = make(hang_timeout=0.2)
    supervisor, words = bench.supervisor, bench.words
    supervisor.watchdog = 0.25

    def opened() -> list[int]:
        assert words[Word.BEATS] == 0
        assert [child.module for child in bench.children] == ["seod.gateway", "seod.loop"]
        bench.loop.says(loop="open", recipe={"kind": "test"})
        bench.gateway.says(gateway="ready", port=1)
        return [bench.loop.link.fileno(), bench.gateway.link.fileno()]

    def ready() -> list[int]:
        assert words[Word.BEATS] == 1
        assert bench.gateway.ready
        assert bench.rig.recipes == [{"kind": "test"}]
        bench.loop.says(loop="ready", warnings=[])
        words[Word.TICKS] = 1
        return [bench.loop.link.fileno()]

    def nothing() -> list[int]:
        words[Word.TICKS] += 1
        words[Word.GATEWAY_BEAT] += 1
        bench.now += 0.25
        return []

    def still() -> list[int]:
        return []

    def dead() -> list[int]:
        assert bench.loop.done == ["SIGKILL"], "not ticked for ten polls"
        return [bench.loop.pidfd]

    def held() -> list[int]:
        assert supervisor.loop is None
        os.write(supervisor.wake_write, b"\x0f")
        return [supervisor.wake_read]

    bench.poller.turns = iter([opened, ready, nothing, nothing, *[still] * 10, dead, held])
    assert supervisor.run() == 0
    assert words[Word.BEATS] == 16
    assert bench.poller.timeouts == [20.0] * 16
    assert bench.notified == [
        "WATCHDOG=1",
        "READY=1\nSTATUS=press: running",
        "WATCHDOG=1",
        "WATCHDOG=1",
        "STATUS=press: fault: the loop process hung: no tick for 200 ms, so it was fenced and killed",
        "STOPPING=1",
        "WATCHDOG=1",
    ]
    assert "ended" in bench.children[0].done


def test_a_run_that_fails_says_so_by_its_exit_code(bench: Bench) -> None:
    def dead() -> list[int]:
        return [bench.gateway.pidfd]

    bench.poller.turns = iter([dead])
    assert bench.supervisor.run() == 1


def test_a_run_whose_start_takes_long_ends_by_itself(bench: Bench) -> None:
    def late() -> list[int]:
        bench.now = 161.0
        return []

    bench.poller.turns = iter([late])
    assert bench.supervisor.run() == 1
    assert bench.supervisor.looked == 161.0


# The process


def test_signals_wake_the_poll_and_a_stop_from_the_terminal_is_ignored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handlers: dict[int, Any] = {}
    woken: list[int] = []
    monkeypatch.setattr(supervising.signal, "signal", handlers.__setitem__)
    monkeypatch.setattr(supervising.signal, "set_wakeup_fd", woken.append)
    supervising.install_signals(7)
    assert woken == [7]
    assert set(handlers) == {signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGTSTP}
    assert handlers.pop(signal.SIGTSTP) == signal.SIG_IGN
    for number, handler in handlers.items():
        assert handler(number, None) is None


ARGUMENTS = SupervisorArguments(3, "rig.yaml", "press", 1, 64, 50, 0.05, 1.0, None, None, None)


def test_the_command_becomes_the_supervisor(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "set_inheritable", lambda *given: asked.append(given))
    monkeypatch.setattr(os, "execv", lambda *given: asked.append(given))
    become(ARGUMENTS)
    inherited, (program, command) = asked
    assert inherited == (3, True)
    assert program == sys.executable
    assert command[:3] == [sys.executable, "-m", "seod.supervisor"]
    assert SupervisorArguments(**json.loads(command[3])) == ARGUMENTS


@pytest.mark.parametrize("parent", [None, 4711])
def test_the_supervisor_runs_above_the_loop_and_tells_what_it_lacks(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], parent: int | None
) -> None:
    done: list[object] = []

    class Fake:
        wake_write = 9

        def __init__(self, arguments: SupervisorArguments) -> None:
            done.append(arguments)

        def run(self) -> int:
            done.append("run")
            return 5

    given = SupervisorArguments(3, "rig.yaml", "press", 1, 64, 50, 0.05, 1.0, None, None, parent)
    monkeypatch.setattr(sys, "argv", ["seod", json.dumps(vars(given))])
    monkeypatch.setattr(supervising, "Supervisor", Fake)
    for name, answer in (("die_with_parent", None), ("install_signals", None), ("set_fifo", "no FIFO")):
        monkeypatch.setattr(
            supervising, name, lambda value, name=name, answer=answer: done.append((name, value)) or answer
        )
    monkeypatch.setattr(supervising, "lock_memory", lambda: done.append("lock") or "")
    assert supervising.main() == 5
    first = [] if parent is None else [("die_with_parent", parent)]
    assert done == [*first, given, ("install_signals", 9), ("set_fifo", 51), "lock", "run"]
    assert capfd.readouterr().err == "seod: warning: supervisor: no FIFO\n"
