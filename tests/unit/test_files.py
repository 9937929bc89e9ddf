"""Which files are read, who may read what is written, and which file an error names."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import record_rows
from test_cli import invoke

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.files.user_files import create_recording, irregular, restrict
from seod.record.opening import open_recorder
from seod.simulate.csv_file import write_csv

VIRTUAL = configs_dir() / "virtual.yaml"


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def open_umask():
    """The usual umask, so that the modes are the program's own."""
    before = os.umask(0o000)
    yield
    os.umask(before)


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,u,y\n" + "".join(f"{k / 100},{k % 2},{k}\n" for k in range(400)))
    return path


# What is read


@pytest.fixture(params=["a pipe", "a folder", "a socket", "a device"])
def odd(request, tmp_path):
    path = tmp_path / "odd"
    if request.param == "a pipe":
        os.mkfifo(path)
    elif request.param == "a folder":
        path.mkdir()
    elif request.param == "a device":
        path.symlink_to("/dev/zero")
    else:
        with closing(socket.socket(socket.AF_UNIX)) as listening:
            listening.bind(str(path))
    return path, request.param


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "words",
    [
        ["info"],
        ["identify"],
        ["diagnose"],
        ["response"],
        ["check"],
        ["run"],
        ["rig"],
        ["export", "--to", "csv"],
        ["identify", "{csv}", "--config"],
        ["diagnose", "{csv}", "--holdout"],
        ["diagnose", "{csv}", "--config"],
        ["info", "{csv}", "--dbc"],
        ["simulate", "{rig}", "--out", "{csv}.new.csv", "--excitation", "file", "--input"],
        ["status", "--tls"],
    ],
    ids=" ".join,
)
def test_what_is_no_regular_file_is_refused_unopened(words, odd, csv):
    path, kind = odd
    code, out, err = invoke(*(word.format(csv=csv, rig=VIRTUAL) for word in words), path)
    assert (code, out) == (os.EX_CONFIG if words == ["run"] else 1, "")
    assert f"{path}: is {kind}, not a file" in err or f"{path}:1: is {kind}, not a file" in err


@pytest.mark.timeout(20)
def test_a_certificate_or_a_replayed_file_that_is_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    text = VIRTUAL.read_text()
    rig = tmp_path / "rig.yaml"
    rig.write_text(text.replace("server:\n", "server:\n  tls: {certificate: pipe.mcap, key: pipe.mcap}\n"))
    code, _, err = invoke("check", rig)
    assert code == 1
    assert "pipe.mcap is a pipe, not a file" in err


def test_what_can_be_read_is_not_irregular(csv, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(csv)
    assert [irregular(path) for path in (csv, link, tmp_path / "none", tmp_path / ("x" * 300))] == [""] * 4


# Who may read what is written


@pytest.mark.parametrize("name", ["a.csv", "a.mcap"])
def test_a_recording_is_for_its_owner_and_group(name, tmp_path, open_umask):
    config = load_rig(VIRTUAL)
    for _ in range(2):  # the second keeps the first as `a.mcap~`
        recorder = open_recorder(tmp_path / name, config, "")
        recorder.add(record_rows.rows(3))
        recorder.close()
    assert {path.name: mode(path) for path in tmp_path.iterdir()} == {name: 0o640, f"{name}~": 0o640}


def test_an_earlier_recording_that_all_may_read_is_closed_to_them(tmp_path, open_umask):
    config = load_rig(VIRTUAL)
    for name in ("a.csv", "a.mcap"):
        (tmp_path / name).write_text("earlier")
        open_recorder(tmp_path / name, config, "").close()
    assert {mode(path) for path in tmp_path.iterdir()} == {0o640}
    assert (tmp_path / "a.mcap~").read_text() == "earlier"


BUS_LOG = """
import sys
from pathlib import Path
from seod.record.bus import _logger
_logger(Path(sys.argv[1])).stop()
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.blf", "a.asc", "a.log", "a.mf4"])
def test_a_bus_log_is_for_its_owner_and_group(name, tmp_path, open_umask):
    (tmp_path / name).touch()
    # In a process of its own: others may have imported python-can without asammdf.
    subprocess.run([sys.executable, "-c", BUS_LOG, tmp_path / name], check=True)
    assert {mode(path) for path in tmp_path.iterdir()} == {0o640}


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
def test_a_simulated_recording_is_for_its_owner_and_group(name, tmp_path, open_umask):
    for _ in range(2):
        write_csv(tmp_path / name, {"t": np.arange(3.0)})
    assert {path.name: mode(path) for path in tmp_path.iterdir()} == {name: 0o640, f"{name}~": 0o640}


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "mdf"])
def test_an_exported_recording_is_for_its_owner_and_group(kind, csv, tmp_path, open_umask):
    out = tmp_path / f"out.{'mf4' if kind == 'mdf' else kind}"
    assert invoke("export", csv, "--to", kind, "--out", out)[0] == 0
    assert mode(out) == 0o640


def test_a_stricter_umask_or_mode_stays(tmp_path):
    before = os.umask(0o077)
    try:
        os.close(create_recording(tmp_path / "a"))
        assert mode(tmp_path / "a") == 0o600
        (tmp_path / "a").chmod(0o200)
        os.close(create_recording(tmp_path / "a"))
        assert mode(tmp_path / "a") == 0o200
    finally:
        os.umask(before)


def test_devices_keep_their_mode():
    null = Path("/dev/null")
    before = null.stat().st_mode
    restrict(null)
    os.close(create_recording(null))
    assert null.stat().st_mode == before
