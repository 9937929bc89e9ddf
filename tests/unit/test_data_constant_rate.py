"""Files that tell no time: their rows come at a constant rate, which the user tells."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

import seod
from seod.cli import app
from seod.data import ReadError, read
from seod.data.constant_rate import rate_of
from seod.data.source import BLOCK_ROWS
from tests.command_line import CliRunner


def written(tmp_path, rows=7, head="", name="run.csv"):
    path = tmp_path / name
    path.write_text(head + "".join(f"{k % 3};{k}\n" for k in range(rows)))
    return path


@pytest.mark.parametrize("rate", ["50Hz", "50 Hz", "5e1Hz", "0.05kHz", " 50.0 Hz "])
def test_rows_without_a_time_come_at_the_rate_that_is_told(tmp_path, rate):
    recording = read(written(tmp_path), f"u=1,y=2,t={rate}")
    np.testing.assert_array_equal(recording.t, np.arange(7) / 50.0)
    np.testing.assert_array_equal(recording.y, np.arange(7))
    np.testing.assert_array_equal(recording.rows, np.arange(1, 8))
    assert recording.units["t"] == "s"
    assert recording.problems == ()


def test_of_a_long_file_they_go_on(tmp_path):
    rows = BLOCK_ROWS + 1000
    recording = read(written(tmp_path, rows, "u;y\n"), "t=2kHz")
    np.testing.assert_array_equal(recording.t, np.arange(rows) / 2000.0)


def test_a_part_is_by_these_times(tmp_path):
    recording = read(written(tmp_path, 100), "u=1,y=2,t=10Hz", between=(2.0, 2.9))
    np.testing.assert_array_equal(recording.y, np.arange(20, 30))


def test_a_column_that_is_called_so_is_one(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("u,y,50Hz\n1,2,0.1\n1,3,0.2\n")
    np.testing.assert_array_equal(read(path, "t=50Hz").t, [0.1, 0.2])


def test_vectors_of_matlab_and_tables_alike(tmp_path):
    u, y = np.arange(5.0), np.arange(5.0) ** 2
    savemat(tmp_path / "run.mat", {"u1": u[:, None], "z1": y[:, None]})
    found = read(tmp_path / "run.mat", {"u": "u1", "y": "z1", "t": "20Hz"})
    table = seod.read({"u": u, "y": y}, columns="t=20Hz")
    for each in (found, table):
        np.testing.assert_array_equal(each.t, np.arange(5) / 20.0)
        np.testing.assert_array_equal(each.y, y)


@pytest.mark.parametrize("rate", ["0Hz", "-5Hz", "1e999Hz"])
def test_a_rate_is_above_none(tmp_path, rate):
    with pytest.raises(ReadError, match=f"t={re.escape(rate)}: a rate is above 0 Hz, such as t=50Hz"):
        read(written(tmp_path), f"u=1,y=2,t={rate}")


def test_who_tells_none_learns_how(tmp_path):
    path = written(tmp_path)
    with pytest.raises(ReadError, match=r"no column 't'.*`t=50Hz` that rows come at this rate"):
        read(path, "u=1,y=2")
    told = CliRunner().invoke(app, ["identify", str(path), "--columns", "u=1,y=2"])
    assert told.exit_code != 0
    assert "t=50Hz" in told.stderr


@given(st.text(max_size=12))
def test_other_words_are_no_rate(text):
    try:
        rate = rate_of(text)
    except ReadError:
        return
    assert rate is None or (rate > 0.0 and text.strip().endswith("Hz"))
