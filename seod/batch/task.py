"""A task: one question of one file, answered as bytes that depend on file and options alone.

No time, machine or absolute path is in them, so that any number of workers in any order gives the same.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from threadpoolctl import ThreadpoolController

from seod import __version__
from seod.batch.kinds import KINDS
from seod.config.errors import ConfigErrors
from seod.data.source import ReadError
from seod.diagnose.result import DiagnoseError
from seod.identify.record import IdentifyError
from seod.respond.record import RespondError

REFUSED = (ReadError, IdentifyError, DiagnoseError, RespondError, ConfigErrors, ValueError)
"""Answers as well: the same file with the same options is refused again. All else may go well next time."""
FILE_OPTIONS = ("config",)
"""Options that name files: what is in those counts, not where they are."""


class Task(NamedTuple):
    """One question.

    Attributes:
        kind: A key of `KINDS`.
        path: The file, as workers find it.
        name: By which results and messages call it, `/` between folders.
        options: Of the question, by the names of the Python interface; JSON-able.
        key: Stands for kind, options and version: `key_of`.
    """

    kind: str
    path: str
    name: str
    options: dict[str, Any]
    key: str


class Made(NamedTuple):
    """What a task makes.

    Attributes:
        answer: JSON: `file`, `sha256` and `size` of it, `kind`, `options`, `version`, `key`, and `answer` or
            `error`: one of them null.
        recording: Bytes of a simulated recording, else none.
    """

    answer: bytes
    recording: bytes


def work(task: Task) -> Made:
    """Do a task.

    Raises:
        OSError: The file cannot be read.
    """
    digest, size = content(Path(task.path))
    told: dict[str, Any] = {
        "file": task.name,
        "sha256": digest,
        "size": size,
        "kind": task.kind,
        "options": task.options,
        "version": __version__,
        "key": task.key,
        "answer": None,
        "error": None,
    }
    recording = b""
    try:
        with _blas().limit(limits=1, user_api="blas"):  # sums of several threads differ in their last digits
            told["answer"], recording = KINDS[task.kind].ask(task.path, task.options)
    except REFUSED as error:
        told["error"] = " ".join(str(error).split())
    named = without_paths(told, task)
    return Made(json.dumps(named, allow_nan=False, indent=1).encode() + b"\n", recording)


@cache
def _blas() -> Any:
    """Made when all libraries are loaded; to look for them takes 20 ms."""
    return ThreadpoolController()


def without_paths(told: Any, task: Task) -> Any:
    """The same with names of files in the place of their paths, wherever a text has them."""
    words = {task.path: task.name}
    for name in FILE_OPTIONS & task.options.keys():
        words[task.options[name]] = Path(task.options[name]).name
    return _replaced(told, words)


def _replaced(told: Any, words: dict[str, str]) -> Any:
    if isinstance(told, dict):
        return {name: _replaced(each, words) for name, each in told.items()}
    if isinstance(told, list | tuple):
        return [_replaced(each, words) for each in told]
    if isinstance(told, str):
        for path in sorted(words, key=len, reverse=True):
            told = told.replace(path, words[path])
    return told


def key_of(kind: str, options: dict[str, Any]) -> str:
    """Sixteen digits for what is asked: kind, options, content of files that they name, version of seod.

    Raises:
        OSError: A file that an option names cannot be read.
    """
    named = {name: content(Path(options[name]))[0] for name in FILE_OPTIONS if name in options}
    text = json.dumps([__version__, kind, options | named], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def content(path: Path) -> tuple[str, int]:
    """SHA-256 of a file, and its size [bytes].

    Raises:
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return digest, file.tell()
