"""Files of a rig that others on this machine should not be able to read or change."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import TYPE_CHECKING

from seod.config.tokens import RIGHTS, located, too_open

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.server import ServerConfig


def open_tokens(server: ServerConfig) -> Iterator[str]:
    """Why the daemon would refuse the files of its tokens: others may read or change them."""
    for right in RIGHTS:
        path = _there(getattr(server, f"{right}_file"))
        if path is not None and (why := too_open(path)):
            yield f"server.{right}_file: {path} {why}"


def open_files(server: ServerConfig, rig_file: Path | None) -> Iterator[str]:
    """What others may read that they should not, or may change."""
    key = _there(server.tls.key if server.tls else None)
    if key is not None and (why := too_open(key)):
        yield f"server.tls.key: {key} {why}"
    if rig_file is None:
        return
    tokens = [right for right in RIGHTS if getattr(server, right) is not None]
    why = too_open(rig_file)
    if tokens and why:
        files = " and ".join(f"{right}_file" for right in tokens)
        yield f"{rig_file} holds {' and '.join(tokens)} and {why}; better still, {files}"
    elif rig_file.stat().st_mode & stat.S_IWOTH:
        yield f"{rig_file} {why}: whoever changes it changes the limits of the machine"


def _there(name: str | None) -> Path | None:
    """A file of the server's, if it can be looked at here."""
    path = None if name is None else located(name, Path())
    return path if path is not None and path.exists() else None
