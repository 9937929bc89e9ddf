import csv
import errno
import math
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from record_rows import until

from seod.observe.recording import Recording
from seod.processes.ring import FLAG_FRESH, AxisState
from seod.record import csv_recorder as record
from seod.record.csv_recorder import CsvFile, CsvLines, CsvRecorder, header
from seod.record.layout import row_dtype


def rows(count, axes=1, first=0, flags=FLAG_FRESH):
    table = np.zeros(count, row_dtype(axes))
    table["tick"] = np.arange(first, first + count)
    table["tick_t"] = 100.0 + table["tick"] * 0.1
    for axis in range(axes):
        table["axes"]["t"][:, axis] = table["tick_t"] - 0.01 * (axis + 1)
        table["axes"]["y"][:, axis] = np.sin(table["tick"]) + axis
        table["axes"]["u"][:, axis] = 0.5
        table["axes"]["t_u"][:, axis] = table["tick_t"] + 0.001
        table["axes"]["state"][:, axis] = AxisState.EXCITING
        table["axes"]["flags"][:, axis] = flags
    return table


def read(path):
    with Path(path).open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_one_axis_has_the_columns_of_measured_data(tmp_path):
    recorder = CsvRecorder(tmp_path / "a.csv", ["motor"])
    recorder.add(rows(3))
    recorder.add(rows(2, first=3))
    recorder.close()
    table = read(tmp_path / "a.csv")
    assert {"t", "u", "y", "t_u", "e_a", "state", "flags"} <= set(table[0])
    assert [int(line["tick"]) for line in table] == [0, 1, 2, 3, 4]
    whole = rows(5)
    for line, row in zip(table, whole, strict=True):
        assert float(line["t"]) == row["axes"]["t"][0]  # all digits
        assert float(line["y"]) == row["axes"]["y"][0]
        assert float(line["t_u"]) == row["axes"]["t_u"][0]
        assert line["state"] == "exciting"
    report = {"file": str(tmp_path / "a.csv"), "rows": 5, "waiting": 0, "lost": 0, "error": None}
    assert recorder.report() == report


def test_several_axes_carry_their_names(tmp_path):
    recorder = CsvRecorder(tmp_path / "a.csv", ["pitch", "roll"])
    recorder.add(rows(2, axes=2))
    recorder.close()
    line = read(tmp_path / "a.csv")[1]
    assert float(line["roll.y"]) == float(line["pitch.y"]) + 1
    assert float(line["roll.t"]) < float(line["pitch.t"])
    assert "t" not in line


def test_a_tick_without_a_sample_has_no_y_and_the_time_the_sample_would_have_had():
    table = rows(3)
    table["axes"]["flags"][1] = 0
    table["axes"]["t"][1] = table["axes"]["t"][0]
    lines = [
        dict(zip(header(["m"]).strip().split(","), line.split(","), strict=True))
        for line in CsvLines(1).lines(table).splitlines()
    ]
    assert [line["y"] for line in lines] == [repr(math.sin(0.0)), "", repr(float(np.sin(2)))]
    assert float(lines[1]["t"]) == pytest.approx(100.09)


def test_what_was_never_heard_is_empty():
    table = rows(1, flags=0)
    table["axes"]["y"] = math.nan
    table["axes"]["t_u"] = math.nan
    cells = CsvLines(1).lines(table).split(",")
    assert cells[:2] == ["", ""]
    assert cells[3] == ""


def test_an_older_recording_is_kept_aside(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("precious\n")
    CsvRecorder(path, ["motor"]).close()
    assert (tmp_path / "a.csv~").read_text() == "precious\n"
    assert path.read_text() == header(["motor"])


def test_rows_reach_the_file_by_themselves(tmp_path):
    recorder = CsvRecorder(tmp_path / "a.csv", ["motor"])
    recorder.add(rows(1))
    until(lambda: len(read(tmp_path / "a.csv")) == 1)
    recorder.close()


def test_a_file_that_cannot_be_had_is_said_at_once(tmp_path):
    with pytest.raises(FileNotFoundError):
        CsvRecorder(tmp_path / "no" / "a.csv", ["motor"])


class FullDisk:
    """os.write with room for so many bytes; then it writes what fits, and fails from there on."""

    def __init__(self, room):
        self.room = room
        self.write = os.write

    def __call__(self, fd, data):
        if self.room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self.write(fd, data[: self.room])
        self.room -= written
        return written


def test_on_a_full_disk_rows_wait_until_there_is_room(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(record, "RETRY_S", 0.01)
    disk = FullDisk(len(header(["motor"])) + 150)
    monkeypatch.setattr(record.os, "write", disk)
    recorder = CsvRecorder(tmp_path / "a.csv", ["motor"])
    recording = Recording(recorder)
    recorder.add(rows(100))
    until(lambda: recorder.error)
    full = f"{tmp_path / 'a.csv'} cannot be written: No space left on device"
    assert list(recording.news()) == [full]
    told = recording.report()["recorder"]
    assert (told["rows"], told["waiting"], told["lost"], told["error"]) == (0, 100, 0, full)
    assert (tmp_path / "a.csv").read_text() == header(["motor"])  # no torn line
    disk.room = 10**9
    recorder.add(rows(10, first=100))
    until(lambda: not recorder.waiting)
    until(lambda: not recorder.error)
    assert list(recording.news()) == [f"recording goes on in {tmp_path / 'a.csv'}"]
    recording.close()
    assert [int(line["tick"]) for line in read(tmp_path / "a.csv")] == list(range(110))
    assert recording.rows_missing == 0
    assert capsys.readouterr().err == ""


def test_what_a_full_disk_never_took_is_told_at_the_end(tmp_path, monkeypatch, capsys):
    lines = CsvLines(1)
    room = len(header(["motor"])) + len(lines.lines(rows(600)[:500])) + 7
    monkeypatch.setattr(record.os, "write", FullDisk(room))
    recorder = CsvRecorder(tmp_path / "a.csv", ["motor"])
    recorder.add(rows(600))
    assert recorder.close() == 100
    assert [int(line["tick"]) for line in read(tmp_path / "a.csv")] == list(range(500))
    path = tmp_path / "a.csv"
    why = f"{path} cannot be written: No space left on device"
    assert capsys.readouterr().err == f"seod: recording {path}: up to 100 rows are not in it: {why}\n"


def test_a_deleted_file_is_noticed(tmp_path):
    recorder = CsvRecorder(tmp_path / "a.csv", ["motor"])
    (tmp_path / "a.csv").unlink()
    recorder.add(rows(1))
    until(lambda: "deleted" in recorder.error)
    recorder.close()


def test_a_disk_that_hangs_costs_rows_but_no_memory_and_no_time(tmp_path, monkeypatch):
    recorder = CsvRecorder(tmp_path / "a.csv", ["motor"])
    write, works_again = os.write, threading.Event()
    monkeypatch.setattr(record.os, "write", lambda *args: works_again.wait(20.0) and write(*args))
    monkeypatch.setattr(record, "WAITING_ROWS", 50)
    for _ in range(100):
        recorder.add(rows(10))
    assert recorder.waiting == 50
    report = {"file": str(tmp_path / "a.csv"), "rows": 0, "waiting": 50, "lost": 950, "error": None}
    assert recorder.report() == report
    works_again.set()
    recorder.close()
    assert recorder.report()["rows"] == len(read(tmp_path / "a.csv")) == 50


def test_devices_can_be_recorded_to():
    file = CsvFile(Path(os.devnull))
    file.write("x\n")
    file.close()
