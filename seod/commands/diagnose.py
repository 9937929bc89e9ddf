"""The command `seod diagnose`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from seod.commands.answers import answer, asking
from seod.commands.common import Between, Columns, Gain, Units, app, load, show
from seod.commands.quantity import seconds


@app.command()
def diagnose(
    paths: Annotated[
        list[Path], typer.Argument(metavar="DATA", help="Recordings; several are fitted jointly.")
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
        typer.Option(**seconds(0.0, 100.0), help="Delay, if it is known; else a cause like others."),
    ] = None,
    hold: Annotated[
        Literal["zero", "first"] | None,
        typer.Option(
            help="Whether u holds until the next row or runs straight on to it. Default: it holds, unless a "
            "cause is not needed where it runs on."
        ),
    ] = None,
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
    with asking():
        from seod.api.diagnoses import diagnose as ask  # noqa: PLC0415 - numerics, and a compiler
        from seod.diagnose.report.files import REPORT, RIG  # noqa: PLC0415

        if out is not None:
            out.mkdir(parents=True, exist_ok=True)  # that it cannot be made is told before the work
        from seod.terminal.progress import bar  # noqa: PLC0415 - rich

        with bar() as progress:
            found = ask(
                paths,
                holdout=holdout or None,
                config=config,
                axis=axis,
                output=output,
                gain=gain,
                delay=delay,
                hold=hold,
                columns=columns,
                units=units,
                between=between,
                effort=effort,
                relevance=relevance,
                progress=progress,
            )
        missing = [] if out is None else found.save(out)
        answer(found, as_json, None)
        if out is not None and not as_json:
            for sentence in missing:
                show(f"! {sentence}")
            if not missing:
                port = load(out / RIG).server.port
                rig = f"{out / RIG}: the extended rig, for `seod run` (port {port}) and `seod simulate`"
                show(f"{out / REPORT}: the report; {rig}")
