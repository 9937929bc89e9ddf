"""Real daemons with tokens: no recording shows one, and clients and daemons find them where they are kept."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from zstandard import ZstdDecompressor

from tests.peers import SEOD, Program, Rpc, RpcError, port_of, port_open, until, write_rig_file

pytestmark = pytest.mark.processes

READ, COMMAND = "r34d-Nbq7XkZs1vLw", "c0mm4nd-Yt5RmPd2hGe"


def all_bytes(path: Path) -> bytes:
    """A recording as it is, and the content of its chunks unpacked."""
    data = path.read_bytes()
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                data += ZstdDecompressor().decompress(record.data, record.uncompressed_size)
    return data


def client(port: int) -> Rpc:
    until("the port", lambda: port_open(port))
    return Rpc(port)


def run_for_a_while(rig_file: Path, recording: Path) -> None:
    """Start, stop, ask for everything, give wrong tokens, and end."""
    program = Program(rig_file.with_suffix(".log"), "run", rig_file, "--record", recording)
    try:
        rpc = client(port_of(rig_file))
        for wrong in ("wrong", COMMAND + "!"):
            with pytest.raises(RpcError, match="wrong token"):
                rpc.call("authenticate", token=wrong)
        rpc.call("authenticate", token=COMMAND)
        until("some rows", lambda: rpc.call("status")["health"]["ticks"] > 500)
        rpc.call("start")
        answers = [rpc.call(method) for method in ("info", "list", "status", "get")]
        rpc.call("stop")
        rpc.close()
    finally:
        program.stop()
    for text in (json.dumps(answers), program.said()):
        assert READ not in text
        assert COMMAND not in text


@pytest.mark.parametrize("name", ["a.mcap", "a.csv"])
def test_a_recording_shows_no_token(name: str, tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path)
    tokens = f"server:\n  read_token: {READ}\n  command_token: '{COMMAND}'  # was {COMMAND}\n"
    rig_file.write_text(rig_file.read_text().replace("server:\n", tokens))
    run_for_a_while(rig_file, tmp_path / name)
    data = all_bytes(tmp_path / name) if name == "a.mcap" else (tmp_path / name).read_bytes()
    assert b"rig.json" in data or name == "a.csv"
    assert len(data) > 10_000
    assert READ.encode() not in data
    assert COMMAND.encode() not in data
    assert (tmp_path / name).stat().st_mode & 0o137 == 0


def test_tokens_by_file_and_by_environment(tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path)
    rig_file.write_text(rig_file.read_text().replace("server:\n", "server:\n  command_token_file: token\n"))
    token = tmp_path / "token"
    token.write_text(COMMAND + "\n")
    token.chmod(0o600)
    port = str(port_of(rig_file))

    def seod(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [SEOD, *words, "--port", port],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )

    program = Program(tmp_path / "log", "run", rig_file)
    try:
        rpc = client(int(port))
        with pytest.raises(RpcError, match="authenticate first"):
            rpc.call("status")
        rpc.close()
        assert "authenticate" in seod("estop").stderr
        assert seod("status", "--token-file", str(token)).returncode == 0
        assert seod("status", SEOD_TOKEN_FILE=str(token)).returncode == 0
        assert seod("estop", SEOD_TOKEN=COMMAND).returncode == 0
        for pid in (program.pid, *children(program.pid)):
            assert COMMAND not in shown(pid)
    finally:
        program.stop()


def test_the_environments_token_does_not_stay_in_the_daemons_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig_file = write_rig_file(tmp_path)
    monkeypatch.setenv("SEOD_COMMAND_TOKEN", COMMAND)
    program = Program(tmp_path / "log", "run", rig_file)
    try:
        rpc = client(port_of(rig_file))
        with pytest.raises(RpcError, match="authenticate first"):
            rpc.call("status")
        assert rpc.call("authenticate", token=COMMAND) == {"read": True, "command": True}
        rpc.close()
        for pid in (program.pid, *children(program.pid)):
            assert COMMAND not in shown(pid)
    finally:
        program.stop()


def test_a_daemon_whose_token_others_can_read_does_not_start(tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path)
    rig_file.write_text(rig_file.read_text().replace("server:\n", "server:\n  read_token_file: token\n"))
    (tmp_path / "token").write_text(READ)
    (tmp_path / "token").chmod(0o644)
    done = subprocess.run([SEOD, "run", rig_file], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "token: can be read by everyone (mode 0644)" in done.stderr
    assert READ not in done.stderr


def children(pid: int) -> list[int]:
    """Processes that this one has started."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def shown(pid: int) -> str:
    """What `ps` shows of a process, and its environment."""
    return "".join(Path(f"/proc/{pid}/{name}").read_text(errors="replace") for name in ("cmdline", "environ"))
