"""`seod info` and `seod export`. Readers are imported only when one of them runs."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from seod.commands.common import Columns, CommandError, Units, app, plain_errors, show
from seod.files.user_files import said

if TYPE_CHECKING:
    from collections.abc import Iterator

Recorded = Annotated[
    Path,
    typer.Argument(
        metavar="FILE", help="CSV (.gz), Parquet, MAT, MCAP, MDF, or a CAN log.", show_default=False
    ),
]
Dbc = Annotated[Path | None, typer.Option(metavar="FILE", help="DBC of a CAN log.")]


@contextmanager
def _plain_errors() -> Iterator[None]:
    """As `plain_errors`, for recordings that cannot be read too."""
    from seod.data.source import ReadError  # noqa: PLC0415 - numpy

    with plain_errors():
        try:
            yield
        except (ReadError, ValueError) as error:
            raise CommandError(str(error)) from error


@app.command()
def info(
    path: Recorded,
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON.")] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the columns into a file: .png, .svg or .pdf.")
    ] = None,
    columns: Columns = "",
    dbc: Dbc = None,
) -> None:
    """Show what is in a recording: columns, rates, gaps, ranges."""
    with _plain_errors():
        from seod.data import open_source  # noqa: PLC0415
        from seod.data.columns import parse_pairs  # noqa: PLC0415
        from seod.data.show import as_text  # noqa: PLC0415
        from seod.data.show import plot as draw  # noqa: PLC0415
        from seod.data.summary import summarize  # noqa: PLC0415

        time = parse_pairs(columns, "--columns").get("t") if columns else None
        with open_source(path, dbc) as source:
            summary = summarize(source, time, bins=1000 if plot else 60)
        if plot is not None:
            draw(summary, plot)
        show(json.dumps(summary.as_json()) if as_json else as_text(summary))


@app.command()
def export(
    path: Recorded,
    to: Annotated[Literal["csv", "parquet", "mat", "mdf"], typer.Option(help="Format.", show_default=False)],
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Instead of beside the recording.")] = None,
    columns: Columns = "",
    units: Units = "",
    axis: Annotated[str | None, typer.Option(help="Only t, u, y ... of this axis.")] = None,
    group: Annotated[list[str] | None, typer.Option(help="Only this group; may be repeated.")] = None,
    dbc: Dbc = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
) -> None:
    """Write a recording in the form of other tools: all columns as they are, or t, u, y ... in SI units.

    With --columns, --units or --axis only the standard columns are written, in SI units, in increasing time.
    """
    with _plain_errors():
        from seod.data import open_source, read  # noqa: PLC0415
        from seod.data.export import as_table, default_path  # noqa: PLC0415
        from seod.data.export import export as write  # noqa: PLC0415

        target = out or default_path(path, to)
        if columns or units or axis:
            recording = read(path, columns, units, axis, dbc)
            done = write(as_table(recording), to, target, overwrite=force)
            done.said += map(str, recording.problems)
        else:
            with open_source(path, dbc) as source:
                done = write(source, to, target, group or (), overwrite=force)
        for line in done.said:
            print(line, file=sys.stderr)  # noqa: T201
        for file in done.files:
            show(str(file))


@app.command()
def scrub(
    paths: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Recordings: MCAP, CSV; each file of a series.")
    ],
) -> None:
    """Take the server's tokens out of recordings of earlier versions; all else in them stays as it is."""
    from seod.data.source import ReadError  # noqa: PLC0415 - numpy
    from seod.scrub.changes import ScrubError  # noqa: PLC0415
    from seod.scrub.command import scrub as clean  # noqa: PLC0415

    failed = False
    for path in paths:
        try:
            show(clean(path))
        except (ScrubError, ReadError, OSError) as error:
            failed = True
            print(f"seod: {said(error) if isinstance(error, OSError) else error}", file=sys.stderr)  # noqa: T201
    if failed:
        raise typer.Exit(1)
