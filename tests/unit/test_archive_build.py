"""The catalogue: what is read again and what is not, and that a builder may end anywhere."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest
from archive_recordings import BEGAN, CLOCK, catalogue_of, estimate, fill, recording, report, ticks

from seod.api import diagnoses, identification
from seod.archive import build as build_module
from seod.archive import catalogue, lock
from seod.archive.build import build
from seod.archive.diagnosing import diagnose_left
from seod.archive.engines import ArchiveError, engine
from seod.archive.layout import FOLDER, LONGEST_S
from seod.archive.store import Store


@pytest.fixture
def folder(tmp_path):
    fill(tmp_path)
    return tmp_path


def column(folder, name, **wanted):
    return [
        row[name]
        for row in catalogue.rows(folder).to_pylist()
        if all(row[key] == value for key, value in wanted.items())
    ]


def test_all_segments_of_all_recordings_are_in_it(folder):
    built = build(folder)
    assert (built.files, built.read, built.gone, built.problems) == (12, 12, 0, {})
    assert len(catalogue.rows(folder)) == 36  # idle, excited, idle
    assert {path.split("/")[1] for path in catalogue_of(folder)} == {
        "day=2026-03-01",
        "day=2026-03-08",
        "day=2026-03-15",
    }
    assert catalogue.rows(folder, "rig2")["rig"].unique().to_pylist() == ["rig2"]
    late = catalogue.rows(folder, since=BEGAN.replace(day=10, tzinfo=None))
    assert late["file"].unique().to_pylist() == [f"rig{k}/2.mcap" for k in range(4)]


def test_what_is_known_is_not_read_again_and_gives_the_same_bytes(folder):
    build(folder)
    before = catalogue_of(folder)
    assert build(folder).read == 0
    assert catalogue_of(folder) == before
    shutil.rmtree(folder / FOLDER)
    build(folder)
    assert catalogue_of(folder) == before


def test_a_changed_recording_takes_the_place_of_its_old_rows(folder):
    build(folder)
    later = BEGAN.replace(day=20)
    (folder / "rig0/0.mcap").write_bytes(recording("rig0", notes=[estimate(0.5, omega_n=77.0)], began=later))
    assert build(folder).read == 1
    assert column(folder, "omega_n", file="rig0/0.mcap", quality="ok") == [77.0]
    assert len(catalogue.rows(folder)) == 36
    assert {str(day) for day in column(folder, "day", file="rig0/0.mcap")} == {"2026-03-20"}


def test_a_day_that_has_no_recording_any_more_has_no_file(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(recording())
    build(tmp_path)
    path.write_bytes(recording(began=BEGAN.replace(day=20), notes=[estimate(0.5)]))
    build(tmp_path)
    assert [name.split("/")[1] for name in catalogue_of(tmp_path)] == ["day=2026-03-20"]


def test_a_recording_that_is_gone_is_kept_and_marked_until_it_is_back(folder):
    build(folder)
    content = (folder / "rig3/1.mcap").read_bytes()
    (folder / "rig3/1.mcap").unlink()
    assert build(folder).gone == 1
    assert set(column(folder, "gone", file="rig3/1.mcap")) == {True}
    assert set(column(folder, "gone", file="rig3/0.mcap")) == {False}
    before = catalogue_of(folder)
    build(folder)
    assert catalogue_of(folder) == before
    (folder / "rig3/1.mcap").write_bytes(content)
    assert build(folder).gone == 0
    assert set(column(folder, "gone", file="rig3/1.mcap")) == {False}
    assert len(catalogue.rows(folder)) == 36


def test_torn_and_foreign_files_are_told_and_stop_nothing(folder):
    (folder / "torn.mcap").write_bytes(recording()[:1000])
    (folder / "foreign.mcap").write_bytes(b"something else")
    built = build(folder)
    assert built.read == 14
    assert set(built.problems) == {"torn.mcap", "foreign.mcap"}
    assert column(folder, "problem", file="foreign.mcap") == [built.problems["foreign.mcap"]]
    assert column(folder, "day", file="foreign.mcap") == [None]
    assert build(folder).problems == {}  # told once; the column keeps it


def test_a_file_that_cannot_be_opened_is_told_and_tried_again(folder, monkeypatch):
    opened = Store.open

    def failing(self, known):
        if known.name == "rig0/0.mcap":
            raise PermissionError(13, "Permission denied")
        return opened(self, known)

    monkeypatch.setattr(Store, "open", failing)
    assert build(folder).problems == {"rig0/0.mcap": "cannot be read: Permission denied"}
    monkeypatch.undo()
    assert build(folder).read == 1
    assert len(catalogue.rows(folder)) == 36


def test_reports_beside_a_recording_give_verdict_and_causes(folder):
    build(folder)
    (folder / "rig0/0.diagnosis.json").write_text(report())
    (folder / "rig1/0").mkdir()
    (folder / "rig1/0/diagnosis.json").write_text(report("backlash"))
    (folder / "rig2/0.motor.diagnosis.json").write_text(report("valve_lag"))
    (folder / "rig2/1.other.diagnosis.json").write_text(report())
    (folder / "rig3/0.diagnosis.json").write_text("[]")
    built = build(folder)
    assert built.read == 5
    assert set(built.problems) == {"rig3/0.mcap"}
    assert set(column(folder, "verdict", file="rig0/0.mcap")) == {"effects"}
    assert "backlash" in column(folder, "causes", file="rig1/0.mcap")[0]
    assert "valve_lag" in column(folder, "causes", file="rig2/0.mcap")[0]
    assert column(folder, "verdict", file="rig2/1.mcap") == [None] * 3
    (folder / "rig0/0.diagnosis.json").unlink()
    assert build(folder).read == 1
    assert set(column(folder, "verdict", file="rig0/0.mcap")) == {None}


class Killed(BaseException):
    """As SIGKILL: nothing of ours runs after it, but this process goes on."""


def steps(folder, monkeypatch, at):
    """A build that ends before the step `at` of those that change the store; returns how many there were."""
    count = 0

    def counted(function):
        def step(self, *args):
            nonlocal count
            count += 1
            if count == at:
                raise Killed
            return function(self, *args)

        return step

    with monkeypatch.context() as patch:
        patch.setattr(Store, "write", counted(Store.write))
        patch.setattr(Store, "remove", counted(Store.remove))
        patch.setattr(build_module, "BATCH", 5)
        with contextlib.suppress(Killed):
            build(folder)
    return count


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False], ids=["first build", "later build"])
def test_a_builder_that_ends_at_any_step_costs_nothing(folder, monkeypatch, tmp_path_factory, first):
    """Ended before each write and removal; the later build meets a changed, a moved and a gone recording."""
    build(folder)
    old = tmp_path_factory.mktemp("old") / "a"
    shutil.copytree(folder, old)
    if not first:
        moved = recording("rig0", notes=[estimate(0.4)], began=BEGAN.replace(day=20))
        (folder / "rig0/0.mcap").write_bytes(moved)
        (folder / "rig0/1.mcap").write_bytes(recording("rig0", rows=ticks("XXXX")))
        (folder / "rig2/2.mcap").unlink()
        build(folder)
    right = catalogue_of(folder)
    at = 0
    while True:
        at += 1
        shutil.rmtree(folder / FOLDER)
        if not first:
            shutil.copytree(old / FOLDER, folder / FOLDER)
        done = steps(folder, monkeypatch, at)
        assert catalogue_rows_or_none(folder) != 0
        build(folder)
        assert catalogue_of(folder) == right, at
        if done < at:
            break
    assert at > 7


def catalogue_rows_or_none(folder):
    try:
        return len(catalogue.rows(folder))
    except ArchiveError:
        return None


def test_what_a_killed_builder_was_writing_is_taken_away(folder):
    build(folder)
    left = folder / FOLDER / "day=2026-03-01" / "segments.parquet.unfinished"
    left.write_bytes(b"half")
    other = folder / "rig0" / "mine.unfinished"
    other.write_bytes(b"not the archive's")
    build(folder)
    assert not left.exists()
    assert other.exists()


def test_two_builders_at_once_are_told(folder):
    with lock.held(Store(folder)), pytest.raises(ArchiveError, match="another process builds"):
        build(folder)
    build(folder)


def test_a_note_in_a_store_without_locks_ends_with_its_renewal(monkeypatch):
    store = Store("memory://notes")
    with lock.held(store), pytest.raises(ArchiveError, match=f"process {os.getpid()} on"), lock.held(store):
        pass
    store.write(lock.NAME, b'{"who": "a dead one", "time": 1.0}')
    with lock.held(store):
        pass
    assert store.files(".lock", FOLDER) == []
    monkeypatch.setattr(lock, "RENEW_S", 0.0)
    with lock.held(store) as renew:
        before = store.read(lock.NAME)
        renew()
        assert store.read(lock.NAME) != before


def test_a_store_in_memory_gives_the_same_catalogue(folder):
    build(folder)
    store = Store("memory://archive")
    for path in folder.rglob("*.mcap"):
        store.write(str(path.relative_to(folder)), path.read_bytes())
    build("memory://archive")
    here, there = (catalogue.rows(where).drop_columns(["stamp"]) for where in (folder, "memory://archive"))
    assert there.equals(here)
    assert build("memory://archive").read == 0
    store.write("rig0/0.mcap", recording("rig0", rows=ticks("XX")))
    assert build("memory://archive").read == 1
    assert build(f"file://{folder}").read == 0


READ_ALONE = """
import sys
from pathlib import Path
from seod.archive.parquet import from_bytes
import pyarrow.parquet
threads = lambda: len(list(Path("/proc/self/task").iterdir()))
content, before = Path(sys.argv[1]).read_bytes(), threads()
assert from_bytes(content, ["file", "stamp"]).num_rows > 0
print(threads() - before)
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted where Linux lists them")
def test_a_days_file_is_read_without_threads_that_could_outlive_python(folder):
    build(folder)
    words = [sys.executable, "-c", READ_ALONE, str(next(folder.rglob("segments.parquet")))]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout == "0\n"


def test_files_of_an_object_store_are_there_for_a_time():
    store = Store("memory://for_a_time")
    store.write("day=2026-03-01/a [1].bin", b"whole")
    with store.here(["day=2026-03-01/a [1].bin"]) as here:
        copy = Path(here, "day=2026-03-01/a [1].bin")
        assert copy.read_bytes() == b"whole"
    assert not copy.exists()
    with pytest.raises(ArchiveError, match="memory://for_a_time"), store.here(["nowhere.bin"]):
        pass


def test_what_is_wrong_with_an_archive_is_told(tmp_path):
    with pytest.raises(ArchiveError, match="no such folder"):
        build(tmp_path / "nowhere")
    with pytest.raises(ArchiveError, match="has no catalogue yet: `seod archive "):
        catalogue.rows(tmp_path)
    with pytest.raises(ArchiveError, match="nosuch://"):
        build("nosuch://bucket")
    with pytest.raises(ArchiveError, match=r"pip install 'seod\[archive\]'"):
        engine("no_such_library_at_all")


def test_other_engines_read_the_files_as_they_are(folder):
    build(folder)
    with duckdb.connect() as connection:
        connection.execute(f"SELECT count(*), min(day) FROM '{folder}/catalogue/**/*.parquet'")
        found = connection.fetchone()
    assert (found[0], str(found[1])) == (36, "2026-03-01")
    assert LONGEST_S > 0


class Answered:
    """An answer of the diagnosis."""

    def to_dict(self):
        return json.loads(report("backlash"))


def test_what_has_left_its_model_is_diagnosed_once(folder, monkeypatch):
    asked = []

    def diagnose(path, axis, effort):
        asked.append((path.name, axis, effort))
        if path.name == "2.mcap":
            raise ValueError("tells nothing")
        return Answered()

    monkeypatch.setattr(diagnoses, "diagnose", diagnose)
    build(folder)
    assert diagnose_left(folder, lambda _step, _part: None) == {"rig1/2.mcap": "tells nothing"}
    assert asked == [("1.mcap", "motor", "quick"), ("2.mcap", "motor", "quick")]
    assert build(folder).read == 1
    assert "backlash" in column(folder, "causes", file="rig1/1.mcap")[0]
    diagnose_left(folder, lambda _step, _part: None)
    assert len(asked) == 3  # the one that told nothing is asked again


def test_an_excited_segment_without_an_estimate_is_identified(tmp_path, monkeypatch):
    asked = []

    def identify(path, axis, between, output):
        asked.append((path.name, axis, between, output))
        raise ValueError("tells nothing")

    monkeypatch.setattr(identification, "identify", identify)
    (tmp_path / "a.mcap").write_bytes(recording(rows=ticks("--" + 15 * "X" + "-XXX")))
    (tmp_path / "b.mcap").write_bytes(recording(rows=ticks(20 * "X"), notes=[estimate(0.5, "noisy")]))
    build(tmp_path)
    ((name, axis, between, output),) = asked  # one has an estimate, one is too short
    assert (name, axis, output) == ("a.mcap", "motor", "position")
    assert between == pytest.approx((CLOCK + 0.2, CLOCK + 1.6))
    assert column(tmp_path, "quality", file="a.mcap", part=2) == ["no_oscillation"]
    assert column(tmp_path, "quality", file="a.mcap", part=1) == [None]
