"""The command `seod diagnose`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from seod.commands.common import (
    Between,
    Columns,
    CommandError,
    Gain,
    Units,
    app,
    load,
    plain_errors,
    rising,
    show,
)


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
        typer.Option(help="What y is. Default: as the rig file's axis has it; else both are tried."),
    ] = None,
    gain: Gain = None,
    delay: Annotated[
        float | None,
        typer.Option(
            metavar="S", min=0.0, max=100.0, help="Delay, if it is known; else a cause like others."
        ),
    ] = None,
    hold: Annotated[
        Literal["zero", "first"],
        typer.Option(help="Whether u holds until the next row or runs straight on to it."),
    ] = "zero",
    columns: Columns = "",
    units: Units = "",
    between: Between = None,
    effort: Annotated[
        Literal["quick", "normal", "thorough"],
        typer.Option(help="How long causes are searched for; thorough: until all are tried."),
    ] = "normal",
    relevance: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            min=0.0,
            max=100.0,
            help="Systematic rest that is called unexplained, in % of the movement's standard deviation.",
        ),
    ] = 2.0,
    as_json: Annotated[bool, typer.Option("--json", help="The answer as JSON.")] = False,
) -> None:
    """Show what the simulation gets wrong, name the cause, and extend the model."""
    from seod.data.source import ReadError  # noqa: PLC0415 - numerics, and a compiler
    from seod.diagnose.command import Options, run  # noqa: PLC0415
    from seod.diagnose.result import DiagnoseError  # noqa: PLC0415

    if gain == 0.0:
        raise typer.BadParameter("must be a number other than 0", param_hint="--gain")
    with plain_errors():
        rig = None if config is None else (config, load(config))
        if rig is not None and axis is not None and axis not in rig[1].axes:
            raise CommandError(f"no axis {axis!r}; {config} has {', '.join(rig[1].axes)}")
        if rig is not None and axis is None and len(rig[1].axes) > 1:
            raise CommandError(f"{config} has the axes {', '.join(rig[1].axes)}: choose one by --axis")
        part = None if between is None else rising(between, "--between")
        told = effort, hold, gain, delay, 0.01 * relevance
        options = Options(holdout or [], rig, out, axis, output, columns, units, part, as_json, *told)
        try:
            show(run(paths, options))
        except (ReadError, DiagnoseError) as error:
            raise CommandError(str(error)) from error
