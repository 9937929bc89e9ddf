import pytest
from fake_loop import eventually, peer, running

from seod.gateway import mailbox
from seod.protocol import BUSY, INVALID_PARAMS, NO_ANSWER, REFUSED


async def test_commands_reach_the_loop_in_order():
    async with running(("pitch", "roll")) as run, peer(run) as client:
        lines = [
            b'{"jsonrpc":"2.0","id":1,"method":"set","params":{"axis":"roll","e_a":1.25}}',
            b'{"jsonrpc":"2.0","id":2,"method":"start","params":{"axis":"roll"}}',
            b'{"jsonrpc":"2.0","id":3,"method":"stop"}',
            b'{"jsonrpc":"2.0","id":4,"method":"estop","params":{"why":"now"}}',
            b'{"jsonrpc":"2.0","id":5,"method":"reset"}',
        ]
        await client.send(b"\n".join(lines) + b"\n")
        replies = [await client.read() for _ in lines]
    assert [(c["op"], c["axis"], c["values"]) for c in run.loop.taken] == [
        ("set", 1, {"e_a": 1.25}),
        ("start", 1, {}),
        ("stop", None, {}),
        ("estop", None, {}),
        ("reset", None, {}),
    ]
    assert replies[0]["result"]["settings"]["e_a"] == 1.25


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


async def test_a_loop_that_does_not_answer_is_told_and_an_estop_still_goes_through(monkeypatch):
    monkeypatch.setattr(mailbox, "MAX_WAITING", 3)
    async with running() as run, peer(run) as client:
        run.gateway.rig.mailbox._answer_s = 0.3
        run.loop.silent = True
        lines = [b'{"jsonrpc":"2.0","id":%d,"method":"stop"}\n' % k for k in range(5)]
        await client.send(b"".join(lines) + b'{"jsonrpc":"2.0","id":5,"method":"estop"}\n')
        replies = sorted([await client.read() for _ in range(6)], key=lambda reply: reply["id"])
    assert [reply["error"]["code"] for reply in replies] == [NO_ANSWER] * 3 + [BUSY] * 2 + [NO_ANSWER]
    assert "did not answer 'estop' within 0.3 s" in replies[5]["error"]["message"]
    assert [command["op"] for command in run.loop.taken] == ["stop"] * 3 + ["estop"]


async def test_a_command_waits_for_a_loop_that_is_about_to_start():
    async with running(started=False) as run, peer(run) as client:
        await client.send(b'{"jsonrpc":"2.0","id":1,"method":"start"}\n')
        await client.send(b'{"jsonrpc":"2.0","id":2,"method":"list"}\n')
        assert (await client.read())["id"] == 2  # the first waits
        run.loop.row()
        assert (await client.read()) == {"jsonrpc": "2.0", "id": 1, "result": {"ok": True}}


@pytest.mark.slow
async def test_before_the_loop_ticks_commands_are_refused():
    async with running(started=False) as run, peer(run) as client:
        error = await client.call("start")
        assert error["code"] == NO_ANSWER
        assert "not started" in error["message"]
        assert "not started" in (await client.call("info"))["realtime"]["why"][0]
        run.loop.row()
        await eventually(lambda: run.gateway.rig.mailbox.ticking)
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
