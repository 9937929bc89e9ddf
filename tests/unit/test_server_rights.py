import asyncio
import os
import ssl
import subprocess
import sys

import pytest
from fake_loop import peer, rig_config, running

from seod.gateway.server import Server, ServerError, check_safe
from seod.protocol.jsonrpc import UNAUTHORISED

READ, COMMAND = "r" * 16, "c" * 16


@pytest.mark.parametrize(
    ("token", "may_read", "may_command"), [(None, False, False), (READ, True, False), (COMMAND, True, True)]
)
async def test_reading_and_commanding_are_separate_rights(token, may_read, may_command):
    async with running(read_token=READ, command_token=COMMAND) as run, peer(run) as client:
        if token is not None:
            assert await client.call("authenticate", token=token) == {
                "read": may_read,
                "command": may_command,
            }
        for method in ("info", "get", "status", "list"):
            answer = await client.call(method)
            assert (answer.get("code") != UNAUTHORISED) == may_read, method
        for method in ("start", "stop", "estop", "reset", "keepalive"):
            answer = await client.call(method)
            assert (answer.get("code") != UNAUTHORISED) == may_command, method
        assert bool(run.loop.taken) == may_command


async def test_with_a_read_token_only_nobody_commands():
    async with running(read_token=READ) as run, peer(run) as client:
        await client.call("authenticate", token=READ)
        assert (await client.call("start"))["code"] == UNAUTHORISED


async def test_wrong_tokens_end_the_connection(monkeypatch):
    monkeypatch.setattr("seod.gateway.lobby.AUTHENTICATE_S", 1e3)
    async with running(command_token=COMMAND) as run, peer(run) as client:
        for _ in range(5):
            assert (await client.call("authenticate", token="\ud800 wrong"))["message"] == "wrong token"
        with pytest.raises(EOFError):
            await client.read()


async def test_who_does_not_authenticate_in_time_is_not_kept(monkeypatch):
    monkeypatch.setattr("seod.gateway.lobby.AUTHENTICATE_S", 0.05)
    async with running(command_token=COMMAND) as run, peer(run) as client:
        with pytest.raises(EOFError):
            await client.read()
    async with running() as run, peer(run) as client:
        await asyncio.sleep(0.1)
        await client.call("info")


@pytest.mark.parametrize(
    ("server", "missing"),
    [
        ({"host": "0.0.0.0"}, "server.tls and server.command_token"),
        ({"host": "::", "command_token": COMMAND}, "server.tls"),
        ({"host": "example.org", "tls": {"certificate": "c", "key": "k"}}, "server.command_token"),
    ],
)
async def test_others_are_not_let_in_without_tls_and_token(server, missing):
    config = rig_config(**server).server
    with pytest.raises(ServerError, match=missing):
        await Server(config, None, None, None).start()


def test_loopback_needs_nothing():
    for host in ("127.0.0.1", "127.1.2.3", "::1", "localhost"):
        check_safe(rig_config(host=host).server)


async def test_a_taken_port_is_told():
    async with running() as run:
        with pytest.raises(ServerError, match=r"cannot listen on 127\.0\.0\.1 port .*another daemon"):
            await Server(rig_config(port=run.port).server, None, None, None).start()


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tls")
    words = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=localhost"
    files = [
        "-addext",
        "subjectAltName=IP:127.0.0.1",
        "-keyout",
        folder / "key.pem",
        "-out",
        folder / "cert.pem",
    ]
    subprocess.run(["openssl", *words.split(), *files], check=True, capture_output=True)
    return folder


@pytest.mark.slow
async def test_tls(certificate):
    tls = {"certificate": "cert.pem", "key": "key.pem"}
    async with running(tls=tls, base=certificate, command_token=COMMAND) as run:
        context = ssl.create_default_context(cafile=certificate / "cert.pem")
        async with peer(run, ssl=context) as client:
            await client.call("authenticate", token=COMMAND)
            await client.call("subscribe", topics=["sample"])
            run.loop.rows(1000)
            assert [(await client.until("sample"))["tick"] for _ in range(1000)] == list(range(1000))
        async with peer(run) as plain:
            with pytest.raises((EOFError, ConnectionError)):
                await plain.call("info")


async def seod_status(run, *options, **environment):
    """`seod status`, told where the daemon is by the environment: exit status and what it said."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "seod.cli", "status", *options),
        env=os.environ | {"SEOD_HOST": "127.0.0.1", "SEOD_PORT": str(run.port)} | environment,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    said, _ = await process.communicate()
    return process.returncode, said.decode()


@pytest.mark.slow
async def test_the_command_line_is_told_of_tls_and_takes_the_environment(certificate):
    tls = {"certificate": "cert.pem", "key": "key.pem"}
    async with running(tls=tls, base=certificate, command_token=COMMAND) as run:
        code, said = await seod_status(run, SEOD_TOKEN=COMMAND)
        assert (code, said) == (
            1,
            f"seod: 127.0.0.1:{run.port} wants TLS: --tls PEM names the certificate to trust\n",
        )
        pem = str(certificate / "cert.pem")
        code, said = await seod_status(run, "--tls", pem, SEOD_TOKEN=COMMAND)
        assert (code, "fake" in said) == (0, True), said
        code, said = await seod_status(run, "--tls", pem, SEOD_TOKEN="x" * 16)
        assert (code, "wrong token" in said) == (1, True), said


async def test_a_missing_certificate_is_told(tmp_path):
    config = rig_config(tls={"certificate": "no.pem", "key": "no.key"}).server
    with pytest.raises(ServerError, match=r"server\.tls: cannot use .*no\.pem"):
        await Server(config, tmp_path, None, None).start()
