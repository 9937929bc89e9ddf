"""The rig file's `mqtt` section: the broker through which the rig is one of a fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Final

from pydantic import Field

from seod.config.section import POSITIVE, Seconds, Section
from seod.config.token_field import CREDENTIALS

if TYPE_CHECKING:
    from pathlib import Path

PLAIN_PORT: Final = 1883
TLS_PORT: Final = 8883
ID_PATTERN: Final = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
"""A level of a topic: without `/`, `+`, `#`."""

FileName = Annotated[str, Field(min_length=1)]


class MqttTlsConfig(Section):
    """TLS to the broker."""

    ca: FileName | None = None
    """Certificate to trust (PEM); relative to the rig file. Left out: those that the system trusts."""


class MqttConfig(Section):
    """A broker. The rig tells of itself there; it takes commands from there only if that is allowed."""

    host: Annotated[str, Field(min_length=1)]
    """Name or address of the broker."""
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    """Its TCP port. Left out: 1883, with `tls` 8883."""
    tls: MqttTlsConfig | None = None
    """TLS; a broker beyond this computer needs it as soon as passwords or commands pass."""
    user: Annotated[str, Field(min_length=1)] | None = None
    """User name at the broker."""
    password_file: FileName | None = None
    """File that holds the password; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""
    rig_id: Annotated[str, Field(pattern=ID_PATTERN)] | None = None
    """Name of the rig in the fleet, one of a kind there; left out: `rig`."""
    commands: bool = False
    """Whether commands that come through the broker are carried out, with the rights of their token."""
    rate_hz: Annotated[float, POSITIVE, Field(le=10.0)] = 1.0
    """Estimates of an axis a second, at most [Hz]."""
    health: Seconds = 10.0
    """Between two reports of health."""
    store: FileName | None = None
    """Folder of what the broker has not taken; relative to the rig file. Left out: the service's state
    folder, or ~/.local/state/seod."""
    store_mb: Annotated[float, POSITIVE, Field(le=100_000.0)] = 64.0
    """Most that is stored [MB]; then the oldest estimates are thinned out."""
    archive: Annotated[str, Field(pattern=ID_PATTERN)] | None = None
    """Name of a `seod fleet --archive` that must confirm what it has written before the rig forgets it.

    Left out: what the broker has confirmed half a minute ago is forgotten.
    """

    @property
    def broker_port(self) -> int:
        """The port in force."""
        return self.port or (PLAIN_PORT if self.tls is None else TLS_PORT)


def with_paths(config: MqttConfig, directory: Path) -> MqttConfig:
    """With absolute paths; credentials stay as they are, for only their unit has them."""

    def absolute(name: str | None) -> str | None:
        return name if name is None or name.startswith(CREDENTIALS) else str(directory / name)

    tls = None if config.tls is None else MqttTlsConfig(ca=absolute(config.tls.ca))
    paths = {"password_file": absolute(config.password_file), "store": absolute(config.store), "tls": tls}
    return config.model_copy(update=paths)
