import asyncio
import io
import socket
import threading

import pytest
from fake_loop import blocking, eventually, running
from rich.console import Console

from seod.client import Client, ClientError, EndedError, RequestError, UnreachableError
from seod.processes.ring import AxisState
from seod.terminal import text
from seod.terminal.live_view import Board, watch

TOKEN = "t" * 16


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@pytest.mark.slow
async def test_the_readmes_five_lines():
    async with running() as run:

        def five_lines():
            seen = []
            with blocking(run) as rig:
                rig.start()
                run.loop.rows(1000)
                for e in rig.estimates():
                    seen.append((e["zeta"], e["omega_n"]))
                    if len(seen) == 3:
                        break
            return seen

        assert len(await asyncio.to_thread(five_lines)) == 3
        assert [command["op"] for command in run.loop.taken] == ["start"]


async def test_each_method_has_its_call():
    async with running(("pitch", "roll")) as run:

        def calls():
            with blocking(run) as rig:
                assert rig.info()["axes"] == ["pitch", "roll"]
                assert rig.status()["state"] == "idle"
                assert rig.get("roll")["axis"] == "roll"
                assert rig.set("roll", e_a=1.0, method="peaks")["settings"]["method"] == "peaks"
                for call in (rig.start, rig.stop):
                    call("roll")
                rig.estop()
                rig.reset()
                rig.keepalive()
                number = rig.subscribe(["sample"], ["pitch"], 100.0)
                run.loop.rows(3)
                message = next(rig.notifications())
                assert (message["method"], message["params"]["axis"]) == ("sample", "pitch")
                rig.unsubscribe(number)
                assert list(rig.notifications(0.05)) == []
                # before it hangs up: whoever kept the rig alive lets it go then
                return [command["op"] for command in run.loop.taken]

        ops = ["set", "start", "stop", "estop", "reset", "keepalive"]
        assert await asyncio.to_thread(calls) == ops


async def test_refusals_are_errors_with_the_daemons_reason():
    async with running(command_token=TOKEN) as run:

        def calls():
            with blocking(run) as rig, pytest.raises(RequestError, match="authenticate first"):
                rig.info()
            with pytest.raises(RequestError, match="wrong token"):
                blocking(run, token="x" * 16)
            with (
                blocking(run, token=TOKEN) as rig,
                pytest.raises(RequestError, match="limits") as error,
            ):
                rig.set(e_a=100.0)
            assert error.value.code == -32602

        await asyncio.to_thread(calls)


async def test_the_end_of_the_daemon_is_told():
    async with running() as run:
        client = await asyncio.to_thread(blocking, run)
        await asyncio.to_thread(client.info)
    with client, pytest.raises(EndedError, match="has ended the connection"):
        await asyncio.to_thread(lambda: list(client.notifications()))


async def test_one_client_too_many_is_told_why():
    async with running(max_clients=1) as run:

        def calls():
            with blocking(run) as first, blocking(run) as second:
                first.info()
                with pytest.raises((RequestError, EndedError)) as error:
                    second.info()
            return str(error.value)

        assert "max_clients" in await asyncio.to_thread(calls)


def test_nobody_there():
    port = free_port()
    with pytest.raises(UnreachableError, match=f"127.0.0.1:{port}; start one with `seod run CONFIG`"):
        Client(port=port)
    with pytest.raises(UnreachableError, match="cannot reach no"):
        Client("no.such.host.invalid")


def test_a_daemon_that_comes_up_is_waited_for():
    port = free_port()
    opened = []
    thread = threading.Timer(0.2, lambda: opened.append(socket.create_server(("127.0.0.1", port))))
    thread.start()
    Client(port=port, wait=20.0).close()
    thread.join()
    opened[0].close()


def test_no_answer_in_time_is_told():
    with socket.create_server(("127.0.0.1", 0)) as mute:
        client = Client(port=mute.getsockname()[1], timeout=0.05)
        with client, pytest.raises(ClientError, match="did not answer 'info' within"):
            client.info()


# ---- what people see


class Terminal(io.StringIO):
    def isatty(self):
        return True


async def watched(run, out, count, before):
    """What `watch` writes while the fake loop does `before` and then brings estimates."""

    def show():
        with blocking(run) as client:
            watch(client, 20.0, count, out)

    async def excite():
        await eventually(lambda: all(map(run.gateway.hub.wanted, ("estimate", "event"))))
        before()
        run.loop.rows(2000)

    await asyncio.gather(asyncio.to_thread(show), excite())
    return out.getvalue()


@pytest.mark.slow
async def test_watch_writes_lines_where_there_is_no_terminal():
    async with running() as run:
        shown = await watched(run, io.StringIO(), 3, lambda: run.loop.become(AxisState.EXCITING))
    lines = shown.splitlines()
    assert lines[0] == "motor: idle -> exciting (test)"
    assert len(lines) == 4
    assert all("motor  " in line and "omega_n=" in line for line in lines[1:])


@pytest.mark.slow
async def test_watch_draws_a_table_in_a_terminal():
    async with running() as run:
        shown = await watched(run, Terminal(), 5, lambda: run.loop.become(AxisState.EXCITING))
    assert "exciting" in shown
    assert "true zeta" in shown
    assert "omega_n [rad/s]" in shown  # brackets are no markup


async def test_watch_ends_after_its_time():
    async with running() as run:
        await asyncio.to_thread(lambda: watch(blocking_closed(run), 0.05, None, io.StringIO()))


def blocking_closed(run):
    client = blocking(run)
    notifications = client.notifications

    def then_close(timeout):
        yield from notifications(timeout)
        client.close()

    client.notifications = then_close
    return client


@pytest.mark.slow
async def test_the_board_follows_events_and_tells_ages_and_faults():
    async with running() as run:
        run.loop.rows(1000)
        client = await asyncio.to_thread(blocking, run)
        with client:
            while (status := await asyncio.to_thread(client.status))["axes"]["motor"]["estimate"] is None:
                pass
    age = status["axes"]["motor"]["estimate"]["age_s"]
    board = Board(status, 50.0)

    def drawn(now):
        console = Console(file=io.StringIO(), width=200)
        console.print(board.render(now))
        return console.file.getvalue()

    assert f"{age + 2.0:.1f}" in drawn(52.0)
    board.take(
        {"method": "event", "params": {"event": "changed", "axis": "motor", "values": {"e_a": 1.75}}}, 52.0
    )
    assert "1.75" in drawn(52.0)
    fault = {"event": "fault", "axis": None, "code": "link", "why": "the bus is gone", "numbers": {}}
    board.take({"method": "event", "params": fault}, 53.0)
    assert "fault: the bus is gone" in drawn(53.0)
    state = {"event": "state", "axis": "motor", "state": "idle", "previous": "fault", "why": "reset"}
    board.take({"method": "event", "params": state}, 54.0)
    assert "fault -> idle" in drawn(54.0)
    assert board.axes["motor"]["fault"] is None


async def test_the_board_of_several_axes_shows_which_one_is_in_fault():
    async with running(("pitch", "roll")) as run, asyncio.timeout(20):
        client = await asyncio.to_thread(blocking, run)
        with client:
            board = Board(await asyncio.to_thread(client.status), 0.0)
    fault = {"event": "fault", "axis": "roll", "latched": ["roll"], "code": "travel", "why": "roll: too far"}
    board.take({"method": "event", "params": fault}, 1.0)
    assert [axis["state"] for axis in board.axes.values()] == ["idle", "fault"]
    console = Console(file=io.StringIO(), width=80)
    console.print(board.render(1.0))
    assert "pitch" in console.file.getvalue()
    assert "fault: roll: too far" in console.file.getvalue()


def test_numbers_for_people():
    assert text.with_sd(0.210341, 0.00041) == "0.21034 ± 0.00041"
    assert text.with_sd(117.0312, 0.24) == "117.03 ± 0.24"
    assert text.with_sd(117.0312, 31.4) == "117 ± 31"
    assert text.with_sd(0.21, None) == text.with_sd(0.21, 0.0) == "0.21"
    assert text.with_sd(None, None) == "-"
    assert text.settings({"e_a": 1.5, "method": "exact"}) == "e_a = 1.5, method = exact"
