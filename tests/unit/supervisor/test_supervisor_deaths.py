"""Children that hang or die: the supervisor writes neutral, starts them again, gives up, and tells why."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from seod.processes import journal
from seod.processes.ring import Word
from tests.unit.supervisor_bench import Bench, silence

if TYPE_CHECKING:
    from collections.abc import Callable


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
