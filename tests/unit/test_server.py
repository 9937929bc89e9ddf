import asyncio
import json
import socket
from contextlib import AsyncExitStack
from types import SimpleNamespace

import pytest
from fake_loop import eventually, peer, running

from seod.gateway.connection import BACKLOG_BYTES, SEND_BUFFER_BYTES, Connection
from seod.gateway.lobby import PLACES
from seod.protocol.jsonrpc import BUSY, MAX_LINE, TOO_MANY_CLIENTS, UNAUTHORISED

COMMAND = "c" * 16

# ---- the protocol over a socket


async def test_requests_in_pieces_batches_and_garbage():
    async with running() as run, peer(run) as client:
        await client.send(b'{"jsonrpc":"2.0","id":"a","meth')
        await asyncio.sleep(0.01)
        await client.send(b'od":"get"}\r\n\r\n\x00\xff\n')
        replies = {reply["id"]: reply for reply in [await client.read(), await client.read()]}
        assert "result" in replies["a"]
        assert replies[None]["error"]["code"] == -32700
        batch = [
            {"jsonrpc": "2.0", "id": 1, "method": "get"},
            {"jsonrpc": "2.0", "method": "keepalive"},
            {"jsonrpc": "2.0", "id": 2, "method": "nonsense"},
            {"jsonrpc": "2.0", "id": 3, "method": "stop"},
        ]
        await client.send(json.dumps(batch).encode() + b"\n")
        replies = await client.read()
        assert [reply["id"] for reply in replies] == [1, 2, 3]
        assert "result" in replies[2]
        await client.send(b"x" * (MAX_LINE + 1) + b"\n")
        assert "longer than" in (await client.read())["error"]["message"]
        await client.send(b'{"jsonrpc":"2.0","method":"get"}\n{"jsonrpc":"2.0","id":9,"method":"get"}\n')
        assert (await client.read())["id"] == 9  # the notification before it got no reply


async def test_a_thousand_requests_at_once_are_all_answered():
    async with running() as run, peer(run) as client:
        lines = [
            b'{"jsonrpc":"2.0","id":%d,"method":"%s"}\n' % (k, (b"keepalive", b"get")[k % 2])
            for k in range(1000)
        ]
        client.writer.write(b"".join(lines))
        seen = {(await client.read())["id"] for _ in range(1000)}
    assert seen == set(range(1000))


async def test_a_client_that_goes_away_in_the_middle_leaves_nothing():
    async with running() as run:
        run.loop.silent = True
        async with peer(run) as client:
            await client.call("subscribe", topics=["sample", "event"])
            await client.send(b'{"jsonrpc":"2.0","id":1,"method":"start"}\n{"jsonrpc"')
            await eventually(lambda: run.loop.taken)
        await eventually(lambda: run.gateway.server.clients()["connected"] == 0)
        assert not run.gateway.hub._channels


# ---- many and slow clients


@pytest.mark.slow
async def test_a_client_that_never_reads_holds_up_nobody_and_costs_little():
    async with running() as run:
        stuck = socket.socket()
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stuck.setblocking(False)
        await asyncio.get_running_loop().sock_connect(stuck, ("127.0.0.1", run.port))
        subscribe = b'{"jsonrpc":"2.0","id":1,"method":"subscribe","params":{"topics":["sample"]}}\n'
        await asyncio.get_running_loop().sock_sendall(stuck, subscribe)
        async with peer(run) as quick:
            await quick.call("subscribe", topics=["sample"])
            (slow,) = [c for c in run.gateway.server._connections if run.gateway.hub.numbers(c) != [2]]
            ticks = []
            while run.gateway.hub.dropped(slow) < 1000:
                run.loop.rows(100)
                ticks += [(await quick.until("sample"))["tick"] for _ in range(100)]
            assert ticks == list(range(len(ticks)))  # the other one has them all
            assert slow._transport.get_write_buffer_size() < 2 * BACKLOG_BYTES
            assert (await quick.call("status"))["health"]["clients"]["dropped"].keys() == {slow.name}

            reader, writer = await asyncio.open_connection(sock=stuck, limit=1 << 22)
            told = None
            while told is None:  # it reads at last
                message = json.loads(await reader.readline())
                if message.get("method") == "lost":
                    told = message["params"]
            run.loop.row()
            after = json.loads(await reader.readline())
            assert after["params"]["tick"] >= told["total"]
            assert told["lost"] == told["total"] == run.gateway.hub.dropped(slow)
            writer.close()
            await writer.wait_closed()


@pytest.mark.slow
async def test_a_client_that_asks_without_reading_is_not_read_from():
    async with running() as run:
        reader, writer = await asyncio.open_connection("127.0.0.1", run.port, limit=1024)
        request = b'{"jsonrpc":"2.0","id":1,"method":"status"}\n'
        writer.write(request * (200 * SEND_BUFFER_BYTES // len(request)))
        with pytest.raises(TimeoutError):  # far more than all buffers between here and there hold
            await asyncio.wait_for(writer.drain(), 0.5)
        (connection,) = run.gateway.server._connections
        assert connection._transport.get_write_buffer_size() < 2 * BACKLOG_BYTES
        async with peer(run) as other:
            assert (await other.call("info"))["rig"] == "fake"
        writer.transport.abort()
        await asyncio.sleep(0)
        del reader


async def test_too_many_clients_are_told_so():
    async with running(max_clients=2) as run, peer(run) as first, peer(run) as second:
        await first.call("info")
        await second.call("info")
        async with peer(run) as third:
            error = await third.call("info")
            assert error["code"] == TOO_MANY_CLIENTS
            assert "server.max_clients is 2" in error["message"]
            with pytest.raises(EOFError):
                await third.read()
        await second.close()
        await eventually(lambda: run.gateway.server.clients()["connected"] == 1)
        async with peer(run) as fourth:
            await fourth.call("info")


async def test_an_estop_is_taken_from_a_client_too_many():
    async with running(max_clients=1, command_token=COMMAND) as run, peer(run) as first:
        await first.call("authenticate", token=COMMAND)
        async with peer(run) as second:
            await second.call("authenticate", token=COMMAND)
            assert await second.call("estop") == {"ok": True}
            assert (await second.call("reset"))["code"] == TOO_MANY_CLIENTS
        async with peer(run) as unknown:
            assert (await unknown.call("estop"))["code"] == UNAUTHORISED
    assert [command["op"] for command in run.loop.taken] == ["estop"]


async def test_who_says_nothing_takes_no_seat_and_the_oldest_leaves_first():
    async with running(max_clients=4, command_token=COMMAND) as run, AsyncExitStack() as stack:
        silent = [await stack.enter_async_context(peer(run)) for _ in range(PLACES)]
        clients = run.gateway.server.clients
        await eventually(lambda: clients()["waiting"] == PLACES)
        for number in range(4):
            client = await stack.enter_async_context(peer(run))
            assert (await client.call("authenticate", token=COMMAND))["command"]
            assert clients() == {
                "connected": number + 1,
                "waiting": PLACES - 1,
                "turned_away": 1,
                "dropped": {},
            }
        with pytest.raises((EOFError, ConnectionError)):
            await silent[0].read()
        await silent[1].call("list")  # is still there


async def test_the_computer_with_most_silent_connections_loses_them():
    async with running(command_token=COMMAND) as run:
        lobby = run.gateway.server._lobby
        crowd = [Newcomer("10.0.0.1") for _ in range(PLACES)]
        for newcomer in (Newcomer("10.0.0.2"), *crowd, Newcomer("10.0.0.3")):
            lobby.enter(newcomer)
        assert [newcomer.aborted for newcomer in crowd] == [True, True] + [False] * (PLACES - 2)
        for newcomer in list(lobby._waiting):
            newcomer.deadline.cancel()
            lobby.leave(newcomer)


class Newcomer:
    """As much of a connection as the lobby needs."""

    def __init__(self, host):
        self.host, self.aborted, self.deadline = host, False, None
        self.session = SimpleNamespace(may_read=False)

    def abort(self):
        self.aborted = True
        self.deadline.cancel()


async def test_subscriptions_are_not_without_end():
    async with running() as run, peer(run) as client:
        answers = [await client.call("subscribe", topics=["event"]) for _ in range(17)]
    assert answers[15].keys() == {"subscription"}
    assert answers[16]["code"] == BUSY


async def test_who_is_just_coming_in_when_the_daemon_ends_is_sent_away():
    async with running() as run:
        server = run.gateway.server
        await server.close()
        refused = server.admit(Connection(server))
        assert refused.message == "the daemon is ending"
        assert not server.clients()["connected"]
