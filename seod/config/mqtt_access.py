"""Rules about the broker: what may pass over the network, and by whose right commands come."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.access import is_loopback
from seod.config.mqtt import MqttConfig
from seod.config.server import ServerConfig
from seod.config.tokens import has_token, located
from seod.files.user_files import irregular

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError, KeyPath


def check_mqtt(draft: Draft) -> Iterator[ConfigError]:
    """Passwords and commands need TLS beyond this computer, commands a token as well; files are there."""
    if draft.raw("mqtt") is None:
        return
    mqtt = draft.section(MqttConfig, "mqtt")
    if mqtt is None:
        return
    yield from _files(draft, mqtt)
    if mqtt.password_file is not None and mqtt.user is None:
        yield draft.error(("mqtt", "password_file"), "has no user", "user: the name at the broker")
    if is_loopback(mqtt.host):
        return
    secret = mqtt.password_file is not None or mqtt.commands
    if secret and mqtt.tls is None:
        what = "commands" if mqtt.commands else "a password"
        message = f"{mqtt.host!r} is another machine: {what} would pass in plain text"
        yield draft.error(("mqtt", "host"), message, "add `tls: {ca: FILE}` to mqtt")
    server = draft.section(ServerConfig, "server")
    if mqtt.commands and server is not None and not has_token(server, "command_token"):
        message = "anyone whom the broker lets in could command the rig"
        yield draft.error(("mqtt", "commands"), message, "add server.command_token or command_token_file")


def _files(draft: Draft, mqtt: MqttConfig) -> Iterator[ConfigError]:
    ca = None if mqtt.tls is None else mqtt.tls.ca
    for key, name, right in (
        (("mqtt", "tls", "ca"), ca, "a PEM file; relative to the rig file"),
        (("mqtt", "password_file"), mqtt.password_file, "a file with the password, mode 0600"),
    ):
        if name is not None:
            yield from _file(draft, key, name, right)


def _file(draft: Draft, key: KeyPath, name: str, right: str) -> Iterator[ConfigError]:
    path = located(name, draft.directory)
    if path is None:  # only the unit has it
        return
    try:
        why = irregular(path) or ("" if path.exists() else "is not there")
    except (OSError, ValueError) as error:
        why = f"cannot be read: {error}"
    if why:
        yield draft.error(key, f"{path} {why}", right)
