"""Where the kernel's machine code is kept from one process to the next, and whether it is there.

Needs no numba: `seod run` asks before it starts anything. numba itself notices changes of a function's own
file only, not of what it calls; so each state of the sources has a folder of its own.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

SOURCES = (
    "compiled.py",
    "effects.py",
    "exact.py",
    "hydraulics/closed_loop.py",
    "hydraulics/flow.py",
    "hydraulics/live.py",
    "hydraulics/motion.py",
    "hydraulics/parts.py",
    "hydraulics/record.py",
    "kernel.py",
    "matrix_steps.py",
    "parameters.py",
    "physics.py",
    "plant.py",
    "runs.py",
    "state.py",
    "substep.py",
    "windows.py",
)


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
    """Of the sources that the machine code is made of, and of their folder: numba shares none between two."""
    here = Path(__file__).parent
    digest = hashlib.sha256(f"{version('numba')} {sys.implementation.cache_tag} {here}".encode())
    for name in SOURCES:
        digest.update((here / name).read_bytes())
    return digest.hexdigest()[:16]


REDUCED = ("plant.arrive", "plant.look")
HYDRAULIC = ("live.feed", "live.sight")
"""What plants of a rig need of the machine code, by their kind."""


def is_plant_compiled(kinds: Collection[str] = ("reduced",)) -> bool:
    """Whether plants of these kinds, as rig files name them, begin without compilation."""
    return all(are_compiled(*(HYDRAULIC if kind == "hydraulic" else REDUCED)) for kind in kinds)


def are_compiled(*functions: str) -> bool:
    """Whether the machine code of these functions is kept; each is written as `module.function`."""
    folder = cache_folder()
    return folder is not None and all(any(folder.rglob(f"{name}-*.nbi")) for name in functions)


def compile_plant(kinds: Collection[str] = ("reduced",)) -> None:
    """Compile what plants of these kinds need, in a process of its own: this one need not import numba.

    Raises:
        subprocess.CalledProcessError: It failed; its stderr tells why.
    """
    command = [sys.executable, "-m", "sim.compile_plant", *kinds]
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL)  # noqa: S603 - our own
