"""A batch without workers: order, window, resuming, failures, and bytes that depend on nothing else."""

from __future__ import annotations

import csv
import json
import random
import re
from collections import deque
from pathlib import Path

import pytest
from batch_tasks import write_recordings
from test_cli import invoke

import seod
from seod.batch import kinds
from seod.batch.door import door
from seod.batch.executor import AHEAD, Failed, Here, StoppedError, attempted, completed
from seod.batch.inputs import files_of, seeds_of
from seod.batch.run import Batch

ASKED: list[str] = []


def told(path, options):
    """Instead of an identification: the length of the file; some cannot be answered."""
    ASKED.append(path)
    text = Path(path).read_text()
    if text == "bad":
        raise ValueError(f"{path}: holds nothing")
    if text == "broken":
        raise ZeroDivisionError("no such luck")
    return {"K_L": {"value": float(len(text)) / 3.0, "sd": None}, "said": [f"as in {path}"], **options}, b""


@pytest.fixture(autouse=True)
def _asked(monkeypatch):
    ASKED.clear()
    monkeypatch.setitem(kinds.KINDS, "identify", kinds.KINDS["identify"]._replace(ask=told))


@pytest.fixture
def folder(tmp_path):
    source = tmp_path / "recordings"
    (source / "deeper").mkdir(parents=True)
    for k in range(9):
        (source / f"run-{k}.csv").write_text("x" * k)
    (source / "deeper" / "run-0.csv").write_text("bad")
    (source / "notes.txt").write_text("no recording")
    return source


class Shuffled:
    """Ends tasks in any order, and remembers how many were under way."""

    def __init__(self, seed, slots=2, breaks_after=10**9):
        self.slots, self.most, self.breaks_after = slots, 0, breaks_after
        self.random, self.under_way = random.Random(seed), deque()

    def submit(self, number, function, item):
        self.under_way.append((number, function, item))
        self.most = max(self.most, len(self.under_way))

    def next(self):
        self.breaks_after -= 1
        if self.breaks_after < 0:
            raise StoppedError("the power went away")
        self.under_way.rotate(self.random.randrange(len(self.under_way)))
        number, function, item = self.under_way.popleft()
        return number, attempted(function, item)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def run(folder, out, executor=None, **options):
    with Batch("identify", [folder], out, options) as batch:
        return batch.run(executor or Here())


def written(out):
    files = [path for path in out.rglob("*") if path.is_file() and path.suffix != ".journal"]
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


@pytest.mark.parametrize("seed", range(5))
def test_any_order_writes_the_same_bytes(folder, tmp_path, seed):
    run(folder, tmp_path / "here")
    outcome = run(folder, tmp_path / "shuffled", Shuffled(seed))
    assert written(tmp_path / "here") == written(tmp_path / "shuffled")
    assert outcome.failures == {"deeper/run-0.csv": "deeper/run-0.csv: holds nothing"}
    assert str(tmp_path).encode() not in b"".join(written(tmp_path / "here").values())


def test_the_table_has_a_row_for_each_input_in_order(folder, tmp_path):
    run(folder, tmp_path / "out", Shuffled(3))
    with (tmp_path / "out" / "identify.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows] == [*(f"run-{k}.csv" for k in range(9)), "deeper/run-0.csv"]
    assert [row["K_L"] for row in rows[:4]] == ["0.0", repr(1.0 / 3.0), repr(2.0 / 3.0), "1.0"]
    assert rows[-1]["error"] == "deeper/run-0.csv: holds nothing"
    result = json.loads((tmp_path / "out" / "identify" / "run-2.csv.json").read_text())
    assert result["answer"]["said"] == ["as in run-2.csv"]
    assert result["size"] == 2


@pytest.mark.parametrize("breaks_after", [0, 1, 5, 9])
def test_what_is_done_is_not_done_again(folder, tmp_path, breaks_after):
    run(folder, tmp_path / "whole")
    ASKED.clear()
    with pytest.raises(StoppedError):
        run(folder, tmp_path / "out", Shuffled(1, breaks_after=breaks_after))
    assert not (tmp_path / "out" / "identify.csv").exists()
    outcome = run(folder, tmp_path / "out")
    assert outcome.before == breaks_after
    assert len(ASKED) == len(set(ASKED)) == 10
    assert written(tmp_path / "out") == written(tmp_path / "whole")
    assert run(folder, tmp_path / "out").before == 10
    assert len(ASKED) == 10


@pytest.mark.parametrize("end", ["", '{"name": "run-3.csv", "key', "null\n"])
def test_a_torn_or_lost_journal_asks_nothing_again(folder, tmp_path, end):
    run(folder, tmp_path / "out")
    journal = tmp_path / "out" / "identify.journal"
    journal.write_text(journal.read_text()[:150] + "\n" + end)
    ASKED.clear()
    assert run(folder, tmp_path / "out").before == 10
    assert ASKED == []


def test_what_changed_is_done_again_and_nothing_else(folder, tmp_path):
    run(folder, tmp_path / "out")
    ASKED.clear()
    (folder / "run-3.csv").write_text("other")
    (folder / "run-4.csv").touch()  # the same content
    (tmp_path / "out" / "identify" / "run-5.csv.json").unlink()
    run(folder, tmp_path / "out")
    assert sorted(path[-9:] for path in ASKED) == ["run-3.csv", "run-5.csv"]
    ASKED.clear()
    assert run(folder, tmp_path / "out", gain=17.0).before == 0
    assert len(ASKED) == 10
    ASKED.clear()
    assert run(folder, tmp_path / "out", gain=17.0).before == 10


def test_what_did_not_go_well_is_tried_again_and_told(folder, tmp_path):
    (folder / "run-6.csv").write_text("broken")
    missing = folder / "gone.csv"
    for _ in range(2):
        with Batch("identify", [folder, missing], tmp_path / "out", {}) as batch:
            outcome = batch.run(Here())
        assert outcome.failures == {
            "run-6.csv": "ZeroDivisionError: no such luck",
            "deeper/run-0.csv": "deeper/run-0.csv: holds nothing",
            "gone.csv": "gone.csv: No such file or directory",
        }
    (folder / "run-6.csv").write_text("fine")
    assert "run-6.csv" not in run(folder, tmp_path / "out").failures


@pytest.mark.parametrize(("slots", "ahead"), [(1, AHEAD), (3, AHEAD), (5, 1)])
def test_no_more_tasks_are_under_way_than_the_window_holds(slots, ahead):
    taken = []

    def items():
        for k in range(100):
            taken.append(k)
            yield k

    executor = Shuffled(7, slots)
    seen = []
    for item, result in completed(executor, lambda k: -k, items(), ahead):
        seen.append(item)
        assert result == -item
        assert len(taken) <= len(seen) - 1 + slots * ahead
    assert sorted(seen) == list(range(100))
    assert executor.most == slots * ahead


def test_a_failure_is_no_end():
    def task(k):
        return 1 // k

    done = dict(completed(Here(), task, [0, 1]))
    assert done == {0: Failed("ZeroDivisionError: integer division or modulo by zero"), 1: 1}


def test_names_start_where_the_first_run_let_them_start(folder, tmp_path):
    run(folder, tmp_path / "out")
    with Batch("identify", [folder / "deeper"], tmp_path / "out", {}) as batch:
        assert [task.name for task in batch.tasks] == ["deeper/run-0.csv"]
        assert batch.run(Here()).before == 1
    other = tmp_path / "other.csv"
    other.write_text("x")
    with pytest.raises(ValueError, match=r"is not in .*recordings, from where .*: give another --out"):
        Batch("identify", [other], tmp_path / "out", {})


@pytest.mark.parametrize(
    ("kind", "options", "seeds", "said"),
    [
        ("identify", {"effort": "quick", "band": "1:2"}, None, "--band, --effort: not an option of identify"),
        ("simulate", {"config": "x.yaml"}, None, "--config: not an option of simulate"),
        ("diagnose", {}, "0-9", "--seeds: not an option of diagnose"),
        ("simulate", {}, "9-0", "9-0 must rise"),
        ("simulate", {}, "a", "give numbers and ranges"),
    ],
)
def test_options_of_another_kind_are_refused(folder, tmp_path, kind, options, seeds, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        Batch(kind, [folder / "run-0.csv"], tmp_path / "out", options, seeds)


def test_files_and_seeds_are_taken_once(folder, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert seeds_of("3,0-2,1") == [0, 1, 2, 3]
    assert len(files_of([folder, folder / "run-1.csv"])) == 10
    with pytest.raises(ValueError, match="no recording in these folders"):
        files_of([empty])


@pytest.mark.parametrize(
    ("given", "said"),
    [(("host:8786", None), "give local, or an address"), (("tcp://host:8786", 2), "has its own")],
)
def test_a_scheduler_that_is_none_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        door(*given)


def test_the_command_tells_failures_and_fails(folder, tmp_path):
    code, out, _ = invoke("batch", "identify", folder, "--workers", "0", "--out", tmp_path / "out")
    assert code == 1
    assert out.splitlines() == [
        "! deeper/run-0.csv: holds nothing",
        f"identify: 10 files, 1 failed; table: {tmp_path / 'out' / 'identify.csv'}",
    ]
    code, out, _ = invoke(
        "batch", "identify", folder / "run-1.csv", "--workers", "0", "--out", tmp_path / "out"
    )
    assert (code, "1 files, 1 of them before, 0 failed" in out) == (0, True)


@pytest.mark.slow
def test_simulated_recordings_are_the_same_in_each_run_and_can_be_asked(tmp_path):
    from seod.files.shipped import configs_dir

    rig = configs_dir() / "virtual.yaml"
    for out in ("one", "two"):
        with Batch("simulate", [rig], tmp_path / out, {"duration": 1.0}, "0-1") as batch:
            assert batch.run(Here()).failures == {}
    assert written(tmp_path / "one") == written(tmp_path / "two")
    made = written(tmp_path / "one")
    assert "simulate/virtual/seed-000001.csv.gz" in made
    assert made["simulate/virtual/seed-000000.csv.gz"] != made["simulate/virtual/seed-000001.csv.gz"]
    assert [path.name for path in files_of([tmp_path / "one" / "simulate"])] == [
        "seed-000000.csv.gz",
        "seed-000001.csv.gz",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "options"), [("diagnose", {"effort": "quick"}), ("response", {})])
def test_an_answer_in_a_batch_is_that_of_the_python_interface(tmp_path, monkeypatch, kind, options):
    monkeypatch.undo()  # the real questions
    write_recordings(tmp_path / "recordings", 1, 1500)
    with Batch(kind, [tmp_path / "recordings"], tmp_path / "out", options) as batch:
        outcome = batch.run(Here())
    assert outcome.failures == {}
    told = json.loads((tmp_path / "out" / kind / "run-00000.csv.json").read_text())
    path = tmp_path / "recordings" / "run-00000.csv"
    assert told["answer"] == getattr(seod, kind)(path, **options).to_dict()
