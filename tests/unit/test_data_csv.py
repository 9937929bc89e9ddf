"""Text files of many loggers: separators, decimal marks, headers, encodings, and rows that are wrong."""

from __future__ import annotations

import csv
import gzip
import io
import math
import resource
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seod.data import ReadError, csv_file, open_source, read
from seod.data.dialect import detect, number
from tests.damage.blows import bomb


def write(tmp_path, text, name="run.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def whole(path):
    """All columns of a file, and the lines of its rows."""
    with open_source(path) as opened:
        (group,) = opened.groups
        blocks = list(opened.blocks({"": [column.name for column in group.columns]}))
        values = {c.name: np.concatenate([b.values[c.name] for b in blocks]) for c in group.columns}
        return group.columns, values, np.concatenate([block.rows for block in blocks]), opened.remarks


FOREIGN = {
    "plain": "t,u,y\n0,1,2\n0.5,-1,2.25\n",
    "semicolons and decimal commas": "t;u;y\n0;1;2\n0,5;-1;2,25\n",
    "tabs": "t\tu\ty\n0\t1\t2\n0.5\t-1\t2.25\n",
    "tabs and decimal commas": "t\tu\ty\n0,0\t1,0\t2,0\n0,5\t-1,0\t2,25\n",
    "spaces": "  t  u   y\n  0  1   2\n0.5 -1  2.25\n",
    "quoted decimal commas": '"t","u","y"\n"0,0","1","2"\n"0,5","-1","2,25"\n',
    "spaces after commas": "t, u, y\n0.0, 1, 2\n0.5, -1, 2.25\n",
    "comments": "# a logger\n# at 2 Hz\nt,u,y\n0,1,2\n# stopped by hand\n\n0.5,-1,2.25\n",
    "talk before the header": "Logger 3000\nOperator: me\n\nChannels;3\nt;u;y\n0;1;2\n0.5;-1;2.25\n",
    "talk with commas": "Date,2024-01-01\nt,u,y\n0,1,2\n0.5,-1,2.25\n",
    "units in a row of their own": "t,u,y\ns,V,rad\n0,1,2\n0.5,-1,2.25\n",
    "units in brackets below": "t;u;y\n[s];[V];[rad]\n\n0;1;2\n0,5;-1;2,25\n",
    "units in the header": "t [s],u (V),y [rad]\n0,1,2\n0.5,-1,2.25\n",
    "carriage returns": "t,u,y\r\n0,1,2\r\n0.5,-1,2.25\r\n",
    "byte order mark": "\ufefft,u,y\n0,1,2\n0.5,-1,2.25\n",
    "exponents": "t,u,y\n0e0,1E0,+2.\n5e-1,-1e+0,.225e1\n",
    "no end of line at the end": "t,u,y\n0,1,2\n0.5,-1,2.25",
    "milliseconds": "t [ms],u [mV],y [rad]\n0,1000,2\n500,-1000,2.25\n",
    "an oscilloscope": "t,u,y\n(ms),(mV),(rad)\n\n0,1000,2\n500,-1000,2.25\n",
    "another": "t,u,y\nsecond,Volt,rad\n+00.0E+00,+1.0E+00,2\n+500.0E-03,-1.0E+00,2.25\n",
    "degrees": f"t,u,y [°]\n0,1,{math.degrees(2)!r}\n0.5,-1,{math.degrees(2.25)!r}\n",
}


@pytest.mark.parametrize("text", FOREIGN.values(), ids=FOREIGN)
def test_the_same_record_however_it_is_written(text, tmp_path):
    recording = read(write(tmp_path, text))
    assert recording.t.tolist() == [0.0, 0.5]
    assert recording.u.tolist() == [1.0, -1.0]
    assert recording.y == pytest.approx([2.0, 2.25], rel=1e-15)
    assert not recording.problems


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_encodings(encoding, tmp_path):
    path = write(tmp_path, "t;Stellgröße [V];Winkel [°]\n0;1;180\n0,5;2;90\n", encoding=encoding)
    recording = read(path, columns="u=Stellgröße,y=Winkel")
    assert recording.y == pytest.approx([math.pi, math.pi / 2])
    assert recording.units["y"] == "rad"


def test_gzip_is_known_by_its_bytes_not_by_its_name(tmp_path):
    path = tmp_path / "run.dat"
    path.write_bytes(gzip.compress(b"t,u,y\n0,1,2\n1,2,3\n"))
    assert read(path).y.tolist() == [2.0, 3.0]


def test_lines_are_those_an_editor_shows(tmp_path):
    _, _, rows, _ = whole(write(tmp_path, "# x\n\nt,u,y\n0,1,2\n# pause\n1,2,3\n"))
    assert rows.tolist() == [4, 6]


def test_words_for_nothing_are_nan(tmp_path):
    path = write(tmp_path, "t,u,y\n0,1,2\n1,,NaN\n2,NA,null\n3,4,-\n")
    recording = read(path)
    assert np.isnan(recording.u).tolist() == [False, True, True, False]
    assert np.isnan(recording.y).tolist() == [False, True, True, True]
    told = {(p.column, p.kind): p.rows.tolist() for p in recording.problems}
    assert told[("u", "missing")] == [3, 4]
    assert told[("y", "missing")] == [3, 4, 5]


def test_dates_are_seconds(tmp_path):
    path = write(tmp_path, "time,u,y\n2024-05-01T12:00:00.000,1,2\n2024-05-01T12:00:00.250,1,3\n")
    recording = read(path, columns={"t": "time"})
    assert np.diff(recording.t) == pytest.approx([0.25])
    assert recording.t[0] == 1714564800.0


def test_text_columns_stay_text(tmp_path):
    columns, values, _, _ = whole(write(tmp_path, "t,y,u,state\n0,1,2,idle\n1,2,3,exciting\n"))
    assert [column.text for column in columns] == [False, False, False, True]
    assert values["state"].tolist() == ["idle", "exciting"]


@pytest.mark.parametrize("decimal", [".", ","])
def test_a_decimal_mark_may_come_late(decimal, tmp_path):
    text = "t;u;y\n" + "".join(f"{k};1;2\n" for k in range(10_000)) + f"10000;1;2{decimal}25\n"
    assert read(write(tmp_path, text)).y[-1] == 2.25


def test_remarks_of_an_operator_that_come_late_are_said(tmp_path):
    text = (
        "t,u,y,ps,note\n" + "".join(f"{k},1,2,,\n" for k in range(10_000)) + "10000,1,2,7e6,valve swapped\n"
    )
    path = write(tmp_path, text)
    columns, values, _, remarks = whole(path)
    assert not any(column.text for column in columns)
    assert values["ps"][-1] == 7e6
    assert "row 10002: column 'note': text 'valve swapped' is left out" in {
        remark.message for remark in remarks
    }


def test_a_file_without_header_has_numbered_columns(tmp_path):
    recording = read(write(tmp_path, "0 1 2\n1 2 3\n"), columns="t=1,u=2,y=3")
    assert recording.y.tolist() == [2.0, 3.0]
    assert recording.rows.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t;u;y\n0,5;1;2\n" + "1.5;1;2\n" * 30 + "3,5;4;5\n" * 60, r"row 3: column 't': '1\.5' .* comma"),
        ("t,y,y\n0,1,2\n1,2,3\n", r"two columns are named 'y'"),
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("Dear sir,\nplease find enclosed\n", "no table of numbers"),
        ("t,u\n0,1\n1,2\n", r"no column 'y'; known columns: t, u; `--columns y=NAME`"),
        ("t,u,pos\n0,1,2\n1,2,3\n", r"no column 'y'"),
        ("t,u,Y\n0,1,2\n1,2,3\n", r"no column 'y'; did you mean 'Y'\?"),
    ],
)
def test_errors_name_the_place(text, message, tmp_path):
    path = write(tmp_path, text)
    with pytest.raises(ReadError, match=message) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: ")


def test_an_error_far_into_the_file_names_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "BLOCK_ROWS", 100)
    lines = [f"{k},1,2" for k in range(5000)]
    lines[4321:4621] = ["4321,1,two"] * 300
    with pytest.raises(ReadError, match=r"row 4323: column 'y': 'two' is no number; .*; so in \d+ rows"):
        read(write(tmp_path, "t,u,y\n" + "\n".join(lines) + "\n"))


@pytest.mark.parametrize(
    ("line", "kind", "message", "rows"),
    [
        ("20,oops,4", "damaged", "row 22: column 'u': 'oops' is no number; expected a number", 99),
        ("20,1,2,3", "unread", "row 22: has more cells than the header's 3: those are left out", 99),
        ("battery low", "unread", "row 22: is left out: it has fewer cells than the header's 3: 'batt", 98),
        ("20,1\x00,2\x1b[31m", "damaged", r"row 22: column 'u': '1\x00' is no number", 99),
        (
            "20,1," + "2" * (1 << 20),
            "damaged",
            "row 22: is left out: it has more than 1048576 characters",
            98,
        ),
        ('20,"1,2', "unread", "row 23: is left out: it has fewer cells than the header's 3: '20 1,2", 97),
    ],
)
def test_a_line_that_is_none_costs_itself(line, kind, message, rows, tmp_path):
    lines = [f"{k},1,2" for k in range(99)]
    lines[20] = line
    if '"' in line:
        lines[21] = '"'  # a quote ends somewhere
    recording = read(write(tmp_path, "t,u,y\n" + "\n".join(lines) + "\n"))
    assert len(recording.t) == rows
    told = [p for p in recording.problems if p.kind == kind]
    assert told, recording.problems
    assert message in told[0].message
    assert told[0].message.isprintable()


def test_lines_of_the_same_kind_are_told_once(tmp_path):
    text = "t [s],u,y\n" + "".join(f"{k},1,2,\n" if k % 3 == 1 else f"{k},1,2\n" for k in range(90))
    recording = read(write(tmp_path, text))
    assert len(recording.t) == 90
    (told,) = (p.message for p in recording.problems)
    assert told == "row 3: has more cells than the header's 3: those are left out; so in 30 rows"


@pytest.mark.parametrize(
    "text",
    [
        "t [s],u,y\n" + "".join(f"{k},1,{k / 2},\n" for k in range(90)),
        "t [s],u,y\n" + "".join(f"{k},1,{k / 2},7,8\n" if k % 3 else f"{k},1,{k / 2}\n" for k in range(90)),
        "t [s],u,y,\n" + "".join(f"{k},1,{k / 2}\n" for k in range(90)),
        "logger 7\nt [s];u [V];y;\n" + "".join(f"{k};1;{k / 2}\n" for k in range(90)),
    ],
    ids=["rows end in a comma", "two more", "the header ends in a comma", "with units"],
)
def test_a_header_that_is_shorter_or_longer_than_the_rows_names_them_still(text, tmp_path):
    recording = read(write(tmp_path, text))
    assert recording.y.tolist() == [k / 2 for k in range(90)]
    told = [p.message for p in recording.problems]
    assert (told != []) == (not text.startswith(("t [s],u,y,", "logger")))
    assert all("more cells than the header's 3" in each for each in told)


@pytest.mark.parametrize(
    "header", ["t [s],u,y\n", "# logger 7\nt,u,y\ns,V,\n", ""], ids=["names", "units", "none"]
)
@pytest.mark.parametrize("wide", [1, 3])
def test_rows_that_are_wider_right_below_the_header_are_read(header, wide, tmp_path):
    rows = [f"{k},1,{k / 2}" + ",7" * (k < wide) for k in range(90)]
    columns = {"columns": "t=1,u=2,y=3"} if not header else {}
    recording = read(write(tmp_path, header + "\n".join(rows) + "\n"), **columns)
    assert recording.y.tolist() == [k / 2 for k in range(90)]
    line = header.count("\n") + 1
    told = f"row {line}: has more cells than the header's 3: those are left out"
    assert told in [p.message.partition("; so in")[0] for p in recording.problems]


def test_a_row_that_is_shorter_right_below_the_header_is_said(tmp_path):
    rows = ["0,1", *(f"{k},1,{k / 2}" for k in range(1, 90))]
    recording = read(write(tmp_path, "t [s],u,y\n" + "\n".join(rows) + "\n"))
    assert len(recording.t) == 89
    assert [p.message for p in recording.problems] == [
        "row 2: is left out: it has fewer cells than the header's 3: '0 1'"
    ]


@pytest.mark.parametrize("above", ["t [s],u,y\nRate,1000\n", "3,4\nt [s],u,y\n", "3,4\nt [s],u,y,\n"])
def test_talk_about_the_header_is_no_row(above, tmp_path):
    text = above + "".join(f"{k},1,{k / 2}\n" for k in range(90))
    assert read(write(tmp_path, text)).problems == ()


def test_a_file_that_goes_on_in_another_encoding_is_read_on(tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(
        "".join(["t,u,y,n\n", *(f"{k},1,2,a\n" for k in range(20_000))]).encode() + b"20000,1,2,\xb0\n"
    )
    assert read(path).t[-1] == 20_000.0


@pytest.mark.slow
def test_a_small_file_cannot_take_much_memory(tmp_path):
    path = tmp_path / "run.csv.gz"
    path.write_bytes(bomb(b"1", 1 << 29))
    with pytest.raises(ReadError, match=r"run\.csv\.gz"):
        read(path)
    text = b"t,u,y\n" + b"".join(b"%d,1,2\n" % k for k in range(20_000))
    path.write_bytes(gzip.compress(text) + bomb(b"1", 1 << 29))
    before = peak_mb()
    recording = read(path)
    assert peak_mb() - before < 100.0
    assert len(recording.t) == 20_000
    assert any("more than 1048576 characters" in p.message for p in recording.problems)


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def test_a_last_row_that_is_cut_off_is_left_out_and_said(tmp_path):
    recording = read(write(tmp_path, "t,u,y\n0,1,2\n1,2,3\n2,3"))
    assert recording.t.tolist() == [0.0, 1.0]
    assert [str(p) for p in recording.problems] == [f"{tmp_path / 'run.csv'}: row 4 is cut off and left out"]


def test_a_gzip_file_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path):
    noise = np.random.default_rng(1).normal(size=20_000)
    text = "t [s],u,y\n" + "".join(f"{k},{x!r},1\n" for k, x in enumerate(noise.tolist()))
    path = tmp_path / "run.csv.gz"
    data = gzip.compress(text.encode())
    path.write_bytes(data[: len(data) * 2 // 3])
    recording = read(path)
    assert 5_000 < len(recording.t) < 20_000
    assert recording.u.tolist() == noise[: len(recording.u)].tolist()
    assert [p.kind for p in recording.problems] == ["truncated"]


def test_blocks_are_read_one_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "BLOCK_ROWS", 1000)
    path = write(tmp_path, "t,u,y\n" + "".join(f"{k},1,2\n" for k in range(3500)))
    with open_source(path) as opened:
        blocks = list(opened.blocks({"": ["y"]}))
    assert [len(block.rows) for block in blocks] == [1000, 1000, 1000, 500]
    assert [list(block.values) for block in blocks] == [["y"]] * 4
    assert [block.rows[0] for block in blocks] == [2, 1002, 2002, 3002]


finite = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def tables(draw):
    """Columns of numbers, a separator and a decimal mark that go together."""
    width = draw(st.integers(2, 5))
    rows = draw(st.lists(st.lists(finite, min_size=width, max_size=width), min_size=1, max_size=8))
    separator, decimal = draw(st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]))
    return rows, separator, decimal


@settings(max_examples=100, deadline=None)
@given(table=tables(), talk=st.sampled_from(["", "# a comment\n", "Logger\n\n"]))
def test_any_table_is_found_and_every_digit_kept(table, talk, tmp_path_factory):
    rows, separator, decimal = table
    names = [f"c{k}" for k in range(len(rows[0]))]
    text = io.StringIO()
    writer = csv.writer(text, delimiter=separator, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([[repr(x).replace(".", decimal) for x in row] for row in rows])
    path = tmp_path_factory.mktemp("any") / "x.csv"
    path.write_text(talk + text.getvalue())
    columns, values, _, remarks = whole(path)
    assert [column.name for column in columns] == names
    assert [[float(values[name][k]) for name in names] for k in range(len(rows))] == rows
    assert not remarks


@settings(deadline=None)  # readers are imported when a file begins like theirs
@given(data=st.binary(max_size=400))
def test_any_bytes_are_a_table_or_a_plain_error(data, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "bytes.csv"
    path.write_bytes(data)
    with suppress(ReadError):
        read(path)


@settings(deadline=None)
@given(text=st.text("0123456789.,;-+eE \tnan\n\"'#", max_size=200))
def test_any_text_is_a_table_or_a_plain_error(text, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "text.csv"
    path.write_text(text)
    with suppress(ReadError):
        recording = read(path, columns="t=1,u=2,y=2")
        assert (np.diff(recording.t) > 0).all()


@given(x=finite, decimal=st.sampled_from(".,"))
def test_numbers_keep_all_digits(x, decimal):
    assert number(repr(x).replace(".", decimal), decimal) == x


@pytest.mark.parametrize("cell", ["1.2.3", "1,2", "0x10", "1_0", "12:30", "e5", "--5", "one"])
def test_what_is_no_number(cell):
    assert number(cell, ".") is None


def test_a_header_that_does_not_fit_is_not_taken_for_one():
    found = detect(b"x\nt,u,y\n1,2,3\n4,5,6\n", "x", complete=True)
    assert [column.name for column in found.columns] == ["t", "u", "y"]
    assert found.first == 3


def test_a_cell_of_300_000_digits_is_damage_and_takes_no_time(tmp_path):
    """Its conversion takes time that grows with the square of its length, once for each dialect tried."""
    assert number("1" * 300_000, ".") is None
    rows = [f"{k / 100},{k % 2},{'1' * 300_000 if k == 40 else k}" for k in range(100)]
    recording = read(write(tmp_path, "t,u,y\n" + "\n".join(rows) + "\n"))
    assert len(recording.t) == 99 or not np.isfinite(recording.y[40])
