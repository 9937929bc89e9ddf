"""Compilation of the kernel's functions by numba, kept from one process to the next.

Importing this costs the import of numba: only what simulates does so, and late. numba itself notices changes
of a function's own file only, not of what it calls; so each state of the sources has a folder of its own.
"""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

import numba

if TYPE_CHECKING:
    from collections.abc import Callable

F = TypeVar("F", bound="Callable[..., Any]")

Record: TypeAlias = Any
"""One element of a structured array; its fields are those of the array's type."""

SOURCES = ("compiled.py", "effects.py", "kernel.py", "parameters.py", "physics.py", "runs.py", "state.py")


def compiled(function: F) -> F:
    """`function` as machine code, compiled at its first call; it releases the interpreter's lock."""
    return _made(function)


def inlined(function: F) -> F:
    """`compiled`, and put into its callers' code: for what is called in every substep."""
    return _made(function, forceinline=True)


def _made(function: F, **more: bool) -> F:
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", **more}
    folder = cache_folder()
    if folder is None:
        return cast("F", numba.njit(**options)(function))
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        return cast("F", numba.njit(cache=True, **options)(function))
    finally:
        config.CACHE_DIR = before


@cache
def cache_folder() -> Path | None:
    """Where machine code is kept: in NUMBA_CACHE_DIR, the service's CACHE_DIRECTORY or the user's cache.

    None where nothing can be written: then it is compiled in each process anew.
    """
    user = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    for home in (os.environ.get("NUMBA_CACHE_DIR"), os.environ.get("CACHE_DIRECTORY"), user):
        if not home:
            continue
        folder = Path(home) / "seod" / f"kernel-{_fingerprint()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return None


def _fingerprint() -> str:
    """Of the sources that the machine code is made of."""
    digest = hashlib.sha256(numba.__version__.encode())
    for name in SOURCES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()[:16]
