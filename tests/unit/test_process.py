"""What the supervisor hands to its children, and how it hears of them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from typing import TYPE_CHECKING

from seod.processes.handover import ChildArguments, read_memfd, receive_json, send_json, write_memfd
from seod.supervisor import child, sdnotify

if TYPE_CHECKING:
    import pytest


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
