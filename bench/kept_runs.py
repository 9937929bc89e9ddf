"""Results of long benchmarks, kept in a file: a line for each block of a case; resumable."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

from through import results

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from accuracy_cases import Case

Heard = TypeVar("Heard")


class Runs(Protocol):
    """A module that makes runs: how many are in a block, how one is written and read."""

    BLOCK: int
    __name__: str

    def line(self, case: Case, block: int, digest: str) -> str:
        """A block of a case as a line of JSON."""

    def read(self, path: Path, digest: str | None) -> dict[str, dict[int, list[Any]]]:
        """By case and block."""


class Wanted(NamedTuple):
    """A block of a case, and the module that makes it."""

    module: str
    case: Case
    block: int
    digest: str


def made(wanted: Wanted) -> str:
    """The block as a line of JSON."""
    runs: Runs = import_module(wanted.module)  # type: ignore[assignment] # a module keeps the protocol
    return runs.line(wanted.case, wanted.block, wanted.digest)


def work(runs: Runs, tasks: Sequence[tuple[Case, int]], options: argparse.Namespace, digest: str) -> None:
    """Do what the file does not hold yet."""
    done = runs.read(options.file, digest)
    wanted = [(case, block) for case, block in tasks if re.search(options.only, case.name)]
    missing = [(case, block) for case, block in wanted if block not in done.get(case.name, {})]
    print(f"{len(missing)} blocks of {runs.BLOCK} runs to do; sources {digest}", file=sys.stderr)
    asked = [Wanted(runs.__name__, case, block, digest) for case, block in missing]
    with options.file.open("a") as file:
        if file.tell():
            file.write("\n")  # ends a line that was cut short
        for k, (_, text) in enumerate(results(options, made, asked), 1):
            file.write(text + "\n")
            file.flush()
            if k % 20 == 0 or k == len(missing):
                print(f"{k} of {len(missing)}", file=sys.stderr, flush=True)


def read(path: Path, digest: str | None, heard: Callable[[Any], Heard]) -> dict[str, dict[int, list[Heard]]]:
    """What a file holds by case and block, but for a line cut short at the end.

    Args:
        path: There may be none yet.
        digest: Of the sources whose results count; None: of each case those of its newest line.
        heard: Makes a run's results of their JSON.
    """
    lines = (
        [kept for text in path.read_text().splitlines() if (kept := parsed(text))] if path.exists() else []
    )
    newest = {kept["case"]: kept["digest"] for kept in lines}
    found: dict[str, dict[int, list[Heard]]] = {}
    for kept in lines:
        if kept["digest"] == (digest or newest[kept["case"]]):
            found.setdefault(kept["case"], {})[kept["block"]] = [heard(one) for one in kept["heard"]]
    return found


def parsed(text: str) -> dict[str, Any] | None:
    """A line of the file; None where it was cut short."""
    try:
        kept: dict[str, Any] = json.loads(text)
    except json.JSONDecodeError:
        return None
    return kept


def digest_of(paths: list[Path]) -> str:
    """Of the files' contents, twelve digits."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]


def put(text: str, parts: dict[str, str]) -> str:
    """A document with its tables between `<!-- name -->` and `<!-- end -->` exchanged."""
    for name, part in parts.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        text = before + mark + part + rest[rest.index("<!-- end -->") :] if mark else text
    return text


def tell(
    options: argparse.Namespace,
    runs: Runs,
    digest: str,
    tables: Callable[[Any], dict[str, str]],
    draw: Callable[[Any, Path], None],
    pages: tuple[Path, str],
) -> None:
    """Print the tables of what is kept, or with `--doc` put them and the plots into the pages.

    Args:
        options: With `file` and `doc`.
        runs: Whose results they are.
        digest: Of the sources; pages take the newest of each case.
        tables: By the names that the pages give them.
        draw: Makes the plots in a folder.
        pages: Folder of the documents, and a pattern of their names.
    """
    kept = runs.read(options.file, None if options.doc else digest)
    found = {name: [x for block in blocks.values() for x in block] for name, blocks in kept.items()}
    parts = tables(found)
    if not options.doc:
        print("\n\n".join(f"{name}\n\n{part}" for name, part in parts.items()))
        return
    folder, pattern = pages
    for page in folder.glob(pattern):
        page.write_text(put(page.read_text(), parts))
    draw(found, folder / "img")
