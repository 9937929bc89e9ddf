"""A reader in a process of its own: its crash, its endless loop and its errors are sentences here."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

from seod.data import ReadError, apart
from seod.data.apart import Apart
from seod.data.guarded import Guarded
from seod.data.source import Block, Column, Group, Remark, Table
from seod.files.damage import DamagedError

GROUP = Group("", (Column("t", "s"), Column("y")), "t")
WANTED = {"": ["t", "y"]}


class Reader:
    """Gives one block of three rows, then does what it was told."""

    format, groups, notes = "own", (GROUP,), {"maker": "ACME"}

    def __init__(self, path, then):
        self.path, self.remarks, self._then = path, [], then

    def blocks(self, _wanted):
        self.remarks.append(Remark("unread", "z: is odd"))
        t = np.arange(3.0)
        yield Block(GROUP, {"t": t, "y": t**2}, np.arange(1, 4), 0.5)
        self._then()

    def close(self):
        """Nothing is open."""


def crashed():
    os.kill(os.getpid(), signal.SIGSEGV)


def endless():
    while True:
        pass


def asleep():
    time.sleep(1000.0)


def slow():
    while time.process_time() < 2.5:
        pass


def refuse():
    raise ReadError("run.own: row 4: is no number")


def fail():
    raise KeyError("block 7")


@pytest.fixture
def path(tmp_path):
    (tmp_path / "run.own").write_bytes(b"own" * 100)
    return tmp_path / "run.own"


def read(path, then):
    """Rows that were given, and the remarks."""
    source = Guarded(Apart(path, lambda: Reader(path, then), []), [])
    try:
        rows = sum(len(block.rows) for block in source.blocks(WANTED))
        return rows, [remark.message for remark in source.remarks]
    finally:
        source.close()


def test_blocks_remarks_and_notes_come_through(path):
    source = Apart(path, lambda: Reader(path, lambda: None), [])
    (block,) = source.blocks(WANTED)
    assert source.format == "own"
    assert source.groups == (GROUP,)
    assert block.values["y"].tolist() == [0.0, 1.0, 4.0]
    assert source.remarks == [Remark("unread", "z: is odd")]
    assert source.notes == {"maker": "ACME"}
    source.close()


def test_reading_may_be_left_and_begun_again(path):
    arrays = {"": {"t": np.arange(200_000.0), "y": np.zeros(200_000)}}
    source = Apart(path, lambda: Table(path, "own", (GROUP,), arrays), [])
    next(iter(source.blocks(WANTED)))
    assert sum(len(block.rows) for block in source.blocks(WANTED)) == 200_000
    source.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("then", "said"),
    [(crashed, "crashed (SIGSEGV)"), (endless, "found no end"), (fail, "KeyError: 'block 7'")],
)
def test_what_was_read_before_a_failure_stays(then, said, path, monkeypatch):
    monkeypatch.setattr(apart, "PATIENCE_S", 1)
    rows, remarks = read(path, then)
    assert rows == 3
    assert remarks[0] == "z: is odd"
    assert said in remarks[1]


def test_a_reader_that_stands_still_is_ended(path, monkeypatch):
    monkeypatch.setattr(apart, "STILL_S", 0.2)
    monkeypatch.setattr(apart, "_LOOK_S", 0.1)
    rows, remarks = read(path, asleep)
    assert rows == 3
    assert "stood still" in remarks[1]


@pytest.mark.slow
def test_a_reader_that_is_slow_is_waited_for(path, monkeypatch):
    monkeypatch.setattr(apart, "STILL_S", 1.5)
    assert read(path, slow) == (3, ["z: is odd"])


def test_an_error_of_the_reader_is_its_own(path):
    with pytest.raises(ReadError, match=r"run\.own: row 4: is no number"):
        read(path, refuse)


def test_a_reader_that_crashes_at_once_is_a_damaged_file(path):
    with pytest.raises(DamagedError, match="crashed"):
        Apart(path, crashed, [])


def test_what_the_library_complains_of_comes_through(path):
    complaints = ["of before"]

    def opened():
        complaints.append("length is odd")
        return Reader(path, lambda: None)

    source = Apart(path, opened, complaints)
    source.close()
    assert complaints == ["of before", "length is odd"]
