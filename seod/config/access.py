"""Rules about who may reach the rig over the network."""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING

from seod.config.server import ServerConfig, TlsConfig
from seod.config.tokens import RIGHTS, has_token, is_filled, located
from seod.files.user_files import irregular

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError, KeyPath

_PEM = "a PEM file; relative to the rig file"
_PRIVATE = "a file with the token, mode 0600; relative to the rig file"


def is_loopback(host: str) -> bool:
    """Whether an address reaches only this machine; names are not looked up and count as the network."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_access(draft: Draft) -> Iterator[ConfigError]:
    """A server beyond loopback has TLS and tokens; its files are there."""
    yield from _tls(draft)
    server = draft.section(ServerConfig, "server")
    if server is None:
        return
    yield from _tokens(draft, server)
    if is_loopback(server.host):
        return
    missing = [] if server.tls else ["tls"]
    missing += [right for right in RIGHTS if not has_token(server, right)]
    if missing:
        message = f"{server.host!r} can be reached from other machines, which needs {' and '.join(missing)}"
        yield draft.error(("server", "host"), message, "add them, or listen on 127.0.0.1")


def _tokens(draft: Draft, server: ServerConfig) -> Iterator[ConfigError]:
    if server.read_token is not None and server.read_token == server.command_token:
        message = "must differ from read_token: reading and commanding are separate rights"
        yield draft.error(("server", "command_token"), message)
    for right in RIGHTS:
        token, name = getattr(server, right), getattr(server, f"{right}_file")
        if token is not None and is_filled(token.get_secret_value()):
            message = "stands where a recording does not show a token"
            yield draft.error(("server", right), message, f"a token of your own, or {right}_file")
        if token is not None and name is not None:
            yield draft.error(("server", right), f"is in {right}_file too", "leave one of the two out")
        if name is not None:
            yield from _file(draft, ("server", f"{right}_file"), name, _PRIVATE)


def _tls(draft: Draft) -> Iterator[ConfigError]:
    tls = draft.section(TlsConfig, "server", "tls")
    for key in ("certificate", "key") if tls else ():
        yield from _file(draft, ("server", "tls", key), getattr(tls, key), _PEM)


def _file(draft: Draft, key: KeyPath, name: str, right: str) -> Iterator[ConfigError]:
    """A file of the server's is there; whether it may be read is its user's matter."""
    path = located(name, draft.directory)
    if path is None:  # only the unit has it
        return
    if why := irregular(path):
        yield draft.error(key, f"{path} {why}", right)
        return
    try:
        path.stat()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        yield draft.error(key, f"{path} cannot be read: {why}", right)
