"""What runs for weeks keeps nothing of what has passed: bytes held after some time, and after twice that."""

from __future__ import annotations

import gc
import socket
import tracemalloc
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from fake_loop import FakeLoop, beside, peer, rig_config, running

from seod.panel.panel import Panel
from seod.panel.trends import OLDER, RECENT
from seod.processes.ring import AxisState

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.slow

ROUNDS = 60
SLACK_BYTES = 12_000
"""Interpreter's and numpy's own lists of free objects; an estimate kept in each round is more."""


def held_bytes() -> int:
    """By what the daemon's code and that of its messages made: numba's compiler has its own ups and downs."""
    gc.collect()
    made = [tracemalloc.Filter(True, f"*/{name}/*") for name in ("seod", "json", "asyncio")]
    return sum(trace.size for trace in tracemalloc.take_snapshot().filter_traces(made).traces)


def growth(
    once: Callable[[], object], rounds: int = ROUNDS, settle: Callable[[], object] = lambda: None
) -> int:
    """Bytes more after as many rounds again."""
    tracemalloc.start()
    held = []
    try:
        for _ in range(2):
            for _ in range(rounds):
                once()
            settle()
            held.append(held_bytes())
        return held[1] - held[0]
    finally:
        tracemalloc.stop()


def happens(loop: FakeLoop, number: int) -> None:
    """Some hundredths of a second of rows; now and then new settings, a fault, and a new start."""
    loop.rows(100)
    for _ in range(3):
        loop.event("warning", axis=None, code="link", why="the rig can be reached again")
    if number % 10 == 0:
        loop.event("changed", axis="motor", values={"e_a": 0.5 + 0.1 * (number % 20 == 0)})
        loop.fault()
        loop.become(AxisState.IDLE)
        loop.become(AxisState.EXCITING)


def test_the_process_that_estimates_keeps_nothing_of_what_has_passed() -> None:
    with ExitStack() as closing:
        loop, (supervisor, ours) = FakeLoop(), socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        gateway, observer, work = beside(rig_config(), loop.shared, supervisor, Path("rig.yaml"))
        work.close()
        for close in (loop, ours, supervisor, gateway._observer, observer._shared, observer._link, observer):
            closing.callback(close.close)
        loop.start()
        told_of = {"method": "exact"}  # a fit of `wave` takes a second here
        gateway._observer.send({"change": "motor", "values": told_of, "told": told_of})
        for number, topic in enumerate(["estimate", "event", "health", "model_error", "sample"]):
            gateway._observer.send(
                {"feed": number, "on": True, "topic": topic, "axes": ["motor"], "period_s": 0}
            )
        told = number = 0

        def once() -> None:
            nonlocal told, number
            number += 1
            happens(loop, number)
            gateway._observer.send({"ask": ["get", "motor"], "method": "get", "axis": "motor", "clients": {}})
            observer.poll()
            while message := gateway._observer.receive():
                told += len(message.get("told", ()))

        def settle() -> None:
            """Empty windows that fill and begin anew; no segment is on its way to the model."""
            observer.rig._interrupt()
            observer.rig._monitors["motor"]._work.join()

        assert abs(growth(once, settle=settle)) < SLACK_BYTES
        assert told > 100 * ROUNDS


class Listens:
    """A page, and a client of Foxglove."""

    heard = 0

    def tell(self, _: str) -> None:
        self.heard += 1

    def rows(self, rows: Any) -> None:
        self.heard += len(rows)

    def told(self, *_: object) -> None:
        self.heard += 1


def test_the_panel_keeps_nothing_of_what_has_passed() -> None:
    loop, ends = FakeLoop(), socket.socketpair()
    panel, page = Panel(rig_config(), loop.shared, ends[0], Path("rig.yaml")), Listens()
    number = 0

    def once() -> None:
        nonlocal number
        with_it = Listens()
        panel.pages.update({page, with_it})
        panel.listeners.add(with_it)
        loop.rows(5)
        panel.take_rows()
        for _ in range(10):
            number += 1
            estimate = {"axis": "motor", "t": float(number), "zeta": 0.2 + 1e-6 * number, "quality": "ok"}
            panel.house._heard("estimate", estimate)
        panel.house._heard("health", {"t": float(number), "counters": {"lost": number}})
        panel.house._heard("model_error", {"axis": "motor", "nrmse": 1e-3 * number})
        panel.house._heard("event", {"event": "fault", "axis": "motor", "code": "a", "why": "b", "t": 1.0})
        panel.house._heard("event", {"event": "started", "axis": None, "t": float(number)})
        panel.status()
        panel.pages.discard(with_it)
        panel.listeners.discard(with_it)

    rounds = (RECENT + OLDER) // 10
    assert abs(growth(once, rounds)) < SLACK_BYTES
    assert page.heard > 10 * rounds
    panel._reader.close()
    for end in ends:
        end.close()
    loop.close()


async def test_a_gateway_keeps_nothing_of_clients_that_have_left() -> None:
    async with running() as run:

        async def once() -> None:
            async with peer(run) as client:
                await client.call("subscribe", topics=["estimate", "event"], rate_hz=20)
                await client.call("status")
                await client.call("set", axis="motor", e_a=0.5)
            run.loop.taken.clear()

        tracemalloc.start()
        held = []
        try:
            for _ in range(4):
                for _ in range(30):
                    await once()
                held.append(held_bytes())
        finally:
            tracemalloc.stop()
        # what is kept of each client grows each time, what a busy machine has under way does not
        assert min(after - before for before, after in pairwise(held)) < SLACK_BYTES
