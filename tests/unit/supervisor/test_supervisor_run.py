"""The supervisor's watchdog, time and end, a whole run of it, and its process."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
from typing import TYPE_CHECKING, Any

import pytest

from seod.processes import journal
from seod.processes.ring import Word
from seod.supervisor import process as supervising
from seod.supervisor.arguments import SupervisorArguments, become

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.unit.supervisor_bench import Bench, FakeChild


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
