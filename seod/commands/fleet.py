"""`seod fleet`: all rigs of a fleet, by MQTT."""

from __future__ import annotations

import asyncio
import hashlib
import os
from pathlib import Path
from typing import Annotated

import typer

from seod.commands.common import CommandError, Duration, app, plain_errors


@app.command()
def fleet(
    broker: Annotated[
        str, typer.Option(metavar="HOST[:PORT]", envvar="SEOD_BROKER", help="The broker of the fleet.")
    ],
    archive: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Append what comes to this archive.")
    ] = None,
    name: Annotated[
        str, typer.Option(help="The archive's name in the rigs' files (mqtt.archive).")
    ] = "archive",
    user: Annotated[str | None, typer.Option(envvar="SEOD_BROKER_USER", help="User at the broker.")] = None,
    password_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Read the user's password from this file.")
    ] = None,
    tls: Annotated[Path | None, typer.Option(metavar="PEM", help="Use TLS; trust this certificate.")] = None,
    duration: Duration = None,
    as_json: Annotated[bool, typer.Option("--json", help="Each message as a line of JSON.")] = False,
) -> None:
    """Show all rigs of a fleet: a table in a terminal, else a line for each message."""
    with plain_errors():
        from seod.fleet.broker import (  # noqa: PLC0415 - pydantic
            BrokerError,
            broker_at,
            need_library,
            read_password,
            tls_context,
        )

        try:
            need_library()
            trusted = None if tls is None else tls_context(str(tls))
            password = None if password_file is None else read_password(str(password_file))
            where = broker_at(broker, trusted, user, password)
        except BrokerError as error:
            raise CommandError(str(error)) from error
        from seod.fleet.show import watch  # noqa: PLC0415 - an extra

        asyncio.run(watch(where, _identity(archive, name), archive, name, duration, as_json))


def _identity(archive: Path | None, name: str) -> str:
    """Client identifier: an archive has the same one at each start; the broker then knows what it missed."""
    if archive is None:
        return f"seod-fleet-{os.getpid()}-{os.urandom(3).hex()}"
    return f"seod-fleet-{name}-{hashlib.sha256(str(archive.resolve()).encode()).hexdigest()[:8]}"
