import asyncio
import json

import pytest
from fake_loop import eventually, peer, running

from seod.gateway.connection import UNDER_WAY
from seod.processes.ring import Word
from seod.protocol.jsonrpc import INVALID_PARAMS, MAX_LINE, NO_ANSWER, REFUSED


async def test_commands_reach_the_loop_in_order():
    async with running(("pitch", "roll")) as run, peer(run) as client:
        lines = [
            b'{"jsonrpc":"2.0","id":1,"method":"set","params":{"axis":"roll","e_a":1.25}}',
            b'{"jsonrpc":"2.0","id":2,"method":"start","params":{"axis":"roll"}}',
            b'{"jsonrpc":"2.0","id":3,"method":"stop"}',
            b'{"jsonrpc":"2.0","id":4,"method":"reset"}',
        ]
        await client.send(b"\n".join(lines) + b"\n")
        replies = [await client.read() for _ in lines]
    assert [(c["op"], c["axis"], c["values"]) for c in run.loop.taken] == [
        ("set", 1, {"e_a": 1.25}),
        ("start", 1, {}),
        ("stop", None, {}),
        ("reset", None, {}),
    ]
    assert replies[0]["result"]["settings"]["e_a"] == 1.25


def line(number, method, **params):
    return json.dumps({"jsonrpc": "2.0", "id": number, "method": method, "params": params}).encode() + b"\n"


async def test_an_estop_comes_before_all_that_waits_and_nothing_of_that_is_carried_out():
    async with running() as run, peer(run) as client, peer(run) as other:
        await other.call("list")
        before = [line(k, "reset" if k % 2 else "start") for k in range(40)]
        estop, after = line(100, "estop", why="now"), line(101, "reset")
        await client.send(b"".join(before) + b'{"jsonrpc":"2.0","method":"stop"}\n' + estop + after)
        replies = {reply["id"]: reply for reply in [await client.read() for _ in range(42)]}
    assert [command["op"] for command in run.loop.taken] == ["estop", "reset"]
    assert replies[100]["result"] == replies[101]["result"] == {"ok": True}
    assert {replies[k]["error"]["code"] for k in range(40)} == {REFUSED}
    assert "an e-stop came after it" in replies[7]["error"]["message"]


@pytest.mark.slow
async def test_an_estop_overtakes_what_other_clients_asked_before():
    async with running() as run, peer(run) as client, peer(run) as other:
        run.loop.silent = True  # so that commands stay under way
        await client.send(b"".join(line(k, "start") for k in range(40)))
        await eventually(lambda: len(run.loop.taken) == UNDER_WAY["command"])
        run.loop.silent = False
        assert await other.call("estop") == {"ok": True}
        replies = {reply["id"]: reply for reply in [await client.read() for _ in range(40)]}
    ops = [command["op"] for command in run.loop.taken]
    assert ops == ["start"] * UNDER_WAY["command"] + ["estop"]
    waited = range(UNDER_WAY["command"], 40)
    assert {replies[number]["error"]["code"] for number in waited} == {REFUSED}


async def test_an_estop_in_pieces_in_long_lines_and_in_batches():
    async with running() as run, peer(run) as client:
        for number, text in enumerate(
            (
                line(1, "estop"),
                line(2, "estop", why="x" * 3000),  # too long to be looked at before its turn
                b'{"jsonrpc":"2.0","id":3,"method":"\\u0065stop"}\n',
                b'[{"jsonrpc":"2.0","id":4,"method":"estop"}]\n',
            )
        ):
            for at in range(0, len(text), max(7, len(text) // 20)):
                await client.send(text[at : at + max(7, len(text) // 20)])
                await asyncio.sleep(0)
            reply = await client.read()
            assert "result" in (reply[0] if isinstance(reply, list) else reply)
            assert len(run.loop.taken) == number + 1


async def test_the_word_alone_is_no_estop():
    async with running() as run, peer(run) as client:
        await client.send(b'{"jsonrpc":"2.0","id":1,"method":"get","params":{"axis":"estop"}}\n')
        assert "no axis 'estop'" in (await client.read())["error"]["message"]
        await client.send(b"x" * (MAX_LINE + 1) + b'"method":"estop"' + b"\n" + line(2, "list"))
        assert "longer than" in (await client.read())["error"]["message"]
        assert (await client.read())["id"] == 2
    assert not run.loop.taken


async def test_the_loops_reason_is_told():
    async with running() as run, peer(run) as client:
        run.loop.refuse = "motor: sample is 12 ms old"
        error = await client.call("start")
    assert error == {"code": REFUSED, "message": "motor: sample is 12 ms old"}


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"e_a": 2.5}, "e_a: e_a + |bias| = 2.5 V is over limits.output = 2 V"),
        ({"e_a": 1.0, "bias": -1.5}, "limits.output"),
        ({"bias": 1.6}, "bias: e_a + |bias| = 2.1 V"),
        ({"hysteresis": 0.5}, "hysteresis: must be below limits.amplitude = 0.5"),
        ({"hysteresis": -0.1}, "hysteresis: should be greater than or equal to 0"),
        ({"e_a": 0}, "e_a: should be greater than 0"),
        ({"K_L": 1e-308}, "K_L: must lie within limits.K_L = [1.7, 170], got 1e-308"),
        ({"K_L": 171.0}, "limits.K_L"),
        ({"e_a": 1e-308}, "e_a: must be at least limits.e_a = 0.0002 V, got 1e-308"),
        ({"bias": 1e308}, "limits.output"),
        ({"reference": 1.0}, "reference: cannot be set in position mode"),
        ({"trim": True}, "trim: cannot be set in position mode"),
        ({"method": "magic"}, "known: exact, peaks"),
        ({"method": "exakt"}, "did you mean exact"),
        ({}, "give at least one of"),
        ({"axis": "rudder", "e_a": 1}, "axis: no axis 'rudder'; known: motor"),
    ],
)
async def test_settings_beyond_the_limits_are_refused_before_the_loop_sees_them(values, told):
    async with running() as run, peer(run) as client:
        error = await client.call("set", **values)
        assert not run.loop.taken
        unchanged = await client.call("get")
    assert error["code"] == INVALID_PARAMS
    assert told in error["message"]
    assert unchanged["settings"]["e_a"] == 0.5


async def test_several_axes_must_be_named_where_one_is_meant():
    async with running(("pitch", "roll")) as run, peer(run) as client:
        assert "one of pitch, roll" in (await client.call("get"))["message"]
        assert "did you mean pitch?" in (await client.call("start", axis="pich"))["message"]
        assert (await client.call("start")) == {"ok": True}


async def test_estimator_settings_stay_in_the_gateway():
    async with running() as run, peer(run) as client:
        answer = await client.call("set", axis="motor", method="peaks")
        assert answer["settings"]["method"] == "peaks"
        assert not run.loop.taken
        await client.call("subscribe", topics=["estimate"])
        run.loop.rows(1000)
        assert (await client.until("estimate"))["method"] == "peaks"


async def test_a_loop_that_does_not_answer_is_told_and_an_estop_still_goes_through():
    async with running() as run, peer(run) as client:
        run.gateway.desk.mailbox._answer_s = 0.3
        run.loop.silent = True
        await client.send(b"".join(line(k, "stop") for k in range(UNDER_WAY["command"])))
        await eventually(lambda: len(run.loop.taken) == UNDER_WAY["command"])
        await client.send(line(5, "estop"))
        replies = [await client.read() for _ in range(UNDER_WAY["command"] + 1)]
    assert {reply["error"]["code"] for reply in replies} == {NO_ANSWER}
    (estop,) = [reply for reply in replies if reply["id"] == 5]
    assert "did not answer 'estop' within 0.3 s" in estop["error"]["message"]
    assert run.loop.taken[-1]["op"] == "estop"


async def test_a_command_waits_for_a_loop_that_is_about_to_start():
    async with running(started=False) as run, peer(run) as client:
        await client.send(b'{"jsonrpc":"2.0","id":1,"method":"start"}\n')
        await client.send(b'{"jsonrpc":"2.0","id":2,"method":"list"}\n')
        assert (await client.read())["id"] == 2  # the first waits
        run.loop.row()
        assert (await client.read()) == {"jsonrpc": "2.0", "id": 1, "result": {"ok": True}}


async def test_a_reset_that_waits_does_not_leave_a_fault_that_came_meanwhile():
    async with running(started=False) as run, peer(run) as client:
        await client.send(b'{"jsonrpc":"2.0","id":1,"method":"reset"}\n')
        await client.call("list")
        run.loop.shared.words[Word.FAULTS] += 1
        run.loop.row()
        (answer,) = [reply for reply in [await client.read()] if reply["id"] == 1]
        assert "a fault came after this reset was asked for" in answer["error"]["message"]
        assert not run.loop.taken
        assert (await client.call("reset")) == {"ok": True}


@pytest.mark.slow
async def test_before_the_loop_ticks_commands_are_refused():
    async with running(started=False) as run, peer(run) as client:
        error = await client.call("start")
        assert error["code"] == NO_ANSWER
        assert "not started" in error["message"]
        assert "not started" in (await client.call("info"))["realtime"]["why"][0]
        run.loop.row()
        await eventually(lambda: run.gateway.desk.mailbox.ticking)
        assert (await client.call("start")) == {"ok": True}


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"volts": -2.1, "duration": 0.1}, "volts: |volts| + |bias| = 2.1 V is over limits.output = 2 V"),
        ({"volts": 0.1, "duration": 1e9}, "duration: must be at most limits.excitation"),
        ({"volts": 0.1}, "duration: required"),
        ({"volts": 0.1, "duration": -1}, "duration: should be greater than 0"),
    ],
)
async def test_a_drive_is_held_against_the_limits(values, told):
    async with running() as run, peer(run) as client:
        error = await client.call("drive", **values)
        assert not run.loop.taken
        await client.call("drive", volts=0.5, duration=0.2)
    assert error["code"] == INVALID_PARAMS
    assert told in error["message"]
    assert [(c["op"], c["axis"], c["values"]) for c in run.loop.taken] == [
        ("drive", 0, {"volts": 0.5, "duration": 0.2})
    ]


async def test_a_new_method_is_told_to_everyone():
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["event"])
        await client.call("set", axis="motor", method="peaks", e_a=0.7)
        await client.until("event", event="changed", values={"e_a": 0.7})
        await client.until("event", event="changed", values={"method": "peaks"})
