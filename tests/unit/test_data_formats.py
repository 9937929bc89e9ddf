"""Files that others wrote: pandas, scipy, asammdf, python-can, and the recorder."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import can
import cantools
import numpy as np
import pytest
import scipy.io
from record_rows import OFFSET_NS, about, rows

from seod.data import ReadError, open_source, read
from seod.data.mcap_rows import JsonRows, TickRows, rows_group
from seod.data.source import BLOCK_ROWS, Column, Group
from seod.files.shipped import configs_dir
from seod.processes.ring import FLAG_FRESH
from seod.record.csv_recorder import CsvLines, CsvRecorder, header
from seod.record.layout import encode
from seod.record.mcap_file import McapFile
from seod.record.series import Rotation, Series

T = np.arange(500) * 0.01
U = np.sign(np.sin(7.0 * T))
Y = np.cos(3.0 * T) * 0.1


def same(recording, y=Y):
    assert recording.t.tolist() == T.tolist()
    assert recording.u.tolist() == U.tolist()
    assert recording.y.tolist() == y.tolist()


def contents(path, **options):
    """Group -> column -> all values."""
    with open_source(path, **options) as source:
        blocks = list(source.blocks({g.name: [c.name for c in g.columns] for g in source.groups}))
        return {
            g.name: {
                c.name: np.concatenate([b.values[c.name] for b in blocks if b.group.name == g.name])
                for c in g.columns
            }
            for g in source.groups
            if any(b.group.name == g.name for b in blocks)
        }, source


# Parquet


def test_parquet_of_pandas(tmp_path):
    import pandas as pd

    frame = pd.DataFrame({"t": T, "u": U.astype("int8"), "y [deg]": np.degrees(Y), "state": "on"})
    frame.loc[3, "y [deg]"] = None
    frame.to_parquet(tmp_path / "a.parquet")
    recording = read(tmp_path / "a.parquet")
    assert recording.u.tolist() == U.tolist()
    assert np.flatnonzero(np.isnan(recording.y)).tolist() == [3]
    assert recording.y[4:] == pytest.approx(Y[4:])
    assert [(p.kind, p.rows.tolist()) for p in recording.problems] == [("missing", [4])]
    frame["when"] = pd.to_datetime("2024-01-01") + pd.to_timedelta(T, unit="s")
    frame.to_parquet(tmp_path / "b.parquet")
    assert np.diff(read(tmp_path / "b.parquet", "t=when").t) == pytest.approx(np.diff(T), abs=1e-6)


def test_a_parquet_file_that_is_cut_off(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"PAR1xxxx")
    with pytest.raises(ReadError, match=r"a\.parquet: is no whole Parquet file"):
        read(tmp_path / "a.parquet")


# MAT


@pytest.mark.parametrize("version", ["4", "5"])
def test_mat_of_vectors(version, tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y, "Ts": 0.01}, format=version)
    same(read(tmp_path / "a.mat"))


def test_mat_of_structs_and_matrices(tmp_path):
    content = {
        "run": {"time": T[:, None], "signals": np.stack([U, Y], 1), "wide": np.stack([U, Y])},
        "note": "a test",
        "short": T[:7],
    }
    scipy.io.savemat(tmp_path / "a.mat", content)
    same(read(tmp_path / "a.mat", "t=run.time,u=run.signals[1],y=run.signals[2]"))
    same(read(tmp_path / "a.mat", "t=run.time,u=run.wide[1],y=run.wide[2]"))
    with open_source(tmp_path / "a.mat") as source:
        assert [group.name for group in source.groups] == ["500 rows", "7 rows"]
        assert source.notes == {"note": "a test"}


def test_mat_7_3_says_what_to_do(tmp_path):
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    (tmp_path / "a.mat").write_bytes(head.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ReadError, match=r"version 7\.3 .*save\(name, '-v7'\)"):
        read(tmp_path / "a.mat")
    (tmp_path / "b.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\x0e\0\0\0\xff")
    with pytest.raises(ReadError, match=r"b\.mat: is no whole MAT file"):
        read(tmp_path / "b.mat")


# MDF


def write_mdf(path, *groups):
    from asammdf import MDF, Signal

    mdf = MDF(version="4.10")
    for number, signals in enumerate(groups):
        made = [Signal(x, t, unit=unit, name=name) for name, unit, t, x in signals]
        mdf.append(made, acq_name=f"raster {number}", common_timebase=True)
    mdf.save(path, overwrite=True)
    mdf.close()


def test_mdf_of_one_raster(tmp_path):
    write_mdf(tmp_path / "a.mf4", [("u", "V", T, U), ("y", "deg", T, np.degrees(Y))])
    recording = read(tmp_path / "a.mf4")
    assert recording.t.tolist() == T.tolist()
    assert recording.y == pytest.approx(Y)
    assert recording.units["y"] == "rad"


def test_mdf_of_several_rasters(tmp_path):
    command = [("cmd", "V", T + 0.002, U)]
    supply = [("ps", "MPa", T[::50] - 0.003, np.linspace(7, 8, 10))]
    write_mdf(tmp_path / "a.mf4", [("pos", "rad", T, Y)], command, supply)
    recording = read(tmp_path / "a.mf4", "u=cmd,y=pos")
    same(recording)
    assert recording.t_u.tolist() == (T + 0.002).tolist()
    assert recording.ps[[0, 49, 50, 499]] == pytest.approx([7e6, 7e6, 7e6 + 1e6 / 9, 8e6])


def test_mdf_that_is_none(tmp_path):
    (tmp_path / "a.mf4").write_bytes(b"MDF     4.10    ")
    with pytest.raises(ReadError, match=r"a\.mf4: is no whole MDF file"):
        read(tmp_path / "a.mf4")


# CAN logs

DBC = configs_dir() / "motor.dbc"


def frames():
    """Encoder each 10 ms, valve 2 ms later, supply each 100 ms, a stranger now and then."""
    database = cantools.database.load_file(DBC)
    for k, (t, u, y) in enumerate(zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)):
        sent = [("Encoder", t, {"angle": y, "run_enable": 1}), ("Valve", t + 0.002, {"voltage": u})]
        if k % 10 == 0:
            sent.append(("Supply", t + 0.004, {"pressure": 7e6 + 1000 * k, "temperature": 40}))
        for name, at, content in sent:
            message = database.get_message_by_name(name)
            spare = dict.fromkeys((s.name for s in message.signals), 0)
            data = message.encode(spare | content)
            yield can.Message(at, message.frame_id, message.is_extended_frame, data=data, channel=0)
        if k % 100 == 0:
            yield can.Message(t + 0.006, 0x7FF, is_extended_id=False, data=b"\0", channel=0)


@pytest.fixture(scope="module")
def log_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for suffix in ("asc", "blf", "log", "mf4"):
        with can.Logger(folder / f"run.{suffix}") as log:
            for frame in frames():
                log.on_message_received(frame)
    return folder


@pytest.mark.parametrize("suffix", ["asc", "blf", "log", "mf4"])
def test_can_logs(suffix, log_folder):
    names = "y=angle,u=voltage,ps=pressure,temperature=Supply.temperature"
    recording = read(log_folder / f"run.{suffix}", names, dbc=DBC)
    assert np.diff(recording.t) == pytest.approx(np.diff(T), abs=2e-6)
    assert recording.t_u - recording.t == pytest.approx(0.002, abs=2e-6)
    assert recording.u.tolist() == U.tolist()
    assert recording.y == pytest.approx(Y, abs=0.5001e-6)
    assert np.isnan(recording.ps[0])
    assert recording.ps[[1, 10, 11, -1]] == pytest.approx([7e6, 7e6, 7.01e6, 7.49e6])
    assert recording.temperature[-1] == pytest.approx(313.15)
    unread = [p.message for p in recording.problems if p.kind == "unread"]
    assert unread == ["the DBC has no message of id 0x7ff: 5 frames"]


def test_a_can_log_wants_its_dbc(log_folder, tmp_path):
    with pytest.raises(ReadError, match=r"run\.blf: is a log of CAN frames: `--dbc FILE`"):
        read(log_folder / "run.blf")
    with pytest.raises(ReadError, match=r"no column 'y'; known columns: Encoder\.angle"):
        read(log_folder / "run.asc", dbc=DBC)
    with pytest.raises(ReadError, match=r"several columns are called 'counter': Encoder\.counter, Supply"):
        read(log_folder / "run.asc", "y=counter,u=voltage", dbc=DBC)
    (tmp_path / "x.blf").write_bytes(b"LOGG and nothing else")
    with pytest.raises(ReadError, match=r"x\.blf: is no CAN log"):
        read(tmp_path / "x.blf", "y=angle,u=voltage", dbc=DBC)
    with pytest.raises(ReadError, match=r"x\.blf: cannot be read as a DBC"):
        read(log_folder / "run.asc", "y=angle,u=voltage", dbc=tmp_path / "x.blf")


def test_a_blf_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path):
    with can.BLFWriter(tmp_path / "run.blf", max_container_size=4000) as log:
        for frame in frames():
            log.on_message_received(frame)
    data = (tmp_path / "run.blf").read_bytes()
    (tmp_path / "run.blf").write_bytes(data[: len(data) * 2 // 3])
    recording = read(tmp_path / "run.blf", "y=angle,u=voltage", dbc=DBC)
    assert 200 < len(recording.y) < 400
    assert recording.y == pytest.approx(Y[: len(recording.y)], abs=0.5001e-6)
    assert "truncated" in [problem.kind for problem in recording.problems]


# MCAP


def write_mcap(path, table, axes=("motor",), notes=(), whole=True):
    with path.open("wb") as stream:
        file = McapFile(stream, about(axes), 1)
        for at in range(0, len(table), 100):
            file.rows(table[at : at + 100])
            file.end_chunk()
        for topic, t, message in notes:
            file.note(topic, t, message)
        if whole:
            file.finish()


@pytest.mark.parametrize("axes", [("motor",), ("pitch", "roll")])
def test_a_recording_in_mcap_reads_as_the_one_in_csv(axes, tmp_path):
    table = rows(1000, len(axes))
    table["axes"]["flags"][::7] = 0  # no new sample
    write_mcap(tmp_path / "a.mcap", table, axes)
    (tmp_path / "a.csv").write_text(header(axes) + CsvLines(len(axes)).lines(table))
    by_mcap, _ = contents(tmp_path / "a.mcap")
    by_csv, _ = contents(tmp_path / "a.csv")
    for name, values in by_csv[""].items():
        np.testing.assert_array_equal(by_mcap["rows"][name], values, err_msg=name)
    named = axes[-1] if len(axes) > 1 else None  # columns of a single axis do not say its name
    told = read(tmp_path / "a.mcap", axis=axes[-1]), read(tmp_path / "a.csv", axis=named)
    for role in ("t", "u", "y", "t_u", "ps"):
        np.testing.assert_array_equal(getattr(told[0], role), getattr(told[1], role))
    assert told[0].temperature is None


def test_recordings_tell_the_units_of_what_was_measured(tmp_path):
    table, units = rows(20, 2), {"pitch": "rad", "roll": "m/s"}
    series = Series(
        tmp_path / "a.mcap", replace(about(("pitch", "roll")), units=units), Rotation(), dict, 0.0
    )
    series.put([table], 0.0)
    series.finish(0.0)
    recorder = CsvRecorder(tmp_path / "a.csv", ["pitch", "roll"], units)
    recorder.add(table)
    recorder.close()
    for suffix in ("mcap", "csv"):
        for axis, unit in units.items():
            named = {"columns": f"t={axis}.t,y={axis}.y,u={axis}.u"} if suffix == "csv" else {"axis": axis}
            told = read(tmp_path / f"a.{suffix}", **named)
            assert told.units["y"] == unit
            np.testing.assert_array_equal(told.y, table["axes"]["y"][:, list(units).index(axis)])
    assert ",pitch.y [rad],pitch.u," in (tmp_path / "a.csv").read_text().partition("\n")[0]


def test_all_that_is_in_a_recording(tmp_path):
    notes = [
        (
            "/estimates/motor",
            100.1,
            {"t": 100.1, "ps": 7e6, "zeta": None, "quality": "settling", "advice": None},
        ),
        (
            "/estimates/motor",
            100.2,
            {"t": 100.2, "zeta": 0.21, "quality": "ok", "advice": "none", "new": [1]},
        ),
        ("/events", 100.3, {"t": 100.3, "event": "state", "values": {"e_a": 1.5}}),
    ]
    write_mcap(tmp_path / "a.mcap", rows(10), notes=notes)
    found, source = contents(tmp_path / "a.mcap")
    assert found["/estimates/motor"]["quality"].tolist() == ["settling", "ok"]
    np.testing.assert_array_equal(found["/estimates/motor"]["zeta"], [np.nan, 0.21])
    assert found["/events"]["values.e_a"].tolist() == [1.5]
    assert found["/events"]["log_time"] == pytest.approx([100.3 + OFFSET_NS * 1e-9])
    assert read(tmp_path / "a.mcap").ps.tolist() == [1.0] * 10  # of the rows, not of an estimate
    told = json.dumps({name: values.tolist() for name, values in found["/estimates/motor"].items()})
    assert "none" in told
    assert "[1]" in told
    assert source.notes["seod.rig"] == "bench"
    assert "attachment rig.yaml" in source.notes
    assert [group.main for group in source.groups] == [True, False, False, False, False, False]


@pytest.mark.slow
def test_a_recording_that_was_cut_off_is_read_to_its_last_whole_chunk(tmp_path):
    path = tmp_path / "a.mcap"
    table = rows(1000, 2)
    write_mcap(path, table, ("pitch", "roll"), whole=False)
    data = path.read_bytes()
    for part in (1.0, 0.9, 0.51, 0.3):
        path.write_bytes(data[: int(len(data) * part)])
        recording = read(path, axis="roll")
        count = len(recording.t)
        assert count == pytest.approx(1000 * part, abs=110)
        assert recording.y.tolist() == table["axes"]["y"][:count, 1].tolist()
        assert "truncated" in [problem.kind for problem in recording.problems]
    path.write_bytes(data[:5])
    with pytest.raises(ReadError, match=r"a\.mcap"):
        read(path)


def test_a_damaged_chunk_is_left_out_and_said(tmp_path):
    path = tmp_path / "a.mcap"
    write_mcap(path, rows(1000))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    recording = read(path)
    assert 800 <= len(recording.t) < 1000
    assert {"damaged", "gap"} <= {problem.kind for problem in recording.problems}


def test_json_messages_of_others(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        position = writer.register_channel("/axis/position", "json", schema)
        command = writer.register_channel("/axis/command", "json", schema)
        other = writer.register_channel("/tf", "protobuf", 0)
        writer.add_message(other, 0, b"\0", 0)
        for t, u, y in zip(T.tolist(), U.tolist(), Y.tolist(), strict=True):
            at = round(t * 1e9)
            writer.add_message(position, at, json.dumps({"joint": {"angle": y}}).encode(), at)
            writer.add_message(command, at + 2_000_000, json.dumps({"volts": u}).encode(), at)
        writer.finish()
    recording = read(tmp_path / "a.mcap", "y=joint.angle,u=/axis/command.volts")
    assert recording.t == pytest.approx(T)
    assert recording.t_u == pytest.approx(T + 0.002)
    assert recording.u.tolist() == U.tolist()
    assert recording.y.tolist() == Y.tolist()
    assert "/tf: messages are protobuf, only json is read" in [p.message for p in recording.problems]


def test_blocks_of_a_long_recording_join_the_axes_of_each_tick(tmp_path, monkeypatch):
    from seod.data import mcap_file

    monkeypatch.setattr(mcap_file, "BLOCK_ROWS", 150)
    table = rows(1000, 2)
    fresh = np.random.default_rng(1).uniform(size=1000) > 0.5
    table["axes"]["flags"] = np.where(fresh, FLAG_FRESH, 0)[:, None]
    write_mcap(tmp_path / "a.mcap", table, ("pitch", "roll"))
    with open_source(tmp_path / "a.mcap") as source:
        blocks = [b for b in source.blocks({"rows": ["tick", "pitch.y", "roll.y", "roll.t"]}) if len(b.rows)]
    assert len(blocks) > 3
    assert max(len(block.rows) for block in blocks) < 400
    ticks = np.concatenate([block.values["tick"] for block in blocks])
    assert ticks.tolist() == list(range(1000))
    for axis, name in enumerate(("pitch.y", "roll.y")):
        values = np.concatenate([block.values[name] for block in blocks])
        np.testing.assert_array_equal(values, np.where(fresh, table["axes"]["y"][:, axis], np.nan))
    t = np.concatenate([block.values["roll.t"] for block in blocks])
    assert np.diff(t[np.argmax(fresh) :]) == pytest.approx(5e-4)


def test_rows_without_a_sample_stay_before_the_next_one(tmp_path):
    table = rows(8)
    fresh = np.array([1, 0, 0, 1, 1, 0, 1, 1], bool)
    table["axes"]["flags"] = np.where(fresh, FLAG_FRESH, 0)[:, None]
    table["axes"]["t"][3:] -= 0.0006  # the sample before came in late, and was read after its tick's time
    write_mcap(tmp_path / "a.mcap", table, ("motor",))
    recording = read(tmp_path / "a.mcap")
    assert len(recording.t) == 8
    assert np.all(np.diff(recording.t) > 0.0)
    assert recording.t[fresh] == pytest.approx(table["axes"]["t"][fresh, 0])


def test_a_tick_that_one_axis_lacks_at_the_end_is_there_for_the_other(tmp_path):
    axes = ("pitch", "roll")
    waiting = TickRows(rows_group(axes, {}), ["tick", "pitch.y", "roll.y"], tmp_path, axes)
    for number, axis in enumerate(axes):
        for message in encode(rows(5, 2), number)[: 5 - number]:
            waiting.add(axis, message.tobytes())
    assert waiting.block(0.5).values["tick"].tolist() == [0, 1, 2, 3]
    last = waiting.block(1.0, last=True)
    assert last.values["tick"].tolist() == [4]
    assert last.values["pitch.y"].tolist() == [rows(5, 2)["axes"]["y"][4, 0]]
    assert np.isnan(last.values["roll.y"]).all()


def test_a_recording_may_end_in_the_middle_of_a_tick(tmp_path):
    table = rows(5, 2)
    with (tmp_path / "a.mcap").open("wb") as stream:
        file = McapFile(stream, about(("pitch", "roll")), 1)
        file.rows(table[:4])
        file._writer.add_message(file._rows[0], 0, encode(table[4:], 0).tobytes(), 0)
        file.finish()
    assert read(tmp_path / "a.mcap", axis="pitch").y.tolist() == table["axes"]["y"][:, 0].tolist()
    recording = read(tmp_path / "a.mcap", axis="roll")
    assert recording.y.tolist() == table["axes"]["y"][:4, 1].tolist()
    assert [problem.kind for problem in recording.problems] == ["missing"]


def test_fields_that_nobody_expected_are_kept_as_json():
    group = Group("/events", (Column("t"), Column("why", text=True), Column("more", text=True)))
    waiting = JsonRows(group, ["t", "why", "more"])
    waiting.add({"t": 1.0, "why": None})
    waiting.add({"t": "soon", "why": "x", "new": 2})
    values = waiting.block(1.0).values
    np.testing.assert_array_equal(values["t"], [1.0, np.nan])
    assert values["why"].tolist() == ["", "x"]
    assert values["more"].tolist() == ["", '{"t": "soon", "new": 2}']


def test_rows_are_numbered_through_all_blocks(tmp_path, log_folder, monkeypatch):
    import pandas as pd

    pd.DataFrame({"t": T, "u": U, "y": Y}).to_parquet(tmp_path / "a.parquet")
    write_mdf(tmp_path / "a.mf4", [("u", "V", T, U), ("y", "rad", T, Y)])
    for module in ("parquet_file", "mdf_file", "can_log"):
        monkeypatch.setattr(f"seod.data.{module}.BLOCK_ROWS", 64)
    for name in ("a.parquet", "a.mf4"):
        recording = read(tmp_path / name)
        same(recording)
        assert recording.rows.tolist() == list(range(1, 501))
    assert read(log_folder / "run.asc", "y=angle,u=voltage", dbc=DBC).rows.tolist() == list(range(1, 501))


# What is missing


@pytest.mark.parametrize(
    ("module", "name", "data", "message"),
    [
        ("pyarrow", "a.parquet", b"PAR1", r"needs pyarrow: pip install 'seod\[parquet\]'"),
        ("asammdf", "a.mf4", b"MDF     4.10", r"needs asammdf: pip install 'seod\[mdf\]'"),
    ],
)
def test_a_package_that_is_not_installed_is_named(module, name, data, message, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ReadError, match=message):
        read(tmp_path / name)


def test_blocks_are_of_a_size_that_fits_into_memory():
    assert BLOCK_ROWS * 8 * 100 < 1e8  # bytes of a hundred columns
