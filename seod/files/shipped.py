"""Where the files that come with seod are: example rig files and systemd units."""

from __future__ import annotations

import sysconfig
from pathlib import Path


def configs_dir() -> Path:
    """Folder of the example rig files.

    Raises:
        FileNotFoundError: Neither in a checkout nor installed.
    """
    return _find("configs", "virtual.yaml")


def systemd_dir() -> Path:
    """Folder of the systemd units.

    Raises:
        FileNotFoundError: Neither in a checkout nor installed.
    """
    return _find("systemd", "seod@.service")


def _find(folder: str, member: str) -> Path:
    """The folder beside the packages (a checkout), else in the data directory that a wheel installs to."""
    bases = [Path(__file__).resolve().parents[2]]
    schemes = (sysconfig.get_default_scheme(), sysconfig.get_preferred_scheme("user"))
    bases += [Path(sysconfig.get_path("data", scheme)) / "share" / "seod" for scheme in schemes]
    for base in bases:
        if (base / folder / member).is_file():
            return base / folder
    raise FileNotFoundError(f"no {folder}/{member} in any of {', '.join(map(str, bases))}")
