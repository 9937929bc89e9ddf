"""What a recording becomes: segments, their means, and what the daemon told of them."""

from __future__ import annotations

import io
import json
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pytest
from archive_recordings import BEGAN, estimate, fault, model_error, recording, ticks

from seod.archive import segments as segments_module
from seod.archive.layout import COLUMNS, schema, table_of
from seod.archive.reading import rows_of
from seod.archive.store import Known
from seod.record.mcap_records import messages, records, unpacked


def rows(content: bytes) -> list[dict]:
    return rows_of(Known("a/run.mcap", len(content), "stamp"), io.BytesIO(content))


def test_a_segment_ends_where_excitation_does():
    found = rows(recording(rows=ticks("--XXXX-XX")))
    assert [(row["part"], row["rows"], row["exciting_s"] > 0) for row in found] == [
        (1, 2, False),
        (2, 4, True),
        (3, 1, False),
        (4, 2, True),
    ]
    assert found[1]["seconds"] == pytest.approx(0.3)
    assert found[1]["begin"] == BEGAN + timedelta(seconds=0.2)
    assert found[1]["end"] == BEGAN + timedelta(seconds=0.5)


def test_a_segment_is_no_longer_than_it_may_be(monkeypatch):
    monkeypatch.setattr(segments_module, "LONGEST_S", 0.35)
    found = rows(recording(rows=ticks("X" * 10)))
    assert [row["rows"] for row in found] == [4, 4, 2]
    assert sum(row["rows"] for row in found) == 10


def test_means_leave_out_what_is_not_measured():
    (row,) = rows(recording(rows=ticks("XXXX")))
    assert row["reference"] == 0.25
    assert row["supply_pressure"] == 7e6
    assert row["temperature"] is None
    assert row["e_a"] == pytest.approx(0.4)
    idle = rows(recording(rows=ticks("--")))[0]
    assert idle["e_a"] is None  # the relay is off
    assert (row["unit"], row["simulated"], row["rig"], row["day"]) == ("rad", True, "bench", date(2026, 3, 1))


def test_missing_ticks_are_counted_within_a_segment():
    assert [row["lost"] for row in rows(recording(rows=ticks("XX   XXX")))] == [3]


def test_the_last_good_estimate_of_a_segment_is_taken():
    notes = [
        estimate(0.3, omega_n=101.0),
        estimate(0.4, omega_n=102.0),
        estimate(0.5, "noisy", omega_n=150.0),
        estimate(0.9, "settling", omega_n=None),
    ]
    first, second = rows(recording(rows=ticks("XXXXXX--XX"), notes=notes))[::2]
    assert (first["omega_n"], first["quality"]) == (102.0, "ok")
    assert (second["omega_n"], second["quality"]) == (None, "settling")


def test_messages_come_to_the_segment_of_their_time_whatever_their_place_in_the_file():
    notes = [model_error(0.9, True, 0.3), model_error(0.1, False, 0.02), fault(0.55)]
    first, idle, second = rows(recording(rows=ticks("XXXXX--XXX"), notes=notes))
    assert (first["left_model"], first["model_error"]) == (False, 0.02)
    assert (second["left_model"], second["left_since"]) == (True, BEGAN + timedelta(seconds=0.9))
    assert idle["left_model"] is None
    assert [each["code"] for each in json.loads(idle["faults"])] == ["limit"]
    assert json.loads(first["faults"]) == []


def test_a_fault_is_of_the_axes_that_it_latched():
    notes = [fault(0.1, "pitch", latched=["pitch"]), fault(0.2, None)]
    found = rows(recording(rows=ticks("XXX", axes=2), notes=notes, axes=("pitch", "roll")))
    assert {row["axis"]: len(json.loads(row["faults"])) for row in found} == {"pitch": 2, "roll": 1}


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "first bytes"),
        (b"no recording at all", "first bytes"),
        (recording(finished=False), "was not closed"),
        (recording()[:1500], "no whole record begins"),
        (recording(rows=ticks("")), "holds no rows"),
    ],
)
def test_a_file_that_is_not_whole_says_why(content, told):
    found = rows(content)
    assert found
    assert all(told in row["problem"] for row in found)
    table_of([{key: row.get(key) for key in COLUMNS} for row in found])


def test_what_is_whole_of_a_torn_file_counts():
    (_, excited, _) = rows(recording(notes=[estimate(0.5)], finished=False))
    assert (excited["omega_n"], excited["rows"]) == (100.0, 9)


def test_every_cut_of_a_file_gives_rows_of_the_layout():
    content = recording(notes=[estimate(0.5), model_error(0.6, True), fault(0.7)])
    for end in range(0, len(content), 37):
        table_of([{key: row.get(key) for key in COLUMNS} for row in rows(content[:end])])


def test_messages_are_read_as_the_library_reads_them():
    content = recording(rows=ticks("-XX", axes=2), axes=("pitch", "roll"), notes=[estimate(0.1)])
    for chunk in records(io.BytesIO(content), len(content)):
        if type(chunk).__name__ != "Chunk":
            continue
        whole = [each for each in unpacked(chunk) if type(each).__name__ in ("Channel", "Message")]
        quick = list(messages(chunk))
        assert len(whole) == len(quick) > 0
        for one, other in zip(whole, quick, strict=True):
            assert other == (one if type(one).__name__ == "Channel" else (one.channel_id, one.data))


def test_the_layout_has_each_column_once_with_its_meaning():
    assert schema().names == list(COLUMNS)
    assert all(column.means for column in COLUMNS.values())
    assert np.unique(list(COLUMNS)).size == len(COLUMNS)


def test_the_page_tells_each_column():
    page = (Path(__file__).parents[2] / "docs" / "archive.md").read_text()
    for name, column in COLUMNS.items():
        assert f"| `{name}` | {column.unit} | {column.means} |\n" in page
