"""What the supervisor hands to its children, and how it hears of them."""

from __future__ import annotations

import fcntl
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pytest

from seod.processes.handover import ChildArguments, read_memfd, receive_json, send_json, write_memfd
from seod.supervisor import child, sdnotify
from seod.supervisor import process as supervising
from seod.supervisor.say import say

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def arguments() -> ChildArguments:
    return ChildArguments(3, 4, 5, 6, 1, 1024, 1, None, "/etc/seod/rig.yaml")


def test_arguments_survive_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    command = arguments().command("seod.loop")
    assert command[:3] == [sys.executable, "-m", "seod.loop"]
    monkeypatch.setattr(sys, "argv", ["x", command[3]])
    assert ChildArguments.from_argv() == arguments()


def test_memfd_is_read_whole_whatever_its_position() -> None:
    fd = write_memfd("test", b"{}" * 10_000)
    os.lseek(fd, 7, os.SEEK_SET)
    assert read_memfd(fd) == b"{}" * 10_000
    os.close(fd)


def test_json_datagrams() -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there:
        assert receive_json(there) is None
        assert send_json(here, {"loop": "ready"})
        assert receive_json(there) == {"loop": "ready"}
        while send_json(here, {"fill": "x" * 1000}):  # nobody reads: refused instead of waiting
            pass
    gone, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    gone.close()
    with end:
        assert receive_json(end) == {}
        assert not send_json(end, {"anyone": "there"})


def test_notify_speaks_to_systemd(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(b"\0seod-test-notify-%d" % os.getpid())
        monkeypatch.setenv("NOTIFY_SOCKET", f"@seod-test-notify-{os.getpid()}")
        sdnotify.notify("READY=1\nSTATUS=running")
        assert listener.recv(100) == b"READY=1\nSTATUS=running"
    sdnotify.notify("WATCHDOG=1")  # systemd is gone: nothing happens
    monkeypatch.delenv("NOTIFY_SOCKET")
    sdnotify.notify("WATCHDOG=1")


def test_notify_speaks_to_a_socket_in_the_file_system_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        sdnotify.notify("STOPPING=1")
        assert listener.recv(100) == b"STOPPING=1"


def test_notify_never_waits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """systemd's queue is full: what is said is lost."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        for _ in range(2000):
            sdnotify.notify("WATCHDOG=1")
        count = 0
        while True:
            try:
                listener.recv(100)
            except BlockingIOError:
                break
            count += 1
        assert 0 < count < 2000


def test_what_is_said_is_a_line_on_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    say("the rig is at neutral")
    assert capfd.readouterr() == ("", "seod: the rig is at neutral\n")


def test_what_is_said_is_not_kept_back(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The process may be killed next."""
    with (tmp_path / "log").open("w", buffering=1 << 16) as log:
        monkeypatch.setattr(sys, "stderr", log)
        say("one")
        assert (tmp_path / "log").read_text() == "seod: one\n"


def test_the_module_ends_with_what_the_supervisor_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervising, "main", lambda: 5)
    with pytest.raises(SystemExit) as end:
        runpy.run_module("seod.supervisor", run_name="__main__")
    assert end.value.code == 5


def test_watchdog_is_fed_four_times_in_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    assert sdnotify.watchdog_interval() == 0.5
    monkeypatch.delenv("WATCHDOG_USEC")
    assert sdnotify.watchdog_interval() == float("inf")


def test_arguments_are_plain_json() -> None:
    assert json.loads(arguments().command("m")[3])["rows"] == 1024


def test_a_child_that_does_not_end_is_waited_for_and_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """While it is waited for the watchdog must be fed: it waits for less."""
    monkeypatch.setattr(child, "STOP_TIMEOUT_S", 0.2)
    monkeypatch.setattr(child, "LOOK_S", 0.05)
    stubborn = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True)"
    stubborn += "; time.sleep(60)"
    mine = child.Child.__new__(child.Child)
    mine.process = subprocess.Popen([sys.executable, "-c", stubborn], stdout=subprocess.PIPE)
    mine.pidfd = os.pidfd_open(mine.process.pid)
    mine.link, theirs = socket.socketpair()
    theirs.close()
    assert mine.process.stdout is not None
    mine.process.stdout.readline()
    fed: list[int] = []
    mine.end(lambda: fed.append(1))
    mine.process.stdout.close()
    assert len(fed) == 4
    assert mine.process.returncode == -9


# A child


HEAD = """
import json, os, signal, socket, sys
given = json.loads(sys.argv[1])
link = socket.socket(fileno=given["supervisor_fd"])
"""


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Starts a child that runs some Python instead of a module, with its end of the link as `link`."""
    made: list[child.Child] = []

    def start(code: str) -> child.Child:
        def command(self: ChildArguments, module: str) -> list[str]:
            return [sys.executable, "-c", HEAD + code, json.dumps({**asdict(self), "module": module})]

        monkeypatch.setattr(ChildArguments, "command", command)
        null = os.open("/dev/null", os.O_RDONLY)
        made.append(child.Child("seod.loop", ChildArguments(null, null, -1, 6, 1, 1024, 1, None, "rig.yaml")))
        os.close(null)
        return made[-1]

    yield start
    for each in made:
        if each.process.returncode is None:
            each.process.kill()
            each.process.wait()


@contextmanager
def nobodys_input() -> Iterator[None]:
    """Standard input that is a pipe, as where the daemon was started by a program."""
    before, (read, write) = os.dup(0), os.pipe()
    os.dup2(read, 0)
    try:
        yield
    finally:
        os.dup2(before, 0)
        for fd in (before, read, write):
            os.close(fd)


def said(link: socket.socket) -> Any:
    return json.loads(link.recv(1 << 16))


def test_a_child_has_its_end_of_the_link_no_input_and_a_session_of_its_own(run: Any) -> None:
    with nobodys_input():
        mine = run(
            "no_input = os.fstat(0).st_rdev == os.stat('/dev/null').st_rdev\n"
            "own = os.getsid(0) == os.getpid()\n"
            "link.send(json.dumps([given['module'], no_input, own, given['supervisor_pid']]).encode())"
        )
    assert (mine.ready, mine.failure) == (False, "")
    assert mine.link.type & ~socket.SOCK_NONBLOCK == socket.SOCK_SEQPACKET
    assert said(mine.link) == ["seod.loop", True, True, 6]
    assert mine.link.recv(100) == b"", "the other end is the child's alone"
    assert mine.end_of() == "ended with exit code 0"
    mine.close()
    assert mine.link.fileno() == -1
    with pytest.raises(OSError, match="Bad file descriptor"):
        fcntl.fcntl(mine.pidfd, fcntl.F_GETFD)


@pytest.mark.parametrize(
    ("code", "failure", "how"),
    [
        ("sys.exit(3)", "", "ended with exit code 3"),
        ("sys.exit(3)", "the port is taken", "the port is taken"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "", "killed by signal 9 (SIGKILL)"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "the port is taken", "killed by signal 15 (SIGTERM)"),
    ],
)
def test_how_a_child_ended_is_told(run: Any, code: str, failure: str, how: str) -> None:
    mine = run(code)
    mine.failure = failure
    assert mine.end_of() == how
    mine.signal(signal.SIGTERM)  # it is gone: nothing happens, whoever has its number now
    mine.close()


def test_a_child_that_ends_when_it_is_asked_to_is_not_killed(
    run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = run(
        "signal.signal(signal.SIGTERM, lambda *_: sys.exit(7)); link.send(b'1')\nwhile True: signal.pause()"
    )
    assert said(mine.link) == 1
    looks: list[int] = []
    signals: list[signal.Signals] = []
    send = mine.signal
    monkeypatch.setattr(mine, "signal", lambda number: signals.append(number) or send(number))
    mine.end(lambda: looks.append(1))
    assert signals == [signal.SIGTERM]
    assert mine.process.returncode == 7
    assert looks
    assert mine.link.fileno() == -1


def test_a_child_that_was_killed_has_been_waited_for(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = run("signal.signal(signal.SIGTERM, signal.SIG_IGN); link.send(b'1')\nwhile True: signal.pause()")
    assert said(mine.link) == 1
    monkeypatch.setattr(child, "STOP_TIMEOUT_S", 0.02)
    monkeypatch.setattr(child, "LOOK_S", 0.01)
    mine.end()
    assert mine.process.returncode == -9
