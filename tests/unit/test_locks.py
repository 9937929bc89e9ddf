"""One daemon for a rig and for each actuator: locks that end with their owner, however that ends."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from drivers import driver_class
from seod.config.channels import output_channels
from seod.config.load import load_rig
from seod.files.shipped import configs_dir

if TYPE_CHECKING:
    from collections.abc import Iterator

TAKE = """
import sys
from seod.launch.locks import LockedError, lock_claims, lock_rig
try:
    lock_rig(sys.argv[1])
    lock_claims(sys.argv[2:])
except LockedError as error:
    sys.exit(str(error))
print("taken", flush=True)
sys.stdin.read()
"""
CLAIM = f"socketcan test{os.getpid()} id 0x201"


def take(rig: str, *claims: str, before: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    command = [*before, sys.executable, "-c", TAKE, f"{rig}{os.getpid()}", *claims]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@contextmanager
def holding(rig: str, *claims: str) -> Iterator[subprocess.Popen[str]]:
    process = take(rig, *claims)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "taken\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def outcome(process: subprocess.Popen[str]) -> str:
    """ "" if it got its locks, else why not."""
    out, error = process.communicate("")
    return "" if out == "taken\n" else error


def test_a_second_daemon_on_an_actuator_is_refused_by_name_whatever_its_rig_is_called() -> None:
    with holding("one", CLAIM) as first:
        assert f"{CLAIM} is commanded already by process {first.pid}" in outcome(take("two", CLAIM))
        assert outcome(take("two", f"{CLAIM}1")) == ""
        assert f"is run already by process {first.pid}" in outcome(take("one"))


def test_a_lock_is_free_once_its_owner_was_killed() -> None:
    with holding("one", CLAIM) as first:
        os.kill(first.pid, signal.SIGKILL)
        first.wait()
    assert outcome(take("two", CLAIM)) == ""


def test_names_longer_than_the_kernel_takes_are_locks_too() -> None:
    long = "slcan /dev/serial/by-id/" + "x" * 200 + " id 0x201"
    with holding("one", long):
        assert "is commanded already" in outcome(take("two", long))
        assert outcome(take("two", long + " extended")) == ""


@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("unshare"), reason="needs root and unshare")
def test_the_same_name_in_another_network_namespace_is_another_bus() -> None:
    with holding("one", CLAIM):
        assert outcome(take("one", CLAIM, before=("unshare", "--net"))) == ""


@pytest.mark.parametrize(
    ("name", "claims"),
    [
        ("can.yaml", {"socketcan vcan0 id 0x201"}),
        ("virtual.yaml", set()),
        ("arduino.yaml", {"serial port /tmp/seod-arduino"}),
    ],
)
def test_what_the_shipped_rigs_claim(name: str, claims: set[str]) -> None:
    config = load_rig(configs_dir() / name)
    kind = driver_class(config.driver["kind"])
    found = kind.claims(kind.Options.model_validate(config.driver), output_channels(config))
    assert set(found) == claims


def test_a_port_is_one_port_by_all_its_names(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to("/dev/null")
    kind = driver_class("serial")
    named = [
        kind.claims(kind.Options.model_construct(port=str(port)), [])  # type: ignore[attr-defined]
        for port in (link, Path("/dev/null"))
    ]
    assert named[0] == named[1]
