"""Tokens of the server: where they come from, and that nothing that is written of a rig file shows them."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import SecretStr

from seod.config.token_field import CREDENTIALS, FILL, LEAST
from seod.files.user_files import irregular, said

if TYPE_CHECKING:
    from seod.config.model import RigConfig
    from seod.config.server import ServerConfig

RIGHTS = ("read_token", "command_token")
"""Keys of the `server` section that hold a token; `KEY_file` names a file that does."""
SECRETS = tuple((right,) for right in RIGHTS)
"""Ends of the paths whose values no message repeats."""
_MOST_BYTES = 4096
_TOO_OPEN = stat.S_IRWXO | stat.S_IWGRP
"""Others may do nothing with a token's file, and its group may read it at most."""


class TokenError(Exception):
    """A token cannot be had; the message names the file or the variable, never the token."""


def is_filled(token: str) -> bool:
    """Whether this only stands where a token was."""
    return set(token) <= set(FILL + " \t\r\n")


def located(path: str, directory: Path) -> Path | None:
    """Where a file of the `server` section is; None for a credential outside of its unit.

    Args:
        path: As the rig file has it.
        directory: Folder of the rig file.
    """
    if not path.startswith(CREDENTIALS):
        return directory / path
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    return None if folder is None else Path(folder) / path.removeprefix(CREDENTIALS)


def too_open(path: Path) -> str:
    """Why a token's file is not private: who else may do what with it; "" if it is."""
    mode = stat.S_IMODE(path.stat().st_mode)
    if not mode & _TOO_OPEN:
        return ""
    who = "everyone" if mode & stat.S_IRWXO else "its group"
    what = "changed" if mode & (stat.S_IWOTH | stat.S_IWGRP) else "read"
    return f"can be {what} by {who} (mode {mode:04o}); right would be 0600, or 0640"


def read_token_file(path: Path) -> str:
    """The token in a file: one line of at least 16 characters.

    Raises:
        TokenError: It cannot be read, holds none, or others can read it.
    """
    try:
        why = irregular(path) or too_open(path)
        if why:
            raise TokenError(f"{path}: {why}")
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES)
    except OSError as error:
        raise TokenError(said(error)) from error
    return _checked(data.decode(errors="replace").strip(), str(path))


def _checked(token: str, place: str) -> str:
    if len(token) < LEAST or not token.isprintable() or "\ufffd" in token:
        raise TokenError(f"{place}: must hold one line of UTF-8 text, at least {LEAST} characters")
    if is_filled(token):
        raise TokenError(f"{place}: holds what stands in recordings for a token, not a token")
    return token


def with_tokens(config: RigConfig) -> RigConfig:
    """The rig file with its tokens, from where it says or from the environment.

    Raises:
        TokenError: One of them cannot be had, or comes from two places.
    """
    found = {right: _token(config.server, right) for right in RIGHTS}
    if found["read_token"] is not None and found["read_token"] == found["command_token"]:
        raise TokenError("server: read_token and command_token must differ: they are separate rights")
    tokens = {right: None if token is None else SecretStr(token) for right, token in found.items()}
    return config.model_copy(update={"server": config.server.model_copy(update=tokens)})


def variable(right: str) -> str:
    """The environment variable that may hold a token: `SEOD_READ_TOKEN`, `SEOD_COMMAND_TOKEN`."""
    return f"SEOD_{right.upper()}"


def _token(server: ServerConfig, right: str) -> str | None:
    written, name = getattr(server, right), getattr(server, f"{right}_file")
    outside = os.environ.get(variable(right))
    if outside and (written or name):
        raise TokenError(f"{variable(right)}: the rig file has a server.{right} already; leave one out")
    if outside:
        return _checked(outside, variable(right))
    if name is None:
        return None if written is None else str(written.get_secret_value())
    path = located(name, Path())
    if path is None:
        raise TokenError(f"server.{right}_file: {name}: only the systemd unit has it; set SEOD_TOKEN_FILE")
    return read_token_file(path)


def has_token(server: ServerConfig, right: str) -> bool:
    """Whether a token is given, by whatever way."""
    given = getattr(server, right) or getattr(server, f"{right}_file")
    return given is not None or bool(os.environ.get(variable(right)))


def token_given() -> str | None:
    """The token that the environment gives a client: `SEOD_TOKEN`, or the file `SEOD_TOKEN_FILE`.

    Raises:
        TokenError: The file holds none.
    """
    if token := os.environ.get("SEOD_TOKEN"):
        return token
    path = os.environ.get("SEOD_TOKEN_FILE")
    return read_token_file(Path(path)) if path else None


def client_token(config: RigConfig) -> str | None:
    """The token of a client of this rig: the environment's, else the rig file's for commands, or for reading.

    Raises:
        TokenError: It cannot be had.
    """
    given = token_given()
    if given is not None:
        return given
    server = with_tokens(config).server
    token = server.command_token or server.read_token
    return None if token is None else token.get_secret_value()
