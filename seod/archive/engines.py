"""The libraries of the extra `archive`, loaded when they are first used."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class ArchiveError(Exception):
    """An archive cannot be built or asked; the message says why and what would be right."""


def engine(name: str, extra: str = "archive") -> Any:
    """A module of an optional library.

    Args:
        name: Of the module: `pyarrow.dataset`.
        extra: That brings it.

    Raises:
        ArchiveError: It is not installed; names the extra.
    """
    try:
        return import_module(name)
    except ImportError as error:
        library = name.partition(".")[0]
        raise ArchiveError(f"this needs {library}: pip install 'seod[{extra}]'") from error
