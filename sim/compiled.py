"""Compilation of the kernel's functions by numba, kept in a cache from one process to the next.

Importing this costs the import of numba: only what simulates does so, and late.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

import numba

if TYPE_CHECKING:
    from collections.abc import Callable

F = TypeVar("F", bound="Callable[..., Any]")

Record: TypeAlias = Any
"""One element of a structured array; its fields are those of the array's type."""


def compiled(function: F) -> F:
    """`function` as machine code, compiled at its first call; it releases the interpreter's lock.

    The code is kept beside the source, or in NUMBA_CACHE_DIR, or in the user's cache; where none of them can be
    written it is compiled in each process anew.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return cast("F", numba.njit(cache=True, **options)(function))
    except RuntimeError:  # no place for the cache
        return cast("F", numba.njit(**options)(function))
