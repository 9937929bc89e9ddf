"""What a fleet's listener kept, in the catalogue: its days as Parquet, asked in SQL beside the segments."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest
from archive_recordings import catalogue_of, fill

from seod.archive import live
from seod.archive.build import build
from seod.archive.engines import ArchiveError
from seod.archive.sql import ask
from seod.archive.store import Store
from seod.fleet.board import Heard, Rig
from seod.fleet.day_files import DayFiles
from seod.fleet.topics import Key

NOON = datetime(2026, 3, 1, 12, 0, tzinfo=UTC).timestamp()
DAY_S = 86_400.0
ESTIMATE = {
    "axis": "motor",
    "zeta": 0.2,
    "zeta_sd": 0.01,
    "omega_n": 117,
    "quality": "ok",
    "left_model": False,
}


def heard(seq: int, at: float = NOON, suffix: str = "estimate/motor", **body: object) -> Heard:
    rig = Rig("press", birth={"version": "0.2.0", "simulated": True, "axes": {"motor": {"unit": "rad"}}})
    values = ESTIMATE if suffix.startswith("estimate") else {}
    return Heard(rig, suffix, Key(7, seq), {"rig": "press", "at": at, **values, **body})


@pytest.fixture
def archive(tmp_path):
    files = DayFiles(tmp_path)
    files.add(
        [heard(1), heard(2, suffix="event", code="estop", why="the line is open"), heard(3, NOON + DAY_S)]
    )
    files.close()
    return tmp_path


def test_messages_are_asked_like_segments(archive):
    assert build(archive).days == 2
    found = ask(archive, "SELECT rig, axis, day, omega_n, unit, quality, left_model FROM fleet ORDER BY seq")
    assert found.to_pylist()[0] == {
        "rig": "press",
        "axis": "motor",
        "day": datetime(2026, 3, 1, tzinfo=UTC).date(),
        "omega_n": 117.0,
        "unit": "rad",
        "quality": "ok",
        "left_model": False,
    }
    code = ask(
        archive, "SELECT \"end\", message->>'code' AS code FROM fleet WHERE kind = 'event'"
    ).to_pylist()
    assert code == [{"end": datetime.fromtimestamp(NOON, UTC), "code": "estop"}]
    assert ask(archive, "SELECT count(*) AS n FROM segments").to_pylist() == [{"n": 0}]


def test_both_views_stand_side_by_side(archive):
    fill(archive, rigs=1)
    build(archive)
    sql = "SELECT rig, zeta FROM segments UNION ALL SELECT rig, zeta FROM fleet WHERE zeta IS NOT NULL"
    assert {row["rig"] for row in ask(archive, sql).to_pylist()} == {"rig0", "press"}


def test_a_day_that_grew_is_read_again_and_no_other(archive):
    build(archive)
    assert build(archive).days == 0
    files = DayFiles(archive)
    files.add([heard(4, NOON + DAY_S)])
    files.close()
    assert build(archive).days == 1
    assert ask(archive, "SELECT count(*) AS n FROM fleet").to_pylist() == [{"n": 4}]


@pytest.mark.parametrize("killed_at", [1, 2, 3])
def test_a_builder_killed_between_two_writes_makes_the_same_bytes_later(archive, monkeypatch, killed_at):
    build(archive)
    whole = catalogue_of(archive)
    for name in whole:
        (archive / name).unlink()
    written = []
    write = Store.write

    def dies(self, name, content):
        written.append(name)
        if len(written) == killed_at:
            raise KeyboardInterrupt
        write(self, name, content)

    monkeypatch.setattr(Store, "write", dies)
    with pytest.raises(KeyboardInterrupt):
        live.catch_up(Store(archive))
    monkeypatch.undo()
    live.catch_up(Store(archive))
    assert catalogue_of(archive) == {name: whole[name] for name in whole if name.startswith(live.PARQUET)}


def test_half_a_line_is_left_for_the_next_time(archive):
    path = archive / "fleet/2026-03-01.jsonl"
    text = path.read_bytes()
    path.write_bytes(text + b'{"kind":"estimate","rig":"pre')
    build(archive)
    assert ask(archive, "SELECT count(*) AS n FROM fleet").to_pylist() == [{"n": 3}]
    (archive / live.NOTE).write_text("{torn")
    path.write_bytes(text)
    assert build(archive).days == 2


def test_days_stay_when_their_lines_are_deleted(archive):
    build(archive)
    (archive / "fleet/2026-03-01.jsonl").unlink()
    build(archive)
    assert ask(archive, "SELECT count(*) AS n FROM fleet").to_pylist() == [{"n": 3}]


def test_an_archive_without_fleet_has_an_empty_view(tmp_path):
    fill(tmp_path, rigs=1, weeks=1)
    build(tmp_path)
    assert ask(tmp_path, "SELECT zeta, message FROM fleet").num_rows == 0


def test_neither_recordings_nor_fleet_is_told(tmp_path):
    build(tmp_path)
    with pytest.raises(ArchiveError, match="has no catalogue yet"):
        ask(tmp_path, "SELECT 1")


def test_one_listener_at_a_time_has_an_archive(archive):
    first = DayFiles(archive)
    with pytest.raises(BlockingIOError, match="another `seod fleet` appends to this archive"):
        DayFiles(archive)
    first.close()
    DayFiles(archive).close()
    assert json.loads((archive / "fleet/cursor.json").read_text())["rigs"] == {"press": [7, 3]}


def test_a_fleet_in_an_object_store_is_asked_like_one_in_a_folder(archive):
    store = Store("memory://fleet")
    for path in archive.rglob("*.jsonl"):
        store.write(str(path.relative_to(archive)), path.read_bytes())
    assert build("memory://fleet").days == build(archive).days == 2
    sql = "SELECT * FROM Fleet ORDER BY seq"
    assert ask("memory://fleet", sql).equals(ask(archive, sql))
    assert ask("memory://fleet", "SELECT count(*) AS n FROM segments").to_pylist() == [{"n": 0}]
