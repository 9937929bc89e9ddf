"""Where the rig files, their schema, the DBC and the systemd unit are: in a checkout or as installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

PLACES = ("configs", "systemd")


def data_file(name: str) -> Path:
    """Absolute path of a shipped file.

    Args:
        name: Below the project's folder, such as `configs/virtual.yaml` or `systemd/seod@.service`.

    Raises:
        FileNotFoundError: Neither in a checkout nor installed; says where was looked.
    """
    checkout = Path(__file__).parents[1] / name
    if checkout.is_file() and name.split("/")[0] in PLACES:
        return checkout
    for entry in _installed_files():
        if entry.as_posix().endswith(f"share/seod/{name}"):
            return entry
    raise FileNotFoundError(f"{name} is neither at {checkout} nor among the installed files of seod")


def _installed_files() -> list[Path]:
    # The wheel's record knows where an installer put share/: under a prefix, a venv or a user's home.
    try:
        entries = files("seod") or []
    except PackageNotFoundError:
        return []
    return [Path(str(entry.locate())).resolve() for entry in entries if "share" in entry.parts]
