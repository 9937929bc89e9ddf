import asyncio
import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from fake_loop import eventually, running
from typer import BadParameter

from seod import __version__
from seod.cli import app
from seod.commands.over_tcp import read_assignments
from seod.files.shipped import configs_dir
from seod.terminal import text
from tests.command_line import CliRunner

VIRTUAL = configs_dir() / "virtual.yaml"


def invoke(*words):
    """Exit code, stdout, stderr of a command in this process."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


async def on(run, *words):
    return await asyncio.to_thread(invoke, *words, "--port", run.port)


async def test_commands_reach_the_rig():
    async with running(("pitch", "roll")) as run:
        assert await on(run, "set", "roll", "e_a=1.5", "bias=-0.1", "method=peaks") == (
            0,
            "e_a = 1.5 V, hysteresis = 0.004 rad, bias = -0.1 V, two_phase = false, K_L = 17 rad/s/V, "
            "method = peaks\n",
            "",
        )
        assert (await on(run, "start", "roll"))[0] == 0
        assert (await on(run, "stop"))[0] == 0
        assert (await on(run, "estop"))[0] == 0
        assert (await on(run, "reset"))[0] == 0
        assert (await on(run, "reset", "roll"))[0] == 0
        told = [(command["op"], command["axis"]) for command in run.loop.taken]
        assert told[:4] == [("set", 1), ("start", 1), ("stop", None), ("estop", None)]
        assert told[4:] == [("reset", None), ("reset", 1)]


@pytest.mark.slow
async def test_answers_for_people_and_for_programs():
    async with running() as run:
        run.loop.rows(1000)
        run.loop.fault("motor: too far")
        await eventually(lambda: run.rig.axes["motor"].fault)
        code, out, _ = await on(run, "get", "motor")
        assert code == 0
        assert out.startswith("motor: fault\n  fault: motor: too far\n  settings: e_a = 0.5 V,")
        _, out, _ = await on(run, "get", "--json")
        assert json.loads(out)["fault"]["code"] == "travel"
        _, out, _ = await on(run, "status")
        assert "fake: fault, driver virtual, 2000 Hz" in out
        assert "truth of motor: K_L = 17 rad/s/V, omega_n = 117 rad/s, zeta = 0.21" in out
        assert "not real-time: this is a test" in out
        _, out, _ = await on(run, "status", "--json")
        assert json.loads(out)["rig"] == "fake"


@pytest.mark.slow
async def test_watch_ends_after_so_many_estimates():
    async with running() as run:
        watching = asyncio.create_task(on(run, "watch", "--count", "2", "--for", "20"))
        await eventually(lambda: run.gateway.hub.wanted("estimate"))
        run.loop.rows(1000)
        code, out, _ = await watching
    assert (code, len(out.splitlines())) == (0, 2)


async def test_refusals_are_sentences_on_stderr_and_exit_code_1():
    async with running() as run:
        code, out, err = await on(run, "set", "e_a=50")
        assert (code, out) == (1, "")
        assert err == "seod: e_a: e_a + |bias| = 50 V is over limits.output = 2 V of axis motor\n"


def test_no_daemon():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    code, _, err = invoke("status", "--port", port)
    assert code == 1
    assert "start one with `seod run CONFIG`" in err


@pytest.mark.parametrize(
    "words",
    [["set"], ["set", "motor", "e_a"], ["status", "--port", "0"], ["nonsense"], ["watch", "--count", "0"]],
)
def test_wrong_usage_is_exit_code_2(words):
    code, _, err = invoke(*words)
    assert code == 2
    assert "Usage" in err


def test_assignments():
    assert read_assignments(["e_a=1.5"]) == (None, {"e_a": 1.5})
    assert read_assignments(["roll", "K_L=17", "method=exact"]) == ("roll", {"K_L": 17.0, "method": "exact"})
    assert read_assignments(["reference=70", "trim=false"]) == (None, {"reference": 70.0, "trim": False})
    with pytest.raises(BadParameter, match=r"'1\.5' is not NAME=VALUE"):
        read_assignments(["roll", "e_a=2", "1.5"])


def test_version():
    assert invoke("--version") == (0, f"seod {__version__}, protocol 1\n", "")


def with_a_reader_that_leaves(*words, lines):
    """Exit code and stderr of `seod ARGS | head -n LINES`."""
    command = [sys.executable, "-m", "seod.cli", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        for _ in range(lines):
            assert process.stdout.readline()
        process.stdout.close()
        told = process.stderr.read()
    return process.returncode, told


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["watch", "--help"], ["check", VIRTUAL]])
def test_a_reader_that_leaves_ends_a_command_without_a_word(words):
    assert with_a_reader_that_leaves(*words, lines=0) == (-signal.SIGPIPE, "")


@pytest.mark.slow
async def test_a_reader_that_leaves_ends_watch_without_a_word():
    async with running() as run:
        words = ["watch", "--rate", "1000", "--port", run.port]
        ended = asyncio.create_task(asyncio.to_thread(with_a_reader_that_leaves, *words, lines=1))
        while not ended.done():
            run.loop.rows(100)
            await asyncio.sleep(0.02)
    assert await ended == (-signal.SIGPIPE, "")


@pytest.mark.parametrize("words", [["--version"], ["watch", "--help"]])
def test_an_output_that_is_full_is_told_by_all_that_print(words):
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "seod.cli", *words]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "seod: standard output: No space left on device\n")


def test_check_says_what_is_wrong_with_file_and_line(tmp_path):
    good = configs_dir() / "virtual.yaml"
    assert invoke("check", good)[0] == 0
    bad = tmp_path / "bad.yaml"
    bad.write_text(good.read_text().replace("rate_hz: 2000", "rate_hz: 20"))
    code, out, err = invoke("check", bad)
    assert (code, out) == (1, "")
    assert err.startswith(f"{bad}:")
    assert "rate_hz" in err
    code, _, err = invoke("run", tmp_path / "missing.yaml")
    assert code == 78  # EX_CONFIG: systemd does not start it again
    assert "missing.yaml" in err


def test_rig_is_only_for_simulated_rigs_on_a_bus():
    code, _, err = invoke("rig", configs_dir() / "virtual.yaml")
    assert code == 1
    assert "`seod rig` needs can or serial" in err


def test_attending_needs_a_port_that_is_known(tmp_path):
    config = tmp_path / "rig.yaml"
    config.write_text(
        (configs_dir() / "virtual.yaml").read_text().replace("port: 7600", "port: 0\n  panel: false")
    )
    code, _, err = invoke("run", config, "--watch")
    assert code == 1
    assert "need a fixed port" in err


def test_a_client_command_imports_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'pydantic', 'yaml', 'can', 'cantools', 'rich'}"
    code = f"import sys, seod.cli, seod.terminal.text; print(sorted({heavy} & sys.modules.keys()))"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        == "[]\n"
    )


def test_every_command_of_this_version_is_there():
    code, out, _ = invoke("--help")
    assert code == 0
    named = set(re.findall(r"^  (\w+)  ", out.partition("Commands:")[2], re.MULTILINE))
    over_tcp = {"status", "watch", "get", "set", "start", "stop", "estop", "reset", "ramp"}
    assert (
        named
        == {
            "run",
            "rig",
            "neutral",
            "paper",
            "upgrade",
            "check",
            "latency",
            "calibrate",
            "diagnose",
            "scrub",
            "simulate",
            "info",
            "export",
            "identify",
            "response",
            "report",
            "archive",
            "batch",
            "fleet",
            "init",
        }
        | over_tcp
    )


def test_settings_in_words():
    told = text.settings({"e_a": 1.5, "K_L": None, "trim": True, "method": "exact"})
    assert told == "e_a = 1.5, K_L = -, trim = true, method = exact"
