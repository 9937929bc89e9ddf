import asyncio
import gc
import json
import math
import os
import socket
import subprocess
from pathlib import Path

import pytest
from fake_loop import DEADLINE_S, PERIOD, FakeLoop, beside, eventually, hear, peer, rig_config, running

from seod import PROTOCOL, __version__
from seod.observe import process as observing
from seod.observe.health import histogram
from seod.observe.process import leave_realtime
from seod.processes.handover import ChildArguments, write_memfd
from seod.processes.ring import AxisState, Word
from seod.protocol.jsonrpc import INVALID_PARAMS, NO_ANSWER, REFUSED

ESTIMATE_FIELDS = {"axis", "t", "age_s", "zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd"} | {
    *(
        "delay_s",
        "delay_sd_s",
        "frequency",
        "amplitude",
        "asymmetry",
        "mean_speed",
        "ps",
        "temperature",
        "fitness",
    ),
    *("misfit", "lag_s", "correlation", "e_a_dependence", "method", "quality", "advice"),
}


# ---- reading


async def test_info_says_what_runs_here():
    async with running() as run, peer(run) as client:
        info = await client.call("info")
    assert info == {
        "version": __version__,
        "protocol": PROTOCOL,
        "rig": "fake",
        "axes": ["motor"],
        "realtime": {"ok": False, "why": ["this is a test"]},
        "simulated": True,
        "truth": {"motor": {"K_L": 17.0, "omega_n": 117.0, "zeta": 0.21}},
        "driver": "virtual",
        "rate_hz": 2000.0,
        "dead_man": None,
        "state": "idle",
    }


@pytest.mark.slow
async def test_estimates_carry_all_fields_and_null_for_what_is_undefined():
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["estimate"], axes=["motor"])
        run.loop.rows(1000)
        got = await client.until("estimate")
        answer = await client.call("get", axis="motor")
    assert set(got) == ESTIMATE_FIELDS
    assert got["ps"] is got["temperature"] is None
    assert got["method"] == "wave"
    known = {
        "axis",
        "state",
        "fault",
        "estimate",
        "controller",
        "second_phase",
        "settings",
        "units",
        "model_error",
    }
    assert set(answer) == known
    assert set(answer["estimate"]) == ESTIMATE_FIELDS
    assert answer["settings"] == {
        "e_a": 0.5,
        "hysteresis": 0.004,
        "bias": 0.0,
        "K_L": 17.0,
        "two_phase": False,
        "method": "wave",
    }


async def test_get_before_any_estimate_is_null():
    async with running() as run, peer(run) as client:
        answer = await client.call("get")
        assert answer["estimate"] is None
        assert (await client.call("status"))["axes"]["motor"] == answer


@pytest.mark.slow
async def test_samples_follow_the_rows_in_order_and_none_is_missing():
    async with running(("pitch", "roll")) as run, peer(run) as client:
        await client.call("subscribe", topics=["sample"], axes=["roll"])
        run.loop.rows(300)
        run.loop.row(flags=0, y=math.nan)
        samples = [await client.until("sample") for _ in range(301)]
    assert [sample["tick"] for sample in samples] == list(range(301))
    assert {sample["axis"] for sample in samples} == {"roll"}
    assert samples[7] == {
        "axis": "roll",
        "tick": 7,
        "t": pytest.approx(100.0 + 7 * PERIOD),
        "y": pytest.approx(0.2 * math.sin(115 * (100 + 7 * PERIOD))),
        "u": -math.copysign(0.5, samples[7]["y"]),
        "t_u": pytest.approx(100.0 + 7 * PERIOD + 1e-4),
        "reference": 0.0,
        "signal": -samples[7]["y"],
        "e_a": 0.5,
        "bias": 0.0,
        "ps": None,
        "temperature": None,
        "K_L": 17.0,
        "state": "idle",
        "fresh": True,
        "phase": 1,
    }
    assert samples[300]["y"] is None
    assert not samples[300]["fresh"]


async def test_events_of_the_loop_reach_subscribers_but_replies_do_not():
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["event"])
        await client.call("keepalive")
        run.loop.become(AxisState.ARMED)
        event = await client.until("event")
    assert event["event"] == "state"
    assert (event["state"], event["previous"]) == ("armed", "idle")


@pytest.mark.slow
async def test_health_tells_how_the_loop_does():
    async with running() as run, peer(run) as client:
        shared = run.loop.shared
        shared.lateness[8], shared.lateness[20] = 90, 10
        shared.floats[Word.LATENESS_MAX_D] = 40e-6
        shared.counters[1] = 7
        await client.call("subscribe", topics=["health"])
        run.loop.rows(20)
        health = await client.until("health", ticks=20)
    assert health["lateness"]["p50_us"] == 4.0
    assert health["lateness"]["p99_us"] == 32.0
    assert health["lateness"]["max_us"] == pytest.approx(40.0)
    assert sum(health["lateness"]["bins"]) == 100
    assert health["execution"]["p50_us"] is None
    assert health["counters"] == {"late": 0, "lost": 7}
    assert health["rows_lost"] == 0
    assert health["clients"] == {"connected": 1, "waiting": 0, "turned_away": 0, "dropped": {}}
    assert health["recorder"] is None
    assert not health["realtime"]["ok"]


def test_percentiles_never_exceed_the_maximum():
    bins = [0] * 64
    bins[63] = 5
    assert histogram(bins, 0.2)["p50_us"] == pytest.approx(2e5)
    bins[63], bins[4] = 0, 5
    assert histogram(bins, 1.7e-6)["p99_us"] == pytest.approx(1.7)


async def test_list_tells_what_can_be_asked_for():
    async with running() as run, peer(run) as client:
        number = (await client.call("subscribe", topics=["event"]))["subscription"]
        listed = await client.call("list")
        assert listed["topics"] == ["estimate", "sample", "event", "health", "model_error"]
        assert listed["axes"] == ["motor"]
        assert listed["subscriptions"] == [number]
        for method in listed["methods"]:
            assert (await client.call(method, nonsense=1)).get("code") != -32601
        await client.call("unsubscribe", subscription=number)
        error = await client.call("unsubscribe", subscription=number)
    assert error["code"] == INVALID_PARAMS


# ---- faults, silence, death


@pytest.mark.slow
async def test_a_fault_makes_the_estimate_void_and_says_why_until_the_reset():
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["estimate", "event"])
        run.loop.become(AxisState.EXCITING)
        run.loop.rows(600)
        await client.until("estimate")
        run.loop.fault("motor: y = 1.5 rad is beyond limits.travel")
        void = await client.until("estimate", quality="fault")
        assert void["zeta"] is None
        assert "limits.travel" in void["advice"]
        state = await client.call("get")
        assert state["state"] == "fault"
        assert state["fault"] == {
            "code": "travel",
            "why": "motor: y = 1.5 rad is beyond limits.travel",
            "numbers": {"y": 1.5},
            "t": run.loop.t,
        }
        run.loop.rows(400)  # rows of an axis in fault bring no estimates
        await eventually(lambda: run.rig._reader._ring.tail == 1000)
        assert (await client.call("get"))["estimate"]["quality"] == "fault"
        run.loop.become(AxisState.IDLE)
        await client.until("event", state="idle")
        state = await client.call("get")
        assert state["fault"] is state["estimate"] is state["controller"] is None


@pytest.mark.slow
async def test_a_lost_state_event_is_made_up_for_by_the_rows():
    async with running() as run, peer(run) as client:
        run.loop.state = AxisState.EXCITING
        run.loop.rows(400)
        await eventually(lambda: run.rig.axes["motor"].state == "exciting")
        run.loop.state = AxisState.FAULT
        run.loop.rows(400)
        await eventually(lambda: run.rig.axes["motor"].state == "fault")
        assert (await client.call("get"))["fault"]["why"] == "the reason was lost"


async def test_a_fault_that_one_axis_latched_leaves_the_others_alone():
    async with running(("pitch", "roll")) as run, peer(run) as client:
        await client.call("subscribe", topics=["event"])
        for axis in run.loop.axes:
            run.loop.become(AxisState.EXCITING, axis)
        run.loop.event("fault", axis="roll", latched=["roll"], code="travel", why="roll: too far", numbers={})
        run.loop.become(AxisState.FAULT, "roll")
        await client.until("event", state="fault")
        pitch, roll = [await client.call("get", axis=axis) for axis in run.loop.axes]
        assert (pitch["state"], pitch["fault"]) == ("exciting", None)
        assert (roll["state"], roll["fault"]["why"]) == ("fault", "roll: too far")
        assert (await client.call("info"))["state"] == "fault"
        await client.call("reset", axis="roll")
        assert [(c["op"], c["axis"]) for c in run.loop.taken] == [("reset", 1)]


async def test_a_row_written_before_the_fault_does_not_take_it_back():
    async with running() as run:
        axis = run.rig.axes["motor"]
        run.loop.become(AxisState.EXCITING)
        run.loop.row()
        run.loop.fault()
        run.loop.state = AxisState.EXCITING
        run.loop.rows(3)
        await eventually(lambda: run.rig._reader._ring.tail == 4)
        assert axis.state == "fault"


@pytest.mark.slow
async def test_when_no_rows_come_the_estimate_is_stale(monkeypatch):
    monkeypatch.setattr("seod.observe.rig.SILENCE_S", 0.05)
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["estimate"])
        run.loop.rows(1000)
        while "no rows" not in (await client.until("estimate", quality="stale"))["advice"]:
            pass
        assert (await client.call("get"))["estimate"]["quality"] == "stale"
        run.loop.rows(1000)
        while (await client.until("estimate"))["quality"] == "stale":
            pass


DEATH = {
    "loop": "died",
    "t": 101.0,
    "generation": 1,
    "why": "the loop process was killed",
    "neutral": "neutral written",
}


async def test_the_death_of_the_loop_is_a_fault_and_a_reset_asks_for_a_new_one():
    async with running() as run, peer(run) as client, peer(run) as other:
        await client.call("subscribe", topics=["estimate", "event"])
        run.link.send(json.dumps(DEATH).encode())
        event = await client.until("event")
        assert (event["event"], event["code"], event["axis"]) == ("fault", "loop_died", None)
        assert event["why"] == "the loop process was killed; neutral written"
        status = await client.call("status")
        assert status["state"] == status["axes"]["motor"]["state"] == "fault"
        assert status["axes"]["motor"]["estimate"]["quality"] == "fault"
        assert status["realtime"] == {"ok": False, "why": [event["why"]]}
        refused = await client.call("estop")
        assert refused["code"] == NO_ANSWER
        assert "`reset` starts a new one" in refused["message"]

        resets = [asyncio.create_task(each.call("reset")) for each in (client, other)]
        assert await hear(run) == {"op": "restart_loop"}
        run.loop.start(generation=1)  # an old message of the dead loop
        await asyncio.sleep(0.05)
        assert not any(reset.done() for reset in resets)
        run.loop.start(generation=2)
        assert await asyncio.gather(*resets) == [{"ok": True}] * 2
        assert (await client.call("info"))["state"] == "idle"
        with pytest.raises(BlockingIOError):
            run.link.recv(100)  # both resets share one new loop


async def test_a_new_loop_that_fails_as_well_is_told():
    async with running() as run, peer(run) as client:
        run.link.send(json.dumps(DEATH).encode())
        await eventually(lambda: run.gateway.desk.mailbox.dead_why)
        reset = asyncio.create_task(client.call("reset"))
        await hear(run)
        run.link.send(json.dumps(DEATH | {"generation": 2, "why": "no such bus"}).encode())
        error = await reset
    assert error["code"] == REFUSED
    assert "no such bus" in error["message"]


async def test_a_new_loop_that_fails_once_its_client_has_left_leaves_no_error_behind(caplog):
    """Found by the simulation, seed 300047: the journal told of an exception that nobody had fetched."""
    async with running() as run:
        mailbox = run.gateway.desk.mailbox
        async with peer(run) as client:
            run.link.send(json.dumps(DEATH).encode())
            await eventually(lambda: mailbox.dead_why)
            reset = asyncio.create_task(client.call("reset"))
            await hear(run)
            reset.cancel()
        await eventually(lambda: not run.gateway.server.clients()["connected"])
        run.link.send(json.dumps(DEATH | {"generation": 2, "why": "no such bus"}).encode())
        await eventually(lambda: "no such bus" in mailbox.dead_why)
        mailbox._restarted = None
        gc.collect()
    assert "never retrieved" not in caplog.text


async def test_a_command_under_way_is_answered_when_the_loop_dies():
    async with running() as run, peer(run) as client:
        run.loop.silent = True
        start = asyncio.create_task(client.call("start"))
        await eventually(lambda: run.loop.taken)
        run.link.send(json.dumps(DEATH).encode())
        assert "the loop died meanwhile" in (await start)["message"]


async def test_a_restarted_loop_has_the_rig_files_relay_again():
    async with running() as run, peer(run) as client:
        await client.call("set", e_a=1.5, K_L=20.0)
        run.link.send(json.dumps(DEATH).encode())
        await eventually(lambda: run.gateway.desk.mailbox.dead_why)
        run.loop.start(generation=2)
        await eventually(lambda: run.gateway.desk.mailbox.ticking)
        settings = (await client.call("get"))["settings"]
    assert (settings["e_a"], settings["K_L"]) == (0.5, 17.0)


async def test_an_estimator_that_cannot_compute_is_told_and_begins_anew(monkeypatch):
    class Broken:
        method = "exact"
        resets = 0

        def update(self, row):
            raise ZeroDivisionError("by nought")

        def reset(self):
            Broken.resets += 1

        def inherit(self, before):
            pass

    monkeypatch.setattr(observing, "make_estimator", lambda settings: Broken())
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["event"])
        run.loop.row()
        warning = await client.until("event", code="estimator")
        assert "by nought" in warning["why"]
        assert Broken.resets


@pytest.mark.parametrize("how", ["closed", "told"])
async def test_the_gateway_ends_with_its_supervisor(how):
    loop = FakeLoop()
    theirs, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs, ours:
        gateway, _, observing = beside(rig_config(), loop.shared, theirs, Path("rig.yaml"))
        serving = asyncio.gather(gateway.run(), observing)
        await asyncio.sleep(0.02)
        ours.send(b'{"stop":true}') if how == "told" else ours.close()
        async with asyncio.timeout(DEADLINE_S):
            await serving
    loop.close()


# ---- the process


def test_what_estimates_is_never_real_time(monkeypatch):
    asked = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: os.SCHED_FIFO)
    monkeypatch.setattr(os, "setpriority", lambda *_: None)
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, param: asked.append((pid, policy)))
    leave_realtime()
    assert asked == [(0, os.SCHED_OTHER)]


def start_process(loop, config, record=None):
    """The gateway as its own process; returns it and our end of its socket."""
    theirs, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    memfd = write_memfd("config", config.model_dump_json().encode())
    arguments = ChildArguments(
        config_fd=memfd,
        shared_fd=loop.shared.fd,
        supervisor_fd=theirs.fileno(),
        supervisor_pid=os.getpid(),
        axes=len(loop.axes),
        rows=loop.shared.rows,
        generation=1,
        record=record,
        config_path="/nowhere/rig.yaml",
    )
    fds = (memfd, loop.shared.fd, theirs.fileno())
    process = subprocess.Popen(arguments.command("seod.gateway"), pass_fds=fds, stderr=subprocess.PIPE)
    theirs.close()
    os.close(memfd)
    ours.settimeout(DEADLINE_S)
    return process, ours


SLOW_TO_GO = """
import atexit, time
from pathlib import Path

if b"seod.observe" in Path("/proc/self/cmdline").read_bytes():
    atexit.register(time.sleep, 5.0)
"""


@pytest.mark.processes
@pytest.mark.parametrize("slow_to_go", [False, True])
def test_as_a_process_it_says_its_port_and_ends_cleanly_on_sigterm(tmp_path, monkeypatch, slow_to_go):
    if slow_to_go:  # the process that records is killed once it has said that all is recorded
        (tmp_path / "sitecustomize.py").write_text(SLOW_TO_GO)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    loop = FakeLoop()
    loop.start()
    process, link = start_process(loop, rig_config(), str(tmp_path / "a.csv"))
    with link:
        ready = json.loads(link.recv(1000))
        assert ready["gateway"] == "ready"
        with socket.create_connection(("127.0.0.1", ready["port"])) as client:
            client.sendall(b'{"jsonrpc":"2.0","id":1,"method":"info"}\n')
            assert json.loads(client.makefile("rb").readline())["result"]["rig"] == "fake"
            loop.rows(100)
            process.terminate()
            _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors) == (0, b"")
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 101
    loop.close()


@pytest.mark.processes
def test_as_a_process_it_says_why_it_cannot_start():
    loop = FakeLoop()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        process, link = start_process(loop, rig_config(port=taken.getsockname()[1]))
        with link:
            failed = json.loads(link.recv(1000))
            process.communicate(timeout=DEADLINE_S)
    assert failed["gateway"] == "failed"
    assert "cannot listen" in failed["why"]
    assert process.returncode == 1
    loop.close()
