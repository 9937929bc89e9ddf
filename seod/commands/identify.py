"""Commands that take recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from seod.commands.common import Columns, CommandError, Gain, Units, app, load, plain_errors, show


@app.command()
def identify(
    paths: Annotated[
        list[Path], typer.Argument(metavar="DATA...", help="Recordings; several are fitted jointly.")
    ],
    config: Annotated[
        Path | None, typer.Option(metavar="CONFIG", help="Rig file, whose values are shown beside.")
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Of recordings and rig files with several.")] = None,
    method: Annotated[
        Literal["output_error", "wave", "exact", "peaks"],
        typer.Option(help="Simulated output to the whole, or a live estimator on a relay's recording."),
    ] = "output_error",
    gain: Gain = None,
    delay: Annotated[
        float | None,
        typer.Option(metavar="S", min=0.0, max=1e3, help="Delay, if it is known; left out: it is estimated."),
    ] = None,
    output: Annotated[
        Literal["position", "velocity"] | None,
        typer.Option(help="What y is. Default: by the rig file, else position."),
    ] = None,
    offset: Annotated[bool, typer.Option(help="A velocity y may have an offset.")] = True,
    hold: Annotated[
        Literal["zero", "first"],
        typer.Option(help="Whether u holds until the next row or runs straight on to it."),
    ] = "zero",
    columns: Columns = "",
    units: Units = "",
    as_json: Annotated[bool, typer.Option("--json", help="The answer as JSON.")] = False,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw it into a PNG file.")] = None,
) -> None:
    """Identify omega_n, zeta, K_L and delay from recordings, and say what they cannot tell."""
    from seod.data.source import ReadError  # noqa: PLC0415 - numerics
    from seod.identify.command import Options, run  # noqa: PLC0415
    from seod.identify.record import IdentifyError  # noqa: PLC0415

    if gain == 0.0:
        raise typer.BadParameter("must be a number other than 0", param_hint="--gain")
    with plain_errors():
        rig = None if config is None else load(config)
        if rig is not None and axis is not None and axis not in rig.axes:
            raise CommandError(f"no axis {axis!r}; {config} has {', '.join(rig.axes)}")
        if rig is not None and axis is None and len(rig.axes) > 1:
            raise CommandError(f"{config} has the axes {', '.join(rig.axes)}: choose one by --axis")
        options = Options(method, gain, delay, output, offset, hold, columns, units, axis, as_json, plot)
        try:
            show(run(paths, rig, options))
        except (ReadError, IdentifyError) as error:
            raise CommandError(str(error)) from error
