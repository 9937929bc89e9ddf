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

SOURCES = (
    "compiled.py",
    "effects.py",
    "kernel.py",
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
    """Of the sources that the machine code is made of."""
    digest = hashlib.sha256(f"{version('numba')} {sys.implementation.cache_tag}".encode())
    for name in SOURCES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()[:16]


def is_plant_compiled() -> bool:
    """Whether a `sim.plant.Plant` begins without compilation."""
    return are_compiled("plant.arrive", "plant.look")


def are_compiled(*functions: str) -> bool:
    """Whether these functions' machine code is kept; written as `module.function`."""
    folder = cache_folder()
    return folder is not None and all(any(folder.rglob(f"{name}-*.nbi")) for name in functions)


def compile_plant() -> None:
    """Compile what a `sim.plant.Plant` needs, in a process of its own: this one need not import numba.

    Raises:
        subprocess.CalledProcessError: It failed; its stderr tells why.
    """
    subprocess.run([sys.executable, "-m", "sim.cache"], check=True, stdin=subprocess.DEVNULL)


def main() -> None:
    """Have a plant once."""
    from sim.parameters import parameters  # noqa: PLC0415 - whoever asks for the folder needs none of it
    from sim.plant import Plant  # noqa: PLC0415 - numba

    Plant(parameters(1.0, 1.0, 1.0))


if __name__ == "__main__":
    main()
