"""docs/protocol.md is what the daemon sends: fields, methods, parameters, events, error codes, both ways."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_loop import peer, running
from loop_bench import Bench

from seod.gateway.service import Service
from seod.loop import events
from seod.loop.process import announce
from seod.model_monitor.judge import ModelError
from seod.processes.ring import AxisState
from seod.protocol import jsonrpc

PAGE = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()


def rows(title: str) -> list[list[str]]:
    """Cells of the tables in a section."""
    section = re.split(r"^#{2,3} ", PAGE.split(f"# {title}\n", 1)[1], maxsplit=1, flags=re.M)[0]
    lines = [line for line in section.splitlines() if line.startswith("| `") or re.match(r"\| -\d", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def fields(title: str) -> set[str]:
    return {row[0].strip(" `") for row in rows(title)}


def words(text: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", text))


def named_in(title: str, field: str) -> set[str]:
    """Names in the description of a field."""
    (told,) = [row[1] for row in rows(title) if row[0].strip(" `") == field]
    return words(told)


@pytest.fixture
def service() -> Service:
    rig: Any = SimpleNamespace(ask=None)
    config: Any = SimpleNamespace()
    return Service(config, rig, rig)


@pytest.mark.slow
async def test_answers_and_notifications() -> None:
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["estimate", "sample", "health"])
        run.loop.rows(1000)
        for topic in ("estimate", "sample", "health"):
            assert set(await client.until(topic)) == fields(topic), topic
        for method in ("info", "list", "get"):
            assert set(await client.call(method)) == fields(method), method
        status = await client.call("status")
        assert set(status) == fields("info") | {"axes", "health"}
        assert set(status["axes"]["motor"]) == fields("get")
        assert set(status["health"]["clients"]) == named_in("health", "clients")
        assert set(status["health"]["lateness"]) == named_in("health", "lateness")
        run.loop.fault()
        await client.call("subscribe", topics=["event"])
        run.loop.become(AxisState.FAULT)
        await client.until("event", event="state")
        assert set((await client.call("get"))["fault"]) == named_in("get", "fault")


def test_lost_and_model_error() -> None:
    names = ("t", "rms", "nrmse", "noise", "statistic", "beyond")
    error = ModelError(**dict.fromkeys(names, 1.0), model="linear")
    assert set(error.as_message("motor", left=False)) == fields("model_error")
    assert fields("lost") == {
        "subscription",
        "topic",
        "lost",
        "total",
    }  # as test_hub.py has it


def test_events() -> None:
    bench = Bench()
    announce(bench.loop, [])
    started = bench.take("started")[-1]
    bench.close()
    trip: Any = SimpleNamespace(code="", why="", numbers={})
    result: Any = SimpleNamespace(ok=True, movement=0.0, why="")
    sent = [
        started,
        events.state(0.0, "a", AxisState.IDLE, None, ""),
        events.polarity(0.0, "a", result, 1.0),
        events.two_phase(0.0, "a", None, "", ""),
        events.warning(0.0, None, "", ""),
        events.fault(0.0, None, [], trip),
        {"event": "changed", "t": 0.0, "axis": "a", "values": {}},
    ]
    told = {row[0].strip(" `"): words(row[1]) for row in rows("event")}
    assert {each["event"]: set(each) - {"event", "t", "axis"} for each in sent} == told


def test_methods_rights_and_parameters(service: Service) -> None:
    told = {row[0].strip(" `"): (row[1], words(row[2])) for row in rows("Methods") if len(row) == 4}
    there = {name: (m.right, set(m.params.model_fields)) for name, m in service.methods.items()}
    assert told == there
    parameters = {row[0].strip(" `") for row in rows("Methods") if len(row) == 2}
    assert parameters == set().union(*(names for _, names in there.values())) - {"axis"}


def test_error_codes() -> None:
    told = {row[1].strip(): int(row[0]) for row in rows("Errors")}
    there = {name: n for name, n in vars(jsonrpc).items() if isinstance(n, int) and n < 0 and name.isupper()}
    assert told == there
