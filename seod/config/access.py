"""Rules about who may reach the rig over the network."""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING

from seod.config.model import ServerConfig, TlsConfig

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError


def is_loopback(host: str) -> bool:
    """Whether an address reaches only this machine; names are not looked up and count as the network."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_access(draft: Draft) -> Iterator[ConfigError]:
    """A server beyond loopback has TLS and tokens; its files are there."""
    yield from _files(draft)
    server = draft.section(ServerConfig, "server")
    if server is None:
        return
    if server.read_token is not None and server.read_token == server.command_token:
        message = "must differ from read_token: reading and commanding are separate rights"
        yield draft.error(("server", "command_token"), message)
    if is_loopback(server.host):
        return
    missing = [key for key in ("tls", "read_token", "command_token") if getattr(server, key) is None]
    if missing:
        message = f"{server.host!r} can be reached from other machines, which needs {' and '.join(missing)}"
        yield draft.error(("server", "host"), message, "add them, or listen on 127.0.0.1")


def _files(draft: Draft) -> Iterator[ConfigError]:
    tls = draft.section(TlsConfig, "server", "tls")
    if tls is None:
        return
    for key in ("certificate", "key"):
        path = draft.directory / getattr(tls, key)
        try:
            path.open("rb").close()
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            yield draft.error(
                ("server", "tls", key),
                f"{path} cannot be read: {why}",
                "a PEM file; relative to the rig file",
            )
