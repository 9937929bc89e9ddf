"""docs/protocol.md is what the daemon sends: fields, methods, events, codes, numbers, both ways."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_loop import peer, running
from loop_bench import Bench

from seod.config.axis import METHODS
from seod.config.server import ServerConfig
from seod.estimate.base import QUALITIES
from seod.gateway.connection import UNDER_WAY
from seod.gateway.lobby import AUTHENTICATE_S
from seod.gateway.params import TOPICS, DriveParams
from seod.gateway.service import MAX_SUBSCRIPTIONS, MOST, SLOW_TOPICS_HZ, WITHOUT_SEAT, Service
from seod.loop import events
from seod.loop.process import announce
from seod.model_monitor.judge import ModelError
from seod.observe.rig import STATES
from seod.processes.ring import AxisState
from seod.protocol import jsonrpc

REPO = Path(__file__).parents[2]
PAGE = (REPO / "docs" / "protocol.md").read_text()
PROSE = " ".join(line for line in PAGE.splitlines() if not line.startswith(("|", "#", "```")))
MOST_TONES = next(each.max_length for each in DriveParams.model_fields["tones"].metadata)
NUMBERS = {
    r"`server\.port`, (\d+)": ServerConfig.model_fields["port"].default,
    r"at most ([\d,]+) bytes": jsonrpc.MAX_LINE,
    r"at most (\d+) requests": jsonrpc.MAX_BATCH,
    r"A client has (\w+) commands": UNDER_WAY["command"],
    r"commands and (\w+) queries under way": UNDER_WAY["read"],
    r"calls `authenticate` first, within (\d+) s": AUTHENTICATE_S,
    r"one subscription or more, at most (\d+)": MAX_SUBSCRIPTIONS,
    r"at most (\w+) all samples of the rig": MOST,
    r"and (\d+) further messages a second": SLOW_TOPICS_HZ,
}
"""Numbers of the prose, each by the words about it."""
SPELLED = {"twice": 2, "two": 2, "three": 3, "four": 4, "five": 5}
NAMES = ["JSON-RPC 2.0", "UTF-8"]
"""Numbers of the prose that belong to a name."""


def rows(title: str) -> list[list[str]]:
    """Cells of the tables in a section."""
    section = re.split(r"^#{2,3} ", PAGE.split(f"# {title}\n", 1)[1], maxsplit=1, flags=re.M)[0]
    lines = [line for line in section.splitlines() if line.startswith("| `") or re.match(r"\| -\d", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def fields(title: str) -> set[str]:
    return {row[0].strip(" `") for row in rows(title)}


def words(text: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", text))


def described(title: str, field: str) -> str:
    """What is said of a field."""
    (told,) = [row[1] for row in rows(title) if row[0].strip(" `") == field]
    return told


def named_in(title: str, field: str) -> set[str]:
    """Names in the description of a field."""
    return words(described(title, field))


def listed(text: str) -> tuple[str, ...]:
    """Names in their order, each as often as it stands there."""
    return tuple(re.findall(r"`(\w+)`", text))


def fault_codes() -> set[str]:
    """By the sources: of each `Trip`, and of fault events that are made without one."""
    found = []
    for path in [each for room in ("seod", "drivers") for each in sorted((REPO / room).rglob("*.py"))]:
        source = path.read_text()
        if not re.search(r'\bTrip\(|"fault"', source):
            continue
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Trip":
                found.append(ast.literal_eval(node.args[0]))
            elif isinstance(node, ast.Dict):
                keys = [ast.unparse(key) if key else "" for key in node.keys]
                made = dict(zip(keys, map(ast.unparse, node.values), strict=True))
                if made.get("'event'") == "'fault'" and "'code'" in made:
                    found.append(ast.literal_eval(made["'code'"]))
    return set(found)


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


def test_fault_codes() -> None:
    told = listed(re.split(r"\.\s", PAGE.split("A fault's `code` for programs:", 1)[1], maxsplit=1)[0])
    assert sorted(told) == sorted(fault_codes())


def test_topics_each_have_a_section() -> None:
    assert listed(described("Methods", "topics")) == TOPICS
    assert set(re.findall(r"^### (\w+)$", PAGE.split("## Notifications", 1)[1], re.M)) == {*TOPICS, "lost"}


def test_states_qualities_and_estimators() -> None:
    assert named_in("get", "state") == {state.name.lower() for state in AxisState}
    assert listed(described("info", "state")) == STATES
    assert set(STATES) == {state.name.lower() for state in AxisState}
    assert listed(described("estimate", "quality")) == QUALITIES
    assert listed(described("Methods", "method")) == METHODS


@pytest.mark.parametrize("said", NUMBERS)
def test_a_number_of_the_prose(said: str) -> None:
    (told,) = re.findall(said, PROSE)
    value = SPELLED[told] if told in SPELLED else float(told.replace(",", ""))
    assert value == NUMBERS[said]


def test_no_other_number_is_in_the_prose() -> None:
    """One more costs a line of `NUMBERS`."""
    rest = re.sub("|".join([*NUMBERS, *NAMES]), "", PROSE)
    assert re.findall(r"\d+", re.sub(r"`[^`]*`", "", rest)) == []


def test_most_tones_and_what_may_be_called_without_a_seat() -> None:
    (most,) = re.findall(r"at most (\d+)$", described("Methods", "tones"))
    assert int(most) == MOST_TONES
    (told,) = re.findall(r"Beyond `server.max_clients` a client may call (.*?) only\.", PROSE)
    assert listed(told) == WITHOUT_SEAT
