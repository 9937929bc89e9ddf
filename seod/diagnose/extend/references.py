"""What a rig file refers to by relative paths, when it moves to another folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from seod.config.edit import edited
from seod.config.redact import redacted
from seod.config.tokens import RIGHTS

if TYPE_CHECKING:
    from seod.config.errors import KeyPath
    from seod.config.model import RigConfig
    from seod.config.server import ServerConfig


def moved(text: str, config: RigConfig, source: Path, folder: Path) -> str:
    """The text of a rig file as it is right in another folder, to which its DBC is copied.

    Keys and recordings stay where they are and are named by absolute paths. Tokens that stand in the rig file
    are left out; only this machine can reach the rig then.

    Args:
        text: The rig file.
        config: What it says.
        source: Where it was.
        folder: Where it goes.

    Raises:
        OSError: The DBC cannot be copied.
    """
    places: dict[KeyPath, object] = {}
    if "dbc" in config.driver:
        dbc = Path(config.driver["dbc"])
        if dbc.parent != folder.resolve():
            shutil.copyfile(dbc, folder / dbc.name)
        places["driver", "dbc"] = dbc.name
    if "file" in config.driver:
        places["driver", "file"] = config.driver["file"]
    places |= _server(config.server, source.parent.resolve())
    text = redacted(text)
    return edited(text, places) if places else text


def _server(server: ServerConfig, source: Path) -> dict[KeyPath, object]:
    places: dict[KeyPath, object] = {}
    if server.tls is not None:
        for key in ("certificate", "key"):
            places["server", "tls", key] = str(source / getattr(server.tls, key))
    for right in RIGHTS:
        if getattr(server, right) is not None:
            places["server", right], places["server", "host"] = "null", "127.0.0.1"
        if (name := getattr(server, f"{right}_file")) is not None:
            places["server", f"{right}_file"] = name
    return places
