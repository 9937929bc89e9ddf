"""A batch from its files to its table: what is not done yet is handed out, kept, and told."""

from __future__ import annotations

import csv
import inspect
import io
import json
from typing import TYPE_CHECKING, Any, NamedTuple

from seod.batch.executor import Failed, completed
from seod.batch.folder import Results, whole
from seod.batch.inputs import common_folder, files_of, located, seeds_of
from seod.batch.kinds import KINDS, figure
from seod.batch.task import FILE_OPTIONS, Task, key_of, without_paths, work

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from seod.batch.executor import Executor

    Show = Callable[[str, float], None]

STEPS = 20
"""So often plain lines tell how far all is."""


class Outcome(NamedTuple):
    """What became of a batch.

    Attributes:
        inputs: All.
        before: Done by an earlier run.
        failures: Name of each input without an answer, and why.
        table: Where the table is.
    """

    inputs: int
    before: int
    failures: dict[str, str]
    table: Path


class Batch:
    """One question of many files, whose results a folder keeps. A context manager.

    Args:
        kind: A key of `KINDS`.
        files: Recordings, or folders of them; of `simulate` rig files.
        out: Folder of the results.
        options: Of the question, by the names of the Python interface; those that are None are left out.
        seeds: Of `simulate`: `0-99`.

    Raises:
        ValueError: Options or files do not go with the kind or the folder.
        OSError: A folder or a rig file cannot be read or written.
    """

    def __init__(
        self, kind: str, files: Sequence[Path], out: Path, options: dict[str, Any], seeds: str | None = None
    ) -> None:
        self.kind = kind
        given = {name: value for name, value in options.items() if value is not None}
        self.options = _right(kind, given, seeds)
        every = files_of(files)
        numbers = seeds_of(seeds or "0") if kind == "simulate" else None
        self._results = Results(out, kind)
        try:
            self._base = self._based(every, out)
            self.tasks = self._tasks(every, numbers)
        except BaseException:
            self._results.close()
            raise
        self.done = 0
        self.failures: dict[str, str] = {}

    def __enter__(self) -> Batch:
        return self

    def __exit__(self, *_: object) -> None:
        self._results.close()

    def run(self, executor: Executor, show: Show = lambda _what, _part: None) -> Outcome:
        """Do what is not done yet, and write the table.

        Args:
            executor: Who does it.
            show: Takes how far it is.

        Raises:
            StoppedError: As of the executor; what was done is kept.
            OSError: A result cannot be written.
        """
        missing = [task for task in self.tasks if not self._results.is_done(task)]
        before = self.done = len(self.tasks) - len(missing)
        self._tell(show)
        for task, made in completed(executor, work, missing):
            if isinstance(made, Failed):
                self.failures[task.name] = without_paths(made.why, task)
            else:
                self._results.keep(task, made)
            self.done += 1
            self._tell(show)
        self._write_table()
        order = {task.name: k for k, task in enumerate(self.tasks)}
        failures = dict(sorted(self.failures.items(), key=lambda each: order[each[0]]))
        return Outcome(len(self.tasks), before, failures, self._results.table)

    def _tell(self, show: Show) -> None:
        total = len(self.tasks)
        told = self.done - self.done % max(1, total // STEPS)
        failed = f", {len(self.failures)} failed" if self.failures else ""
        show(f"{self.kind}: {told} of {total}{failed}", self.done / total)

    def _based(self, every: Sequence[Path], out: Path) -> Path:
        """The folder from which names start: that of the first run, so that names stay."""
        base = self._results.base
        if base is None:
            base = common_folder(every)
            self._results.based(base)
        outside = next((path for path in every if not path.is_relative_to(base)), None)
        if outside is not None:
            raise ValueError(
                f"{outside} is not in {base}, from where {out} names its {self.kind} results: "
                "give another --out"
            )
        return base

    def _tasks(self, every: Sequence[Path], numbers: Sequence[int] | None) -> list[Task]:
        found = []
        key = key_of(self.kind, self.options)
        for path in every:
            name = path.relative_to(self._base).as_posix()
            if numbers is None:
                found.append(Task(self.kind, str(path), name, self.options, key))
                continue
            for seed in numbers:
                options = self.options | {"seed": seed}
                drawn = f"{name.removesuffix(path.suffix)}/seed-{seed:06d}"
                found.append(Task(self.kind, str(path), drawn, options, key_of(self.kind, options)))
        return found

    def _write_table(self) -> None:
        """`file`, the key figures, `error`: a row for each input, in the order given."""
        figures = KINDS[self.kind].figures
        with whole(self._results.table) as raw:
            text = io.TextIOWrapper(raw, "utf-8", newline="")
            rows = csv.writer(text, lineterminator="\n")
            rows.writerow(["file", *figures, "error"])
            for task, told in self._read():
                answer = None if told is None else told["answer"]
                if (why := self.failures.get(task.name)) is None and told is not None and told["error"]:
                    why = self.failures[task.name] = told["error"]
                values = [figure(answer, place) for place in figures.values()]
                rows.writerow([task.name, *map(_cell, values), why or ""])
            text.flush()
            text.detach()

    def _read(self) -> Iterator[tuple[Task, dict[str, Any] | None]]:
        """Every task with its result; of one that failed none, even if an older one is there."""
        for task in self.tasks:
            yield task, None if task.name in self.failures else self._results.read(task.name)


def _right(kind: str, given: dict[str, Any], seeds: str | None) -> dict[str, Any]:
    """Options as they are kept: files as absolute paths.

    Raises:
        ValueError: One is not of this kind.
    """
    known = inspect.signature(KINDS[kind].function).parameters
    wrong = [f"--{name.replace('_', '-')}" for name in given if name not in known]
    wrong += ["--config"] if kind == "simulate" and "config" in given else []
    wrong += ["--seeds"] if kind != "simulate" and seeds is not None else []
    if wrong:
        raise ValueError(f"{', '.join(sorted(set(wrong)))}: not an option of {kind}")
    files = {name: str(located(given[name])) for name in FILE_OPTIONS if name in given}
    right: dict[str, Any] = json.loads(json.dumps(given | files, default=str))
    return right


def _cell(value: Any) -> str:
    """Numbers with all their digits; what is undefined is empty."""
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)
