"""Exports read by pandas, scipy and asammdf, and by seod again; `seod info` and `seod export` as commands."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
import scipy.io
from hypothesis import example, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from record_rows import rows
from test_data_formats import write_mcap

from seod.cli import app
from seod.data import ReadError, open_source, read
from seod.data.export import default_path, export
from seod.data.progress import shown
from seod.data.show import as_text, picture
from seod.data.source import Column, Group, Table
from seod.data.summary import Envelope, summarize
from seod.files.shipped import configs_dir
from tests.command_line import CliRunner

FORMATS = ("csv", "parquet", "mat", "mdf")
SUFFIX = {"csv": "csv", "parquet": "parquet", "mat": "mat", "mdf": "mf4"}
N = 700
T = 5.0 + np.arange(N) / 3.0e3
COLUMNS = {
    "t": ("s", T),
    "u": ("V", np.sign(np.sin(50.0 * T))),
    "y": ("rad", np.where(np.arange(N) % 9, np.cos(70.0 * T) / 3.0, np.nan)),
    "force": ("kN", np.linspace(-1.0, 2.0, N)),
    "state": ("", np.array(["idle", "excited", "größer"] * N, object)[:N]),
}


def source(path):
    columns = tuple(Column(name, unit, x.dtype == object) for name, (unit, x) in COLUMNS.items())
    arrays = {name: x for name, (_, x) in COLUMNS.items()}
    return Table(path, "test", (Group("", columns),), {"": arrays}, {"rig": "bench"})


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exported")
    for kind in FORMATS:
        done = export(source(folder / "x"), kind, folder / f"a.{SUFFIX[kind]}")
        assert done.said == []
        assert done.files == [folder / f"a.{SUFFIX[kind]}"]
    assert len(list(folder.iterdir())) == len(FORMATS)  # no parts are left
    return folder


def as_pandas(path):
    import pandas as pd

    return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_pandas_reads_it(suffix, exported):
    frame = as_pandas(exported / f"a.{suffix}")
    force = "force [kN]" if suffix == "csv" else "force"
    assert list(frame.columns) == ["t", "u", "y", force, "state"]
    for name, key in (("t", "t"), ("u", "u"), ("y", "y"), ("force", force)):
        np.testing.assert_array_equal(frame[key].to_numpy(float), COLUMNS[name][1])
    assert frame["state"].tolist() == COLUMNS["state"][1].tolist()


def test_parquet_keeps_units_and_nulls(exported):
    from pyarrow import parquet

    table = parquet.read_table(exported / "a.parquet")
    assert table.schema.field("force").metadata == {b"unit": b"kN"}
    assert table.column("y").null_count == int(np.isnan(COLUMNS["y"][1]).sum())


def test_scipy_reads_it(exported):
    content = scipy.io.loadmat(exported / "a.mat", simplify_cells=True)
    for name in ("t", "u", "y", "force"):
        np.testing.assert_array_equal(content[name], COLUMNS[name][1])
    assert [word.strip() for word in content["state"]] == COLUMNS["state"][1].tolist()
    assert content["units"] == {"t": "s", "u": "V", "y": "rad", "force": "kN"}
    assert scipy.io.loadmat(exported / "a.mat")["t"].shape == (N, 1)  # columns, as MATLAB's users expect


def test_asammdf_reads_it(exported):
    from asammdf import MDF

    with MDF(exported / "a.mf4") as mdf:
        for name in ("u", "y", "force"):
            signal = mdf.get(name)
            np.testing.assert_array_equal(signal.samples, COLUMNS[name][1])
            np.testing.assert_array_equal(signal.timestamps, T)
            assert signal.unit == COLUMNS[name][0]
        assert [word.decode() for word in mdf.get("state").samples] == COLUMNS["state"][1].tolist()
        assert "rig: bench" in mdf.header.comment


@pytest.mark.parametrize("kind", FORMATS)
def test_seod_reads_it_again(kind, exported):
    path = exported / f"a.{SUFFIX[kind]}"
    with open_source(path) as again:
        (group,) = again.groups
        assert [(c.name, c.text) for c in group.columns] == [(n, n == "state") for n in COLUMNS]
        assert next(c.unit for c in group.columns if c.name == "force") == "kN"
        values = [b.values for b in again.blocks({group.name: list(COLUMNS)})]
    for name, (_, x) in COLUMNS.items():
        np.testing.assert_array_equal(np.concatenate([block[name] for block in values]), x)
    recording = read(path)
    assert recording.units == {"t": "s", "u": "V", "y": "rad" if kind != "csv" else ""}


@pytest.mark.parametrize("kind", FORMATS)
def test_many_blocks_become_one_file(kind, tmp_path, monkeypatch):
    from seod.data import source as module

    monkeypatch.setattr(module, "BLOCK_ROWS", 64)
    path = tmp_path / f"a.{SUFFIX[kind]}"
    export(source(tmp_path / "x"), kind, path)
    np.testing.assert_array_equal(read(path).y, COLUMNS["y"][1])


@example(values=[0.0] * 6 + [6e307], kind="csv")
@settings(max_examples=25, deadline=None)
@given(
    values=st.lists(st.floats(allow_infinity=False), min_size=1, max_size=20),
    kind=st.sampled_from(["csv", "parquet", "mat"]),
)
def test_any_numbers_survive(values, kind, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / f"any.{SUFFIX[kind]}"
    arrays = {
        "t": np.arange(len(values) + 1.0),
        "u": np.zeros(len(values) + 1),
        "y": np.array([*values, 1.5]),
    }
    made = Table(path.with_name("x"), "test", (Group("", tuple(map(Column, arrays))),), {"": arrays})
    export(made, kind, path, overwrite=True)
    np.testing.assert_array_equal(read(path).y, arrays["y"])


# Several groups


def test_a_recording_with_two_axes(tmp_path):
    table = rows(50, 2)
    note = ("/events", 100.0, {"t": 100.0, "event": "state"})
    write_mcap(tmp_path / "a.mcap", table, ("pitch", "roll"), [note])
    with open_source(tmp_path / "a.mcap") as opened:
        done = export(opened, "mat", tmp_path / "a.mat")
    of_axes = "/estimates/pitch, /model_errors/pitch, /estimates/roll, /model_errors/roll"
    others = f"{of_axes}, /events, /health, /counters"
    assert done.said == [f"also in it, `--group NAME` exports it: {others}"]
    content = scipy.io.loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert content["roll"]["y"].tolist() == table["axes"]["y"][:, 1].tolist()
    assert read(tmp_path / "a.mat", axis="roll").y.tolist() == table["axes"]["y"][:, 1].tolist()
    with open_source(tmp_path / "a.mcap") as opened:
        done = export(opened, "csv", tmp_path / "a.csv", ["rows", "/events"])
    assert [path.name for path in done.files] == ["a.rows.csv", "a.events.csv"]
    assert as_pandas(tmp_path / "a.events.csv")["event"].tolist() == ["state"]


def test_rows_without_a_time_are_left_out_of_mdf_and_said(tmp_path):
    arrays = {"t": np.array([np.nan, 1.0, 2.0]), "u": np.zeros(3), "y": np.arange(3.0)}
    made = Table(tmp_path / "x", "test", (Group("", tuple(map(Column, arrays))),), {"": arrays})
    done = export(made, "mdf", tmp_path / "a.mf4")
    assert done.said == ["1 rows without a time are left out"]
    assert read(tmp_path / "a.mf4").y.tolist() == [1.0, 2.0]


def test_nothing_is_lost_by_mistake(tmp_path):
    made = source(tmp_path / "x")
    (tmp_path / "a.csv").write_text("precious")
    with pytest.raises(ReadError, match=r"a\.csv: exists; `--force` replaces it"):
        export(made, "csv", tmp_path / "a.csv")
    made.path = tmp_path / "a.csv"
    with pytest.raises(ReadError, match="is the recording itself"):
        export(made, "csv", tmp_path / "a.csv", overwrite=True)
    with pytest.raises(ReadError, match=r"no group 'rosw'; there is ''"):
        export(made, "csv", tmp_path / "b.csv", ["rosw"])
    assert (tmp_path / "a.csv").read_text() == "precious"
    arrays = {"a b": np.zeros(3), "a_b": np.zeros(3)}
    clash = Table(tmp_path / "x", "test", (Group("", tuple(map(Column, arrays))),), {"": arrays})
    with pytest.raises(ReadError, match=r"two columns would be called 'a_b' in MATLAB"):
        export(clash, "mat", tmp_path / "b.mat")
    with pytest.raises(ReadError, match="no column is called t"):
        export(clash, "mdf", tmp_path / "b.mf4")
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


@pytest.mark.parametrize(
    ("name", "kind", "expected"),
    [
        ("run.csv.gz", "mat", "run.mat"),
        ("run.1.mcap", "csv", "run.1.csv"),
        ("run", "mdf", "run.mf4"),
    ],
)
def test_names_of_exports(name, kind, expected, tmp_path):
    assert default_path(tmp_path / name, kind) == tmp_path / expected


# Summaries


@settings(deadline=None)
@given(cuts=st.lists(st.integers(0, 900), max_size=6), bins=st.integers(1, 9), size=st.integers(0, 900))
def test_an_envelope_holds_all_values_whatever_the_blocks(cuts, bins, size):
    values = np.random.default_rng(size).normal(size=size)
    edges = sorted({0, size, *(min(cut, size) for cut in cuts)})
    envelope = Envelope(bins)
    for start, end in pairwise(edges):
        envelope.add(values[start:end])
    assert len(envelope.low) <= 2 * bins
    for k, (low, high) in enumerate(zip(envelope.low, envelope.high, strict=True)):
        stretch = values[k * envelope.rows : (k + 1) * envelope.rows]
        assert (low, high) == (stretch.min(), stretch.max())
    assert len(envelope.low) == size // envelope.rows


def test_a_summary(tmp_path):
    text = "t,u,y [deg],state\n" + "".join(
        f"{k / 100},1,{k % 50},on\n" for k in range(1000) if k not in (7, 8)
    )
    (tmp_path / "a.csv").write_text(text)
    with open_source(tmp_path / "a.csv") as opened:
        summary = summarize(opened)
    told = json.loads(json.dumps(summary.as_json()))
    (group,) = told["groups"]
    assert group["rows"] == 998
    assert group["time"]["rate_hz"] == pytest.approx(100.0)
    assert group["time"]["gaps"] == 1
    assert group["time"]["duration"] == pytest.approx(9.99)
    columns = {column["name"]: column for column in group["columns"]}
    assert (columns["y"]["low"], columns["y"]["high"], columns["y"]["unit"]) == (0.0, 49.0, "deg")
    assert columns["state"]["words"] == ["on"]
    assert [(p["kind"], p["row"]) for p in told["problems"]] == [("gap", 9)]
    lines = as_text(summary)
    assert "998 rows, t from 0 to 9.99 s (9.99 s), 100 Hz" in lines
    assert "▁" in lines
    assert f"! {tmp_path / 'a.csv'}: row 9: column 't': 1 gaps" in lines


def test_pictures():
    envelope = Envelope(50)
    envelope.add(np.array([0.0, 1.0, np.nan, 7.0]))
    assert picture(envelope).rstrip() == "▁▂ █"


# Commands


def invoke(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def fonts():
    """matplotlib opens its fonts once and keeps them."""
    figure = Figure()
    figure.text(0.5, 0.5, "1")
    figure.savefig(io.BytesIO())


@pytest.mark.slow
def test_info_and_its_plot(exported, tmp_path, fonts):
    code, out, _ = invoke("info", exported / "a.mf4", "--plot", tmp_path / "a.png")
    assert code == 0
    assert "700 rows, t from 5 to 5.233 s" in out
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    code, out, _ = invoke("info", exported / "a.csv", "--json")
    assert json.loads(out)["format"] == "csv"
    code, out, err = invoke("info", tmp_path / "none.csv")
    assert (code, out) == (1, "")
    assert err == f"seod: {tmp_path / 'none.csv'}: No such file or directory\n"
    (tmp_path / "words.csv").write_text("a,b\n1,x\n1,y\n")
    code, _, err = invoke("info", tmp_path / "words.csv", "--plot", tmp_path / "b.png")
    assert (code, "nothing to draw" in err) == (1, True)


def test_export_of_other_names_and_units(tmp_path):
    (tmp_path / "a.csv").write_text("time [ms];cmd;pos\n0;1;180\n1;1;90\n1;1;90\n2;;0\n")
    names = ("--columns", "t=time,u=cmd,y=pos", "--units", "y=deg")
    code, out, err = invoke("export", tmp_path / "a.csv", "--to", "parquet", *names)
    assert (code, out) == (0, f"{tmp_path / 'a.parquet'}\n")
    assert "row 4: column 'time': has the same time as the row before in 1 rows: left out" in err
    frame = as_pandas(tmp_path / "a.parquet")
    assert frame["t"].tolist() == [0.0, 0.001, 0.002]
    assert frame["y"].tolist() == pytest.approx([np.pi, np.pi / 2, 0.0])
    code, _, err = invoke("export", tmp_path / "a.csv", "--to", "csv", "--columns", "y=Pos", "--out", "x.csv")
    assert (code, "no column 'Pos'; did you mean 'pos'?" in err) == (1, True)
    assert not Path("x.csv").exists()


def test_export_of_a_can_log(tmp_path):
    database = cantools.database.load_file(configs_dir() / "motor.dbc")
    with can.Logger(tmp_path / "a.asc") as log:
        for k in range(20):
            for name, value, at in (
                ("Encoder", {"angle": k * 1e-3}, 0.0),
                ("Valve", {"voltage": -0.5}, 0.002),
            ):
                message = database.get_message_by_name(name)
                data = message.encode(dict.fromkeys((s.name for s in message.signals), 0) | value)
                log.on_message_received(can.Message(1.0 + k * 0.01 + at, message.frame_id, False, data=data))
    told = ("--dbc", configs_dir() / "motor.dbc")
    code, out, _ = invoke("export", tmp_path / "a.asc", "--to", "csv", *told)
    assert (code, len(out.splitlines())) == (0, 3)
    assert as_pandas(tmp_path / "a.Encoder.csv")["angle [rad]"].tolist() == pytest.approx(
        np.arange(20) * 1e-3
    )
    names = ("--columns", "y=angle,u=voltage")
    code, out, _ = invoke(
        "export", tmp_path / "a.asc", "--to", "mdf", "--out", tmp_path / "b.mf4", *names, *told
    )
    assert code == 0
    assert read(tmp_path / "b.mf4").t_u is not None


def test_a_bar_is_shown_on_a_terminal_and_nothing_is_lost(monkeypatch, tmp_path):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr("seod.data.source.BLOCK_ROWS", 100)
    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    made = source(tmp_path / "x")
    blocks = list(shown(made.blocks({"": ["t"]}), "run.csv"))
    assert np.concatenate([block.values["t"] for block in blocks]).tolist() == T.tolist()
    assert "run.csv" in terminal.getvalue()


@pytest.mark.slow
def test_the_daemon_imports_no_heavy_reader():
    heavy = "{'pyarrow', 'asammdf', 'pandas', 'matplotlib'}"
    modules = "seod.gateway.process, seod.data, seod.data.export, seod.data.summary, seod.commands.recordings"
    code = f"import sys, {modules}; print(sorted({heavy} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
