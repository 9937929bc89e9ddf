"""Which files are asked, under which names, and which seeds are drawn."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

ENDINGS = (".mcap", ".csv", ".csv.gz", ".parquet", ".pq", ".mat", ".mf4", ".mdf", ".blf", ".asc", ".trc")
"""Of files that are taken for recordings where a folder is given."""
MOST_SEEDS = 10_000_000


def files_of(given: Iterable[Path]) -> list[Path]:
    """Files, and all recordings below folders, as absolute paths, each once, in the order given.

    Raises:
        ValueError: There is none.
    """
    every = [path for each in given for path in _below(located(each))]
    if not every:
        raise ValueError(f"no recording in these folders: names must end in {', '.join(ENDINGS)}")
    return list(dict.fromkeys(every))


def located(path: Path) -> Path:
    """Its absolute path; a link to a file keeps its own name."""
    return path.resolve() if path.is_dir() else path.parent.resolve() / path.name


def _below(path: Path) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    for folder, folders, names in os.walk(path):
        folders.sort()
        yield from (Path(folder, name) for name in sorted(names) if name.lower().endswith(ENDINGS))


def common_folder(paths: Sequence[Path]) -> Path:
    """The deepest one that holds all."""
    return Path(os.path.commonpath([path.parent for path in paths]))


def seeds_of(text: str) -> list[int]:
    """`0-99`, `3`, or `0-9,20,30-39`: rising and each once.

    Raises:
        ValueError: It is none of these.
    """
    seeds: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        if not (first.isdecimal() and (last or first).isdecimal()):
            raise ValueError(f"--seeds {text}: give numbers and ranges, such as 0-99 or 1,4,10-19")
        begin, end = int(first), int(last or first)
        if not begin <= end or end - begin >= MOST_SEEDS:
            raise ValueError(f"--seeds {text}: {part} must rise, and be {MOST_SEEDS} seeds at most")
        seeds.update(range(begin, end + 1))
    return sorted(seeds)
