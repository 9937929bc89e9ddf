"""The command `seod diagnose`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from seod.commands.common import Between, Columns, CommandError, Units, app, load, plain_errors, rising, show


@app.command()
def diagnose(
    paths: Annotated[
        list[Path], typer.Argument(metavar="DATA...", help="Recordings; several are fitted jointly.")
    ],
    holdout: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="A recording that no fit may see; repeatable."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="CONFIG", help="Rig file, whose model is the baseline.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write report.html, diagnosis.json and extended.yaml there."),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Of recordings and rig files with several.")] = None,
    output: Annotated[
        Literal["position", "velocity"] | None,
        typer.Option(
            help="What y is. Default: by the unit of y, or as the rig file's axis has it; else position."
        ),
    ] = None,
    columns: Columns = "",
    units: Units = "",
    between: Between = None,
    as_json: Annotated[bool, typer.Option("--json", help="The answer as JSON.")] = False,
) -> None:
    """Show what the simulation gets wrong, name the cause, and extend the model."""
    from seod.data.source import ReadError  # noqa: PLC0415 - numerics, and a compiler
    from seod.diagnose.answer import DiagnoseError  # noqa: PLC0415
    from seod.diagnose.run import Wishes, run  # noqa: PLC0415

    with plain_errors():
        rig = None if config is None else (config, load(config))
        if rig is not None and axis is not None and axis not in rig[1].axes:
            raise CommandError(f"no axis {axis!r}; {config} has {', '.join(rig[1].axes)}")
        if rig is not None and axis is None and len(rig[1].axes) > 1:
            raise CommandError(f"{config} has the axes {', '.join(rig[1].axes)}: choose one by --axis")
        part = None if between is None else rising(between, "--between")
        wishes = Wishes(holdout or [], rig, out, axis, output, columns, units, part, as_json)
        try:
            show(run(paths, wishes))
        except (ReadError, DiagnoseError, OSError) as error:
            raise CommandError(str(error)) from error
