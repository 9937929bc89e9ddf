"""Changes values in a rig file and leaves the rest as it is: comments, order, line breaks."""

from __future__ import annotations

import difflib
import io
import os
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.resolver import VersionedResolver

from seod.config.load import load_text
from seod.files.user_files import create_recording, named

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.config.errors import KeyPath


REMOVED: Final = object()
"""As a value: the key goes, with all that stands under it."""


class _Words(VersionedResolver):
    """Takes every plain scalar as text, so that `1.0e-3` and `null` stay as they were written."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        return self.DEFAULT_SCALAR_TAG if kind is ScalarNode else super().resolve(kind, value, implicit)


def edited(text: str, values: Mapping[KeyPath, Any]) -> str:
    """The text with new values at these paths; sections that are not there yet are made.

    Args:
        text: A rig file that loads.
        values: New values by path; mappings, lists, numbers, text or `REMOVED`.
    """
    yaml = YAML()
    yaml.Resolver = _Words
    yaml.preserve_quotes = True
    yaml.width = 1 << 16
    document = yaml.load(text)
    new = [path for path, value in values.items() if isinstance(value, dict) and not _known(document, path)]
    for path, value in values.items():
        section = document
        for key in path[:-1]:
            section = section.setdefault(key, CommentedMap())
        if value is REMOVED:
            section.pop(path[-1], None)
        else:
            section[path[-1]] = _written(value)
    out = io.StringIO()
    yaml.dump(document, out)
    lines = out.getvalue().splitlines(keepends=True)
    for path in new:
        start = yaml.load("".join(lines))
        for key in path[:-1]:
            start = start[key]
        _close_up(lines, start.lc.key(path[-1])[0])
    return "".join(lines)


def _known(document: Any, path: KeyPath) -> bool:
    for key in path:
        if key not in document:
            return False
        document = document[key]
    return True


def _close_up(lines: list[str], at: int) -> None:
    """Move a new section above the blank lines and comments that lead to what follows it."""
    indent = _indent(lines[at])
    first = at
    while first and (not lines[first - 1].strip() or lines[first - 1].lstrip().startswith("#")):
        first -= 1
    last = at + 1
    while last < len(lines) and lines[last].strip() and _indent(lines[last]) > indent:
        last += 1
    lines[first:last] = lines[at:last] + lines[first:at]


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _written(value: Any, inside: bool = False) -> Any:
    """Numbers as text; lists, and mappings below the outermost, on one line."""
    if isinstance(value, dict):
        made = CommentedMap({key: _written(each, inside=True) for key, each in value.items()})
        if inside:
            made.fa.set_flow_style()
        return made
    if isinstance(value, list | tuple):
        row = CommentedSeq([_written(each, inside=True) for each in value])
        row.fa.set_flow_style()
        return row
    return _number(value) if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    """With a point and a sign, without which readers of YAML 1.1 take it for text."""
    mantissa, e, exponent = repr(value).partition("e")
    point = ".0" if e and "." not in mantissa else ""
    return f"{mantissa}{point}{e}{exponent}"


def difference(path: Path, before: str, after: str) -> str:
    """What would change, as a unified diff."""
    old, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
    return "".join(difflib.unified_diff(old, new, fromfile=str(path), tofile=f"{path} (new)", n=1))


def backup_path(path: Path) -> Path:
    """A name beside the file that is not taken: rig.yaml.bak, rig.yaml.bak2 ..."""
    number = 1
    while (backup := path.with_name(f"{path.name}.bak{number if number > 1 else ''}")).exists():
        number += 1
    return backup


def replace_file(path: Path, text: str) -> Path:
    """Put a new text in place of a rig file, all at once; returns where the old one is kept.

    Raises:
        ConfigErrors: The new text is no valid rig file; nothing was changed.
        OSError: It cannot be written; nothing was changed.
    """
    path = path.resolve()
    load_text(text, str(path), path.parent)
    backup = backup_path(path)
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with named(path), os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        shutil.copymode(path, name)
        os.close(create_recording(backup))  # it may hold tokens: open to nobody until it has the file's mode
        shutil.copy2(path, backup)
        Path(name).replace(path)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise
    return backup
