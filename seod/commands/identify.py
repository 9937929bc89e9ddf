"""Commands that take recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from seod.commands.answers import answer, asking, tell_problems
from seod.commands.common import Between, Columns, Gain, Units, app
from seod.commands.quantity import seconds


@app.command()
def identify(
    paths: Annotated[
        list[Path], typer.Argument(metavar="DATA", help="Recordings; several are fitted jointly.")
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
        typer.Option(**seconds(0.0, 1e3), help="Delay, if it is known; left out: it is estimated."),
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
    between: Between = None,
    as_json: Annotated[bool, typer.Option("--json", help="The answer as JSON.")] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw it into a file: .png, .svg or .pdf.")
    ] = None,
) -> None:
    """Identify omega_n, zeta, K_L and delay from recordings, and say what they cannot tell."""
    with asking():
        from seod.api.identification import identify as ask  # noqa: PLC0415 - numerics
        from seod.terminal.progress import bar  # noqa: PLC0415 - rich

        with bar() as progress:
            found = ask(
                paths,
                config=config,
                axis=axis,
                method=method,
                gain=gain,
                delay=delay,
                output=output,
                offset=offset,
                hold=hold,
                columns=columns,
                units=units,
                between=between,
                progress=progress,
            )
        tell_problems(found.recordings)
        answer(found, as_json, plot)
