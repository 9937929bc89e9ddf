"""Compilation of the kernel's functions by numba, kept from one process to the next (`sim.cache`).

Importing this costs the import of numba: only what simulates does so, and late.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

import numba

from sim.cache import cache_folder

if TYPE_CHECKING:
    from collections.abc import Callable

F = TypeVar("F", bound="Callable[..., Any]")

Record: TypeAlias = Any
"""One element of a structured array; its fields are those of the array's type."""


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
