"""Shape of a rig file's `server`: who may connect, where."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from seod.config.section import (
    Section,
)
from seod.config.token_field import Token


class TlsConfig(Section):
    """Certificate and key in PEM files; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""

    certificate: str
    """Certificate chain, the server's own first."""
    key: str
    """Private key, without a pass phrase."""


class ServerConfig(Section):
    """The TCP server. Beyond loopback it needs TLS and tokens."""

    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    """Address to listen on."""
    port: Annotated[int, Field(ge=0, le=65535)] = 7600
    """TCP port; 0 takes a free one."""
    tls: TlsConfig | None = None
    read_token: Token | None = None
    """Who has it may read. Better in a file, or in the environment as SEOD_READ_TOKEN."""
    command_token: Token | None = None
    """Who has it may read and command. Better in a file, or in the environment as SEOD_COMMAND_TOKEN."""
    read_token_file: Annotated[str, Field(min_length=1)] | None = None
    """File that holds the read_token; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""
    command_token_file: Annotated[str, Field(min_length=1)] | None = None
    """File that holds the command_token; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""
    max_clients: Annotated[int, Field(ge=1, le=1000)] = 100
    """Connections at a time."""
    panel: bool = True
    """Whether the panel is served: a page for browsers, and `/metrics`. Address, TLS and tokens as above."""
    panel_port: Annotated[int, Field(ge=0, le=65535)] | None = None
    """Its TCP port; 0 takes a free one. Left out: 80 above `port`, or a free one where that is 0."""
    scpi: bool = False
    """Whether SCPI commands are taken over TCP, with the same rights."""
    scpi_port: Annotated[int, Field(ge=0, le=65535)] = 5025
    """TCP port of SCPI; 0 takes a free one."""
    foxglove: bool = False
    """Whether live topics are served to Foxglove and Lichtblick, at `/foxglove` on the panel's port."""
    foxglove_origins: list[Annotated[str, Field(min_length=1)]] = Field(default=[])
    """Web pages that may read these topics, such as https://app.foxglove.dev; programs need none."""
