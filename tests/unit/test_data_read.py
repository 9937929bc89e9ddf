"""Recordings: which column is which, units, wrong times, missing values, parts and groups."""

from __future__ import annotations

import gzip
import math
import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from seod.data import ReadError, open_source, read
from seod.data.align import commands, held
from seod.data.clock import Clock
from seod.data.columns import parse_pairs, resolve, unit_in_name
from seod.data.source import Column, Group, Table
from seod.data.summary import summarize
from seod.data.units import split_header

SHARED = Path(os.environ.get("SEOD_SHARED", Path(__file__).parents[3] / "shared")) / "data"


def table(tmp_path, **columns):
    """A source of one group; `motor__y` becomes `motor.y`."""
    arrays = {name.replace("__", "."): np.asarray(x, float) for name, x in columns.items()}
    return Table(tmp_path / "x", "test", (Group("", tuple(map(Column, arrays))),), {"": arrays})


def write(tmp_path, text, name="run.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


# Columns


def test_pairs():
    assert parse_pairs("t=time, y = pos", "--columns") == {"t": "time", "y": "pos"}
    assert parse_pairs("t=motor.t,u=a=b", "--columns") == {"t": "motor.t", "u": "a=b"}
    for text, message in (
        ("t", r"--columns: 't' is not NAME=COLUMN"),
        ("y=", r"'y=' is not"),
        ("y=a,y=b", "y is given twice"),
        ("yy=a", r"no 'yy' in a recording; did you mean 'y'\?"),
    ):
        with pytest.raises(ReadError, match=message):
            parse_pairs(text, "--columns")


def test_an_axis_is_chosen_by_name_or_because_it_is_the_only_one(tmp_path):
    one = {"motor__t": [0], "motor__u": [1], "motor__y": [2], "tick": [0]}
    found = resolve(table(tmp_path, **one), {}, {})
    assert {role: each.column.name for role, each in found.items()} == {
        "t": "motor.t",
        "u": "motor.u",
        "y": "motor.y",
    }
    two = {**one, "roll__t": [0], "roll__u": [1], "roll__y": [2], "roll__ps": [3]}
    found = resolve(table(tmp_path, **two), {}, {}, axis="roll")
    assert found["ps"].column.name == "roll.ps"
    with pytest.raises(ReadError, match=r"axes motor, roll: choose one, `--columns t=motor\.t,u=motor\.u"):
        resolve(table(tmp_path, **two), {}, {})
    with pytest.raises(ReadError, match=r"no axis 'yaw'; known axes: motor, roll"):
        resolve(table(tmp_path, **two), {}, {}, axis="yaw")
    found = resolve(table(tmp_path, **two), {"t": "roll.t", "u": "roll.u", "y": "motor.y"}, {})
    assert found["y"].column.name == "motor.y"


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ({"y": "parsec"}, r"column 'y': unit 'parsec' is not known"),
        ({"t": "V"}, r"column 't': t cannot be in V"),
        ({"ps": "mm"}, r"column 'ps': ps cannot be in mm; .*MPa"),
    ],
)
def test_units_that_cannot_be(units, message, tmp_path):
    with pytest.raises(ReadError, match=message):
        resolve(table(tmp_path, t=[0], u=[0], y=[0], ps=[0]), {}, units)


def test_units_of_the_file_and_of_the_user(tmp_path):
    text = "t [ms],u,y [mm],ps [bar],temperature [°C]\n0,1,2,70,40\n500,1,3,80,50\n"
    recording = read(write(tmp_path, text), units="u=mV")
    assert recording.t.tolist() == [0.0, 0.5]
    assert recording.u.tolist() == [0.001, 0.001]
    assert recording.y == pytest.approx([0.002, 0.003])
    assert recording.ps == pytest.approx([7e6, 8e6])
    assert recording.temperature == pytest.approx([313.15, 323.15])
    expected = {"t": "s", "u": "V", "y": "m", "ps": "Pa", "temperature": "K"}
    assert recording.units == expected
    assert read(write(tmp_path, text), units="y=deg").units["y"] == "rad"  # the user is right


def test_a_unit_that_nobody_knows_stays_as_it_is(tmp_path):
    recording = read(write(tmp_path, "t,u,y [counts]\n0,1,2\n1,1,3\n"))
    assert (recording.y.tolist(), recording.units["y"]) == ([2.0, 3.0], "counts")


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ("pos [deg]", ("pos", "deg")),
        ("pos (°)", ("pos", "deg")),
        ("pos / mm", ("pos", "mm")),
        ("Speed [U/min]", ("Speed", "rpm")),
        ("data[2]", ("data[2]", "")),
        ("force (left)", ("force (left)", "")),
        ("ratio [-]", ("ratio", "")),
        ("m/s", ("m/s", "")),
        ("[deg]", ("[deg]", "")),
    ],
)
def test_units_in_headers(cell, expected):
    assert split_header(cell) == expected


# Times


def rows_of(problems):
    return {problem.kind: problem.rows.tolist() for problem in problems}


def test_times_that_do_not_increase_are_left_out_and_said(tmp_path):
    path = write(tmp_path, "t,u,y\n0,1,0\n1,1,1\n1,1,2\n2,1,3\n1.5,1,4\n1.7,1,5\n,1,6\n3,1,7\n4,1,8\n")
    recording = read(path)
    assert recording.t.tolist() == [0, 1, 2, 3, 4]
    assert recording.y.tolist() == [0, 1, 3, 7, 8]
    assert recording.rows.tolist() == [2, 3, 5, 9, 10]
    assert rows_of(recording.problems) == {"missing": [8], "duplicate": [4], "decreasing": [6, 7]}
    told = [str(problem) for problem in recording.problems]
    assert f"{path}: row 6: column 't': goes back in time, by up to 0.5 s: 2 rows left out" in told


def test_gaps_and_uneven_sampling(tmp_path):
    t = np.delete(np.arange(100) * 0.01, [50, 51, 52, 80])
    clock = Clock(tmp_path, "t")
    clock.add(t, np.arange(len(t)))
    problems = list(clock.problems())
    assert rows_of(problems) == {"gap": [50, 77]}
    assert problems[0].message == "2 gaps, the longest of 0.04 s; 0.04 s are missing in all"
    jittery = np.arange(1000) * 0.01 + np.random.default_rng(1).uniform(0, 0.004, 1000)
    clock = Clock(tmp_path, "t")
    clock.add(jittery, np.arange(1000))
    assert "uneven" in rows_of(clock.problems())


@settings(deadline=None)
@given(
    t=st.lists(st.one_of(st.integers(0, 20).map(float), st.just(float("nan"))), max_size=30),
    cuts=st.lists(st.integers(0, 30), max_size=4),
)
def test_a_clock_sees_the_same_in_one_block_or_in_many(t, cuts):
    times = np.array(t, float)
    rows = np.arange(len(t))
    whole = Clock(Path("x"), "t")
    kept = whole.add(times, rows)
    good = times[kept]
    expected, newest = [], -1.0
    for value in t:  # by hand
        expected.append(value > newest)
        newest = max(newest, value) if value == value else newest
    assert kept.tolist() == expected
    assert (np.diff(good) > 0).all()
    many = Clock(Path("x"), "t")
    edges = sorted({0, len(t), *(min(cut, len(t)) for cut in cuts)})
    parts = [many.add(times[a:b], rows[a:b]) for a, b in pairwise(edges)]
    assert np.concatenate([np.array([], bool), *parts]).tolist() == kept.tolist()
    left_out = {"missing", "duplicate", "decreasing"}
    told = [{k: v for k, v in rows_of(c.problems()).items() if k in left_out} for c in (whole, many)]
    assert told[0] == told[1]
    assert (many.count, many.longest) == (whole.count, whole.longest)


@settings(deadline=None)
@example([[-1e308, 1e308, 1.0]])
@given(st.lists(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=20), max_size=4))
def test_whatever_times_a_recording_holds_those_kept_rise_and_each_row_left_out_is_told(blocks):
    clock, kept, row = Clock(Path("x"), "t"), [], 0
    for block in blocks:
        t = np.array(block, float)
        kept += t[clock.add(t, np.arange(row, row + len(t)))].tolist()
        row += len(t)
    assert all(a < b for a, b in pairwise(kept))
    told = rows_of(clock.problems())
    left_out = sum(len(told.get(kind, [])) for kind in ("missing", "duplicate", "decreasing"))
    assert left_out == row - len(kept)
    assert clock.rate_hz > 0.0 or len(kept) < 2


# Values


def test_a_clipped_sensor_is_noticed_and_standstill_is_not(tmp_path):
    t = np.arange(2000) * 1e-3
    y = np.round(np.sin(2 * np.pi * 3 * t) * 1000) / 1000
    rows = "".join(f"{a!r},0,{b!r}\n" for a, b in zip(t.tolist(), y.tolist(), strict=True))
    assert not read(write(tmp_path, "t,u,y\n" + rows)).problems
    clipped = np.clip(y, -2.0, 0.8)
    rows = "".join(f"{a!r},0,{b!r}\n" for a, b in zip(t.tolist(), clipped.tolist(), strict=True))
    (problem,) = read(write(tmp_path, "t,u,y\n" + rows)).problems
    assert (problem.kind, problem.column, len(problem.rows)) == ("clipped", "y", 6)
    still = np.where(t < 1.0, 0.0, 1.0 - np.cos(6 * (t - 1.0)))
    rows = "".join(f"{a!r},0,{b!r}\n" for a, b in zip(t.tolist(), still.tolist(), strict=True))
    assert not read(write(tmp_path, "t,u,y\n" + rows)).problems


def test_columns_that_are_empty_are_not_there(tmp_path):
    recording = read(write(tmp_path, "t,u,y,t_u,ps\n0,1,2,,\n1,1,3,,\n"))
    assert recording.t_u is None
    assert recording.ps is None
    assert recording.problems == ()
    recording = read(write(tmp_path, "t,u,y,t_u,ps\n0,1,2,0.1,7e6\n1,1,3,1.1,7e6\n"))
    assert recording.t_u.tolist() == [0.1, 1.1]
    assert recording.ps.tolist() == [7e6, 7e6]


def test_infinite_values_are_said(tmp_path):
    recording = read(write(tmp_path, "t,u,y\n0,1,2\n1,1,inf\n"))
    assert rows_of(recording.problems) == {"infinite": [3]}


# Groups and parts


def test_commands_between_samples_and_held_ones():
    t = np.array([0.0, 1.0, 2.0, 3.0])
    u, t_u, lost = commands(t, np.array([-0.5, 0.1, 2.2, 2.4, 9.0]), np.array([5.0, 6.0, 7.0, 8.0, 9.0]))
    assert u.tolist() == [6.0, 6.0, 8.0, 8.0]
    assert t_u.tolist() == [0.1, 1.0, 2.4, 3.0]
    assert lost == 1
    u, t_u, lost = commands(t, np.array([1.5]), np.array([4.0]))
    assert np.isnan(u).tolist() == [True, False, False, False]
    assert t_u.tolist() == [0.0, 1.5, 2.0, 3.0]
    assert held(t, np.array([1.0, 2.5]), np.array([1.0, 2.0]))[1:].tolist() == [1.0, 1.0, 2.0]


def test_parts_are_joined_in_order(tmp_path):
    first = write(tmp_path, "t,u,y\n0,1,2\n1,1,3\n", "1.csv")
    second = write(tmp_path, "t,u,y\n2,1,4\n3,1,5\n", "2.csv")
    recording = read([first, second])
    assert recording.y.tolist() == [2, 3, 4, 5]
    assert recording.paths == (first, second)
    with pytest.raises(ReadError, match=r"1\.csv: begins at 0 s, before the end of .*2\.csv at 3 s"):
        read([second, first])
    third = write(tmp_path, "t,u,y [mm]\n4,1,4\n", "3.csv")
    with pytest.raises(ReadError, match=r"3\.csv: has other columns or units"):
        read([first, third])


def test_a_part_of_the_time(tmp_path):
    recording = read(write(tmp_path, "t,u,y\n0,1,2\n1,1,3\n2,1,4\n3,1,5\n"), between=(1.0, 2.0))
    assert recording.y.tolist() == [3, 4]
    with pytest.raises(ReadError, match="no row with a time"):
        read(tmp_path / "run.csv", between=(5.0, 6.0))


# Records of real rigs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rows", "first", "last"),
    [
        ("servohydraulic_chirp", 61_500, (0.0, -0.169, -0.209), (61.499, -0.204, -0.282)),
        ("electromechanical_positioning", 24_841, (0.0, 2.53863, 7.45e-06), (24.84, -0.952732, 0.00361505)),
    ],
)
def test_real_records_as_they_are_and_under_foreign_names(name, rows, first, last, tmp_path):
    path = SHARED / f"{name}.csv.gz"
    if not path.exists():
        pytest.skip(f"no measured record at {path}")
    recording = read(path)
    assert len(recording.t) == rows
    assert tuple(x[0] for x in (recording.t, recording.u, recording.y)) == first
    assert tuple(x[-1] for x in (recording.t, recording.u, recording.y)) == last
    assert recording.rate_hz == pytest.approx(1000.0)
    assert {p.kind for p in recording.problems} <= {"clipped"}
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    body = [";".join(cell.replace(".", ",") for cell in line.split(",")) for line in lines[1:]]
    foreign = tmp_path / "logger.txt"
    header = "Logger 7\r\n\r\nZeit [s];Sollwert [V];Weg [mm];rest\r\n"
    foreign.write_bytes((header + "\r\n".join(body)).encode("cp1252"))
    again = read(foreign, columns="t=Zeit,u=Sollwert,y=Weg", units="y=m")
    for role in ("t", "u", "y"):
        assert getattr(again, role).tolist() == getattr(recording, role).tolist()
    assert recording.rows[0] + 2 == again.rows[0]


def slow_file(folder, name, scale, header="t,u,y"):
    """60 samples at 100 Hz, times as whole numbers in another unit."""
    path = folder / name
    path.write_text(f"{header}\n" + "".join(f"{k * scale},1,{k % 7}\n" for k in range(60)))
    return path


@pytest.mark.parametrize(
    ("scale", "told"), [(10, "`--units t=ms` says ms (100 Hz)"), (10_000, "t=us` us (100 Hz)")]
)
def test_times_in_another_unit_are_asked_about_and_never_changed(scale, told, tmp_path):
    path = slow_file(tmp_path, "run.csv", scale)
    recording = read(path)
    assert recording.t[1] == scale
    (problem,) = [p for p in recording.problems if p.kind == "unit"]
    assert told in problem.message
    with open_source(path) as source:
        assert [p.kind for p in summarize(source).problems] == ["unit"]
    for unit in ("ms", "s"):
        assert not [p for p in read(path, units={"t": unit}).problems if p.kind == "unit"]
    assert not [
        p for p in read(slow_file(tmp_path, "b.csv", scale, "t [s],u,y")).problems if p.kind == "unit"
    ]


def asked_about(step, count, has_unit=False):
    """Whether the unit of such times is."""
    clock = Clock(Path("x"), "t", has_unit)
    clock.add(step * np.arange(float(count)), np.arange(count))
    return "unit" in rows_of(clock.problems())


@settings(deadline=None)
@example(rate_hz=50_000.0, seconds=3.05)
@given(rate_hz=st.floats(1e-3, 50_000.0), seconds=st.floats(3.05, 6.0))
def test_times_in_ms_of_any_rate_are_asked_about_from_three_seconds_on(rate_hz, seconds):
    """30 rows at least."""
    count = max(30, 2 + math.floor(seconds * rate_hz))
    assert asked_about(1e3 / rate_hz, count)
    assert not asked_about(1e3 / rate_hz, count, has_unit=True)


@pytest.mark.slow
@settings(deadline=None)
@given(rate_hz=st.floats(1.01, 40_000.0), part=st.floats(0.0, 0.99))
def test_times_in_s_of_usual_length_are_not_asked_about(rate_hz, part):
    """As long as 50 min, above 50 Hz any length."""
    assert not asked_about(1.0 / rate_hz, 2 + min(int(part * 3000.0 * rate_hz), 200_000))
    assert not asked_about(1.0 / max(rate_hz, 50.5), 200_000)


def test_a_recording_in_ms_at_ten_kilohertz_is_asked_about(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,u,y\n" + "".join(f"{0.1 * k:.1f},1,{k % 7}\n" for k in range(30_002)))
    (problem,) = [p for p in read(path).problems if p.kind == "unit"]
    assert "is 10 Hz for 0.83 h in s" in problem.message
    assert "`--units t=ms` says ms (1e+04 Hz)" in problem.message


SPELLED = {
    "ms": ("ms", "msec", "MS", "milliseconds", "millis"),
    "us": ("us", "µs", "usec", "micros"),
    "ns": ("ns",),
}


@given(st.data())
def test_a_name_tells_a_unit_behind_a_separator_alone(data):
    unit = data.draw(st.sampled_from([*SPELLED, "s"]))
    word = data.draw(st.sampled_from([*SPELLED.get(unit, ("sec", "seconds", "s"))]))
    before = data.draw(st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=8))
    mark = data.draw(st.sampled_from("_ .-"))
    assert unit_in_name(f"{before}{mark}{word}") == unit
    assert unit_in_name(f"{word}{mark}{before}x") == ""


@pytest.mark.parametrize(
    ("header", "factor", "said"),
    [
        ("t_s,u_V,y_mm", 1e-3, ["'y_mm' is taken as mm by its name; `--units y=m`"]),
        ("t_ms,u,y_deg", np.pi / 180.0, ["'t_ms' is taken as ms", "'y_deg' is taken as deg"]),
        ("t,u_volts,y", 1.0, []),
        ("t,u,y_rad", 1.0, ["'y_rad' is taken as rad"]),
        ("t,u,y_mm [m]", 1.0, []),
        ("t,u,y,y_mm", 1.0, []),
    ],
)
def test_a_column_may_be_called_by_its_role_and_unit(tmp_path, header, factor, said):
    rows = "".join(f"{k},1,{k * k}{',5' * (header.count(',') - 2)}\n" for k in range(4))
    found = read(write(tmp_path, f"{header}\n{rows}"))
    assert found.y == pytest.approx(factor * np.arange(4.0) ** 2)
    remarks = [each.message for each in found.problems if each.kind == "unit"]
    assert len(remarks) == len(said)
    assert all(part in remark for part, remark in zip(sorted(said), sorted(remarks), strict=True))


@pytest.mark.parametrize("name", ["y_max", "y_in", "y_min", "y_", "y_s", "ymm", "ref_y_mm"])
def test_other_ends_of_a_name_are_no_units(tmp_path, name):
    with pytest.raises(ReadError, match="no column 'y'"):
        read(write(tmp_path, f"t,u,{name}\n0,1,2\n1,1,3\n"))


def test_of_two_units_none_is_chosen(tmp_path):
    with pytest.raises(ReadError, match="y_deg, y_mm may each be y: choose one, `--columns y=y_deg`"):
        read(write(tmp_path, "t,u,y_mm,y_deg\n0,1,2,3\n1,1,3,4\n"))


@pytest.mark.parametrize("name", ["t", "s", "time", "t_", "items", "status", "t_u", "ms2", "times", "_"])
def test_other_names_tell_none(name):
    assert unit_in_name(name) == ""


@pytest.mark.parametrize(
    ("name", "factor"),
    [("t_ms", 1e-3), ("time_us", 1e-6), ("millis", 1e-3), ("micros", 1e-6), ("Time msec", 1e-3)],
)
def test_times_whose_name_tells_their_unit_are_taken_so_and_it_is_said(name, factor, tmp_path):
    path = slow_file(tmp_path, "run.csv", 10, f"{name},u,y")
    recording = read(path, columns={"t": name})
    assert recording.t[1] == pytest.approx(10 * factor)
    (said,) = [p.message for p in recording.problems]
    assert f"column {name!r} is taken as" in said
    assert read(path, columns={"t": name}, units={"t": "s"}).t[1] == 10.0
    with open_source(path) as source:
        (group,) = summarize(source, name).as_json()["groups"]
    assert group["time"]["duration"] == pytest.approx(590 * factor)


def test_a_name_in_seconds_is_neither_changed_nor_asked_about(tmp_path):
    recording = read(slow_file(tmp_path, "run.csv", 10, "time_s,u,y"), columns={"t": "time_s"})
    assert (recording.t[1], recording.problems, recording.read_in["t"]) == (10.0, (), "s")
