"""Panel and fleet: what they say, how often they are started, and what is given back."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any

import pytest

from seod.processes.handover import ChildArguments
from seod.supervisor.keeper import Keeper, Way
from tests.unit.supervisor_bench import FakeChild

if TYPE_CHECKING:
    from collections.abc import Iterator


class Bench:
    """A keeper of a process that never runs."""

    def __init__(self) -> None:
        self.children: list[FakeChild] = []
        self.dropped: list[Any] = []
        self.keeper = Keeper("panel", self.make)

    def make(self) -> Any:
        arguments = ChildArguments(3, 4, -1, 6, 1, 64, 1, None, "rig.yaml")
        self.children.append(FakeChild("seod.panel", arguments))
        return self.children[-1]

    def died(self) -> None:
        self.keeper.died(self.dropped.append)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    for child in made.children:
        child.close()


def test_a_way_has_two_ends_for_whole_messages_and_gives_both_back() -> None:
    way = Way()
    ends = (way.own_end, way.gateway_end)
    assert {end.family for end in ends} == {socket.AF_UNIX}
    assert {end.type for end in ends} == {socket.SOCK_SEQPACKET}
    way.own_end.send(b"a client")
    assert way.gateway_end.recv(100) == b"a client"
    way.close()
    assert [end.fileno() for end in ends] == [-1, -1]


def test_what_it_says_is_said(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    bench.keeper.start()
    (child,) = bench.children
    assert bench.keeper.child is child
    assert bench.keeper.hear(), "nothing was said, more may come"
    child.says(panel="ready", says=["the panel is on port 8080", "no certificate: over plain HTTP"])
    child.says(panel="ready")
    assert bench.keeper.hear()
    assert bench.keeper.hear()
    assert child.failure == ""
    said = "seod: the panel is on port 8080\nseod: no certificate: over plain HTTP\n"
    assert capfd.readouterr().err == said
    child.says(says=["bye"])
    child.hangs_up()
    assert bench.keeper.hear()
    assert not bench.keeper.hear()


def test_before_its_start_there_is_nothing_to_hear_and_nothing_that_ends(bench: Bench) -> None:
    assert bench.keeper.name == "panel"
    assert bench.keeper.child is None
    assert bench.keeper.hear()
    bench.died()
    bench.keeper.end()
    assert bench.children == bench.dropped == []


def test_one_that_ended_is_dropped_and_started_again(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    bench.keeper.start()
    bench.died()
    first, second = bench.children
    assert bench.dropped == [first]
    assert bench.keeper.child is second
    assert capfd.readouterr().err == "seod: the panel process ended with exit code 1\n"


def test_one_that_cannot_do_its_work_is_left_alone(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    bench.keeper.start()
    bench.children[0].says(panel="failed", why="port 8080 is taken")
    bench.died()
    assert len(bench.children) == 1
    assert bench.dropped == bench.children
    assert bench.keeper.child is None
    assert capfd.readouterr().err == "seod: the panel: port 8080 is taken; the rig goes on without it\n"
    bench.died()
    assert len(bench.dropped) == 1


def test_it_is_started_again_five_times(bench: Bench) -> None:
    bench.keeper.start()
    for starts in range(2, 7):
        bench.died()
        assert len(bench.children) == starts
    bench.died()
    assert len(bench.children) == 6
    assert bench.keeper.child is None


def test_it_ends_with_the_daemon(bench: Bench) -> None:
    bench.keeper.start()
    bench.keeper.end()
    assert "ended" in bench.children[0].done
