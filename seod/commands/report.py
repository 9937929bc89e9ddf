"""The command `seod report`."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seod.commands.common import CommandError, app, plain_errors, show

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def _plain_errors() -> Iterator[None]:
    """As `plain_errors`, for sheets that cannot be made too."""
    from seod.sheet.segments import SheetError  # noqa: PLC0415 - with the room

    with plain_errors():
        try:
            yield
        except (SheetError, ValueError) as error:
            raise CommandError(str(error)) from error


@app.command()
def report(
    rig: Annotated[
        str, typer.Argument(metavar="RIG", help="Name of the rig, as in its rig file.", show_default=False)
    ],
    since: Annotated[
        str, typer.Option(metavar="DATE", help="First day (UTC): 2026-11-01. Default: of the archive.")
    ] = "",
    until: Annotated[str, typer.Option(metavar="DATE", help="Last day (UTC). Default: the newest.")] = "",
    archive: Annotated[
        str, typer.Option(metavar="DIR", help="Archive that `seod archive` has made a catalogue of.")
    ] = ".",
    config: Annotated[
        Path | None,
        typer.Option(metavar="CONFIG", help="Rig file, for calibrations. Default: of the newest recording."),
    ] = None,
    responses: Annotated[
        list[str] | None,
        typer.Option(
            "--response",
            metavar="[AXIS=]FILE",
            help="Frequency response, as `seod response --json` prints it; repeatable.",
        ),
    ] = None,
    reference: Annotated[
        str,
        typer.Option(
            metavar="DATE:DATE", help="Days to compare with. Default: the first with good estimates."
        ),
    ] = "",
    limits: Annotated[
        list[str] | None,
        typer.Option(
            "--limit",
            metavar="[AXIS.]NAME=LOW:HIGH",
            help="Alarm outside, in SI: zeta=0.1:0.3, motor.omega_n=100:; repeatable. Default: drifts.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The sheet as a page: .html or .pdf.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The figures as JSON.")] = False,
) -> None:
    """The sheet of a rig to be filed: trends, hours, calibration, faults, and the terms of ISO 10770-1."""
    with _plain_errors():
        from seod.sheet.command import Options, make  # noqa: PLC0415 - numerics

        options = Options(rig, since, until, archive, config, responses or (), reference, limits or (), out)
        sheet = make(options)
        if as_json:
            from seod.sheet.show import as_json as told  # noqa: PLC0415

            show(json.dumps(told(sheet), allow_nan=False))
        elif out is not None:
            show(f"{out}: {sheet.recordings} recordings of {sheet.rig}")
        else:
            from seod.sheet.show import as_text  # noqa: PLC0415 - rich

            show(as_text(sheet))
