"""`seod export`: a recording in the form of other tools, block by block."""

from __future__ import annotations

import os
import re
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from seod.data.progress import shown
from seod.data.source import Column, Group, ReadError, Table
from seod.data.writers import ONE_GROUP, SUFFIXES, WRITERS
from seod.files.user_files import create_recording, named, restrict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from seod.data.recording import Recording
    from seod.data.source import Source
    from seod.data.writers import Writer

_ROLES = ("t", "u", "y", "t_u", "ps", "temperature", "f")


@dataclass
class Exported:
    """What was written.

    Attributes:
        files: Their paths.
        said: What is not in them, for people.
    """

    files: list[Path] = field(default_factory=list)
    said: list[str] = field(default_factory=list)


def as_table(recording: Recording) -> Table:
    """A recording as a source: its standard columns in SI units."""
    arrays = {name: getattr(recording, name) for name in _ROLES if getattr(recording, name) is not None}
    columns = tuple(Column(name, recording.units.get(name, "s" if name == "t_u" else "")) for name in arrays)
    return Table(recording.paths[0], "recording", (Group("", columns, "t"),), {"": arrays})


def export(
    source: Source, kind: str, out: Path, groups: Sequence[str] = (), overwrite: bool = False
) -> Exported:
    """Write groups of a source into one file, or into one each where the format holds one table.

    Args:
        source: What to read.
        kind: `csv, parquet, mat, mdf`.
        out: The file; where there are several, their group's name is put before the suffix.
        groups: Names; those with measured data if there are none.
        overwrite: Replace files that exist.

    Raises:
        ReadError: It cannot be read, or not be put into this form.
        OSError: It cannot be written.
    """
    chosen = _chosen(source, groups)
    files = _files(out, kind, chosen)
    for path in files:
        _check(path, source, overwrite)
    with ExitStack() as stack:
        writers: dict[str, Writer] = {}
        for path, own in files.items():
            writer = stack.enter_context(_writing(path, kind, own, source))
            writers |= {group.name: writer for group in own}
        wanted = {group.name: [column.name for column in group.columns] for group in chosen}
        for block in shown(source.blocks(wanted), source.path.name):
            writers[block.group.name].write(block)
    left_out = sum(writer.left_out for writer in set(writers.values()))
    return Exported(list(files), [*_said(source, chosen), *_left_out(left_out)])


def _check(path: Path, source: Source, overwrite: bool) -> None:
    if path.resolve() == source.path.resolve():
        raise ReadError(f"{path}: is the recording itself; `--out FILE` names another")
    if path.exists() and not overwrite:
        raise ReadError(f"{path}: exists; `--force` replaces it")


def _said(source: Source, chosen: Sequence[Group]) -> list[str]:
    """What the reader noticed, and what else is in the file."""
    others = [group.name for group in source.groups if group not in chosen]
    more = [f"also in it, `--group NAME` exports it: {', '.join(others)}"] if others else []
    return [remark.message for remark in dict.fromkeys(source.remarks)] + more


def _left_out(rows: int) -> list[str]:
    return [f"{rows} rows without a time are left out"] if rows else []


def _chosen(source: Source, names: Sequence[str]) -> list[Group]:
    if not names:
        return [group for group in source.groups if group.main]
    known = {group.name: group for group in source.groups}
    for name in names:
        if name not in known:
            raise ReadError(f"{source.path}: no group {name!r}; there is {', '.join(map(repr, known))}")
    return [known[name] for name in dict.fromkeys(names)]


def _files(out: Path, kind: str, chosen: Sequence[Group]) -> dict[Path, list[Group]]:
    if len(chosen) == 1 or kind not in ONE_GROUP:
        return {out: list(chosen)}
    paths = [out.with_name(f"{out.stem}.{_plain(group.name)}{out.suffix}") for group in chosen]
    return {path: [group] for path, group in zip(paths, chosen, strict=True)}


def _plain(name: str) -> str:
    """A group's name as part of a file's."""
    return re.sub(r"[^\w.-]+", "-", name).strip("-")


@contextmanager
def _writing(path: Path, kind: str, groups: Sequence[Group], source: Source) -> Iterator[Writer]:
    """A writer whose file appears under its name only when it is complete."""
    part = path.with_name(f".part-{path.name}{SUFFIXES[kind]}")  # asammdf insists on its suffix
    try:
        with named(path, part):
            os.close(create_recording(part))
            writer = WRITERS[kind](part, groups, dict(source.notes))
            try:
                yield writer
            except BaseException:
                with suppress(Exception):  # what it says of half a file would hide why it is half
                    writer.close()
                raise
            writer.close()
            restrict(part)  # asammdf has put a file of its own there
            part.replace(path)
    except ReadError as error:
        raise ReadError(str(error).replace(str(part), str(path))) from error
    finally:
        part.unlink(missing_ok=True)


def default_path(path: Path, kind: str) -> Path:
    """Beside the recording, with the format's suffix: `run.csv.gz` to `run.mat`."""
    whole = path.with_name(path.name.removesuffix(".gz"))
    return whole.with_name(whole.stem + SUFFIXES[kind])
