"""The command `seod response`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from seod.commands.answers import answer, asking, tell_problems
from seod.commands.common import MOST_S, MOST_SEED, MOST_V, Between, Columns, Gain, Units, app
from seod.commands.quantity import seconds, volts


@app.command()
def response(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="DATA", help="Recordings, instead of a rig.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="CONFIG", help="Rig file: excite this rig; with DATA, of that rig.")
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Of rigs and recordings with several.")] = None,
    kind: Annotated[
        Literal["multisine", "sine"] | None,
        typer.Option(help="Random-phase multisines (default), or sines one after the other."),
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option(
            **volts(1e-6, MOST_V),
            help="Largest voltage. Default: e_a, or less to fit the limits.",
        ),
    ] = None,
    band: Annotated[
        str | None,
        typer.Option(metavar="LOW:HIGH", help="In Hz. Default: a 20th to 3 times what the relay tells."),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(**seconds(1e-3, MOST_S), help="Of the multisine, or of DATA. Default: found."),
    ] = None,
    periods: Annotated[
        int | None, typer.Option(min=3, max=1000, help="Of each multisine, to average over. Default: 6.")
    ] = None,
    realisations: Annotated[
        int | None, typer.Option(min=1, max=100, help="Multisines with other phases. Default: 4.")
    ] = None,
    points: Annotated[int | None, typer.Option(min=4, max=200, help="Sines. Default: 20.")] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=MOST_SEED, help="Random seed of the multisine's phases. Default: 1."),
    ] = None,
    relay: Annotated[
        bool | None,
        typer.Option("--relay/--no-relay", help="Run the relay before, to compare. Default: yes."),
    ] = None,
    e_a: Annotated[
        float | None,
        typer.Option("--e-a", **volts(1e-6, MOST_V), help="Of that relay. Default: as set."),
    ] = None,
    predict: Annotated[
        bool, typer.Option("--predict", help="Simulate what the rig file's plant would show.")
    ] = False,
    limit_cycle: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With DATA: a relay's recording, to compare with.")
    ] = None,
    gain: Gain = None,
    delay: Annotated[
        float | None,
        typer.Option(**seconds(0.0, 1e3), help="Delay, if it is known; left out: it is estimated."),
    ] = None,
    output: Annotated[
        Literal["position", "velocity"] | None,
        typer.Option(help="What y of DATA is. Default: position."),
    ] = None,
    columns: Columns = "",
    units: Units = "",
    between: Between = None,
    as_json: Annotated[bool, typer.Option("--json", help="The answer as JSON.")] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Bode plot into a file: .png, .svg or .pdf.")
    ] = None,
) -> None:
    """Measure the frequency response: points, fit, Bode plot beside what the limit cycle tells."""
    with asking():
        from seod.api.responses import response as ask  # noqa: PLC0415 - numerics
        from seod.terminal.progress import bar  # noqa: PLC0415 - rich

        with bar() as progress:
            found = ask(
                paths or None,
                config=config,
                axis=axis,
                kind=kind,
                amplitude=amplitude,
                band=band,
                period=period,
                periods=periods,
                realisations=realisations,
                points=points,
                seed=seed,
                relay=relay,
                e_a=e_a,
                predict=predict,
                limit_cycle=limit_cycle,
                gain=gain,
                delay=delay,
                output=output,
                columns=columns,
                units=units,
                between=between,
                progress=progress,
            )
        tell_problems(found.recordings)
        answer(found, as_json, plot)
