import errno
import os
import struct
import threading
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from record_rows import OFFSET_NS, Content, about, rows, until

from seod.processes.ring import AXIS_FIELDS, FLAG_FRESH, AxisState
from seod.record import disk as disk_module
from seod.record import recorder as recorder_module
from seod.record.disk import DiskFile
from seod.record.layout import COUNTERS, EVENTS, decode
from seod.record.mcap_file import McapFile
from seod.record.recorder import McapRecorder
from seod.record.series import Note, Rotation, Series, joined

NEVER = Rotation()


def series(path, rotation=NEVER, axes=("motor",), counters=dict):
    return Series(path, about(axes), rotation, counters, now=0.0)


class Disk:
    """os.write and os.fdatasync of a disk with so much room that may go away."""

    def __init__(self, monkeypatch, room=10**9):
        self.room = room
        self.gone = False
        self.syncs = 0
        self._write, self._sync = os.write, os.fdatasync
        monkeypatch.setattr(disk_module.os, "write", self.write)
        monkeypatch.setattr(disk_module.os, "fdatasync", self.sync)

    def write(self, fd, data):
        if self.gone:
            raise OSError(errno.EIO, "Input/output error")
        if self.room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self._write(fd, bytes(data[: self.room]))
        self.room -= written
        return written

    def sync(self, fd):
        self.syncs += 1
        self._sync(fd)


def test_rows_come_back_with_all_their_digits(tmp_path):
    one = series(tmp_path / "a.mcap", axes=("pitch", "roll"))
    table = rows(50, axes=2)
    one.put([table[:20], table[20:]], now=0.0)
    one.finish(0.0)
    content = Content(tmp_path / "a.mcap")
    for number, axis in enumerate(("pitch", "roll")):
        back = content.rows(axis)
        for name in (*AXIS_FIELDS, "state", "flags"):
            np.testing.assert_array_equal(back[name], table["axes"][name][:, number])
        np.testing.assert_array_equal(back["t_tick"], table["tick_t"])
        np.testing.assert_array_equal(back["age"], back["t_tick"] - back["t"])
        assert back["tick"].tolist() == list(range(50))


def test_a_recording_says_what_it_is(tmp_path):
    one = series(tmp_path / "a.mcap")
    one.put([rows(3), Note(EVENTS, 100.25, {"event": "state", "t": 100.25})], now=0.0)
    one.finish(0.0)
    content = Content(tmp_path / "a.mcap")
    assert content.ended
    assert content.attachments == {"rig.yaml": "rig: bench\n", "rig.json": '{"rig": "bench"}'}
    assert content.metadata["rig"] == "bench"
    assert content.metadata["started"] == "2023-11-14T22:13:20.500000+00:00"
    assert content.metadata["clock_offset_ns"] == str(OFFSET_NS)
    assert content.json(EVENTS) == [{"event": "state", "t": 100.25}]
    topic, row = content.messages[0]
    assert topic == "/rows/motor"
    assert row.log_time == OFFSET_NS + 100_000_000_000
    assert row.publish_time - row.log_time == round(1e5 / 7)


def test_others_can_read_the_rows_by_their_schema(tmp_path):
    """By the schema and the index alone, as programs for ROS recordings do."""
    one = series(tmp_path / "a.mcap")
    table = rows(5)
    one.put([table], now=0.0)
    one.finish(0.0)
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in reader.iter_decoded_messages(topics=["/rows/motor"])]
    for decoded, row in zip(messages, table, strict=True):
        assert (decoded.tick, decoded.t_tick) == (row["tick"], row["tick_t"])
        assert (decoded.y, decoded.u, decoded.k_l) == tuple(row["axes"][0][["y", "u", "K_L"]])
        assert (decoded.state, decoded.flags) == (AxisState.EXCITING, FLAG_FRESH)


def test_each_pass_ends_in_a_whole_chunk_on_the_disk(tmp_path, monkeypatch):
    disk = Disk(monkeypatch)
    one = series(tmp_path / "a.mcap")
    for number in range(4):
        one.put([rows(10, first=10 * number)], now=0.0)
        assert one.written.rows == 10 * (number + 1)
        assert disk.syncs == number + 2
        torn = tmp_path / "torn.mcap"
        torn.write_bytes((tmp_path / "a.mcap").read_bytes() + b"\x06\x80\0\0\0\0\0\0\0half a chunk")
        with pytest.raises((McapError, struct.error)):
            Content(torn)
        assert len(whole_rows(tmp_path / "a.mcap")) == 10 * (number + 1)
    one.finish(0.0)


def whole_rows(path):
    """Rows of a file without end, as it is after a crash."""
    return decode([message.data for topic, message in whole(path) if topic == "/rows/motor"])


def whole(path):
    channels, messages = {}, []
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                if isinstance(record, Message):
                    messages.append((channels[record.channel_id], record))
        except (McapError, struct.error):
            pass
    return messages


def test_a_full_disk_loses_nothing_that_finds_room_later(tmp_path, monkeypatch):
    disk = Disk(monkeypatch)
    one = series(tmp_path / "a.mcap")
    disk.room = 100
    one.put([rows(100)], now=1.0)
    assert one.failure == f"{tmp_path / 'a.mcap'} cannot be written: No space left on device"
    assert not one.ready(1.5), "a full disk is not bothered all the time"
    assert not one.ready(2.5)
    disk.room = 10**9
    assert one.ready(4.0)
    assert one.failure == ""
    one.put([rows(10, first=100)], now=4.0)
    one.finish(4.0)
    assert Content(tmp_path / "a.mcap").rows()["tick"].tolist() == list(range(110))
    assert (one.written.rows, one.lost.rows) == (110, 0)


def test_a_disk_that_went_away_costs_what_was_under_way_and_a_new_file_begins(tmp_path, monkeypatch):
    disk = Disk(monkeypatch)
    counters = {}
    one = series(tmp_path / "a.mcap", counters=lambda: counters)
    one.put([rows(10)], now=0.0)
    disk.gone = True
    one.put([rows(10, first=10)], now=1.0)
    assert "Input/output error" in one.failure
    assert (one.written.rows, one.lost.rows) == (10, 10)
    assert not one.ready(3.0)
    disk.gone = False
    assert one.ready(5.0)
    counters["lost"] = one.lost.rows
    one.put([rows(10, first=20)], now=5.0)
    one.finish(5.0)
    assert one.path == tmp_path / "a.0002.mcap"
    content = Content(one.path)
    assert content.rows()["tick"].tolist() == list(range(20, 30))
    assert content.metadata["part"] == "2"
    assert content.json(COUNTERS)[0]["lost"] == 10
    assert len(whole_rows(tmp_path / "a.mcap")) == 10


def test_a_chunk_that_gets_no_memory_is_lost_and_a_new_file_begins(tmp_path, monkeypatch):
    one = series(tmp_path / "a.mcap")
    one.put([rows(10)], now=0.0)

    def refused(*_):
        raise MemoryError

    with monkeypatch.context() as hog:
        hog.setattr(McapFile, "rows", refused)
        one.put([Note(EVENTS, 1.0, {"t": 1.0}), rows(10, first=10), rows(5, first=20)], now=1.0)
    assert one.failure.endswith("cannot be written: Cannot allocate memory")
    assert (one.written.rows, one.lost.rows, one.lost.notes) == (10, 15, 1)
    assert one.ready(3.0)
    one.put([rows(10, first=25)], now=3.0)
    one.finish(3.0)
    assert Content(tmp_path / "a.0002.mcap").rows()["tick"].tolist() == list(range(25, 35))
    assert len(whole_rows(tmp_path / "a.mcap")) == 10


def test_a_deleted_file_is_noticed_and_another_one_begun(tmp_path):
    one = series(tmp_path / "a.mcap")
    (tmp_path / "a.mcap").unlink()
    one.put([rows(10)], now=0.0)
    assert one.failure.endswith("the file was deleted")
    assert one.ready(2.0)
    one.put([rows(10, first=10)], now=2.0)
    one.finish(2.0)
    assert Content(tmp_path / "a.0002.mcap").rows()["tick"].tolist() == list(range(10, 20))


@pytest.mark.parametrize(("rotation", "step_s"), [(Rotation(size=20_000), 0.0), (Rotation(time=3.0), 1.0)])
def test_rotation_makes_whole_files_and_loses_no_row_between(tmp_path, rotation, step_s):
    one = series(tmp_path / "a.mcap", rotation)
    for number in range(12):
        assert one.ready(number * step_s)
        one.put([rows(100, first=100 * number)], now=number * step_s)
    one.finish(12 * step_s)
    files = [tmp_path / "a.mcap", *sorted(tmp_path.glob("a.0*.mcap"))]
    assert len(files) > 3
    contents = [Content(file) for file in files]
    assert all(content.ended for content in contents)
    assert [tick for content in contents for tick in content.rows()["tick"].tolist()] == list(range(1200))
    assert [content.metadata["part"] for content in contents] == [str(k + 1) for k in range(len(files))]


def test_a_disk_that_fills_up_at_the_end_of_a_file_ends_it_later(tmp_path, monkeypatch):
    disk = Disk(monkeypatch)
    one = series(tmp_path / "a.mcap", Rotation(size=1.0))
    sync = one._write_through
    monkeypatch.setattr(one, "_write_through", lambda: (sync(), setattr(disk, "room", 0)))
    one.put([rows(10)], now=0.0)
    assert one.failure
    disk.room = 10**9
    monkeypatch.setattr(one, "_write_through", sync)
    assert one.ready(2.0)
    one.put([rows(10, first=10)], now=2.0)
    one.finish(2.0)
    assert Content(tmp_path / "a.mcap").ended
    assert Content(tmp_path / "a.0002.mcap").rows()["tick"].tolist() == list(range(10, 20))


def test_an_event_that_is_no_json_is_counted(tmp_path):
    one = series(tmp_path / "a.mcap")
    one.put([Note(EVENTS, 1.0, {"t": float("nan")}), rows(1)], now=0.0)
    assert (one.written.rows, one.written.notes, one.lost.notes) == (1, 0, 1)
    one.finish(0.0)


def test_order_is_kept_and_rows_in_a_row_are_one_array():
    note = Note(EVENTS, 0.0, {})
    items = list(joined([rows(2), rows(3, first=2), note, note, rows(1, first=5)]))
    assert [len(item) if not isinstance(item, Note) else "note" for item in items] == [5, "note", "note", 1]


def test_an_older_recording_is_kept_aside(tmp_path):
    (tmp_path / "a.mcap").write_text("precious")
    series(tmp_path / "a.mcap").finish(0.0)
    assert (tmp_path / "a.mcap~").read_text() == "precious"


def test_a_file_that_cannot_be_had_is_said_at_once(tmp_path):
    with pytest.raises(FileNotFoundError):
        series(tmp_path / "no" / "a.mcap")


def test_the_thread_writes_by_itself_and_ends_the_file(tmp_path):
    recorder = McapRecorder(tmp_path / "a.mcap", about(), NEVER)
    recorder.add(rows(5))
    recorder.note(EVENTS, 100.0, {"t": 100.0})
    until(lambda: recorder.report()["rows"] == 5)
    assert len(whole_rows(tmp_path / "a.mcap")) == 5
    recorder.add(rows(5, first=5))
    recorder.close()
    content = Content(tmp_path / "a.mcap")
    assert content.ended
    assert content.rows()["tick"].tolist() == list(range(10))
    last = content.json(COUNTERS)[-1]
    assert (last["lost"], last["notes_lost"]) == (0, 0)


def test_a_disk_that_hangs_costs_rows_but_no_memory_and_no_time(tmp_path, monkeypatch, capsys):
    now = [0.0]
    recorder = McapRecorder(tmp_path / "a.mcap", about(), NEVER, lambda: now[0])
    write, works_again = os.write, threading.Event()
    monkeypatch.setattr(disk_module.os, "write", lambda *args: works_again.wait(20.0) and write(*args))
    monkeypatch.setattr(recorder_module, "WAITING_ROWS", 50)
    monkeypatch.setattr(recorder_module, "WAITING_NOTES", 5)
    for number in range(100):
        recorder.add(rows(10, first=10 * number))
        recorder.note(EVENTS, 1.0, {"t": 1.0})
    assert recorder.waiting == 50
    report = recorder.report()
    assert (report["lost"], report["notes_lost"], report["error"]) == (950, 95, None)
    now[0] = 2.0
    assert "the disk is slow" in recorder.error
    works_again.set()
    until(lambda: recorder.waiting == 0)
    recorder.close()
    content = Content(tmp_path / "a.mcap")
    assert content.rows()["tick"].tolist() == list(range(50))
    assert content.json(COUNTERS)[-1]["lost"] == 950
    assert "950 rows are not in it" in capsys.readouterr().err


def test_devices_can_be_recorded_to():
    file = DiskFile(Path(os.devnull))
    file.write(b"x")
    file.close()
