"""The command `seod simulate`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from seod.commands.answers import asking
from seod.commands.common import MOST_S, MOST_SEED, MOST_V, CommandError, ConfigPath, app, show
from seod.commands.quantity import hertz, seconds, volts

MOST_LINES = 1_000_000
"""Lines of a multisine, or cycles: more than any recording has."""


@app.command()
def simulate(
    path: ConfigPath,
    out: Annotated[Path, typer.Option(metavar="FILE", help="The recording: .csv or .csv.gz.")],
    axis: Annotated[str | None, typer.Option(help="The axis, where there are several.")] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME.PARAMETER=VALUE", help="In the plant, as in docs/model.md; repeatable."),
    ] = None,
    excitation: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            help="relay, two-phase, sine, sweep (by octaves), linear-sweep, multisine, steps or file.",
        ),
    ] = "relay",
    amplitude: Annotated[float | None, typer.Option(**volts(0.0, MOST_V), help="Default: e_a.")] = None,
    bias: Annotated[
        float | None,
        typer.Option(
            **volts(-MOST_V, MOST_V),
            help="Added to it. Default: relay.bias, and that of the reference speed.",
        ),
    ] = None,
    duration: Annotated[float | None, typer.Option(**seconds(0.0, MOST_S), help="Default: 10 s.")] = None,
    frequency: Annotated[
        float | None,
        typer.Option(**hertz(1e-6), help="Of the sine, or of pairs of steps. Default: by the plant."),
    ] = None,
    band: Annotated[
        str | None,
        typer.Option(metavar="LOW:HIGH", help="Of sweep or multisine In Hz. Default: by the plant."),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(**seconds(1e-3, MOST_S), help="Of the multisine. Default: the duration."),
    ] = None,
    lines: Annotated[
        int | None,
        typer.Option(min=1, max=MOST_LINES, help="So many of the multisine, by octaves. Default: all."),
    ] = None,
    cycles: Annotated[
        int | None, typer.Option(min=1, max=MOST_LINES, help="Of each of the two phases. Default: 3.")
    ] = None,
    input_: Annotated[
        Path | None,
        typer.Option("--input", metavar="FILE", help="CSV with columns t, u, and if wanted ps, temperature."),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=1e6, help="Standard deviation, as `noise` of the plant. Default: the rig file's."
        ),
    ] = None,
    latency: Annotated[
        float, typer.Option(**seconds(0.0, 10.0), help="From a sample to the command's leaving.")
    ] = 0.0,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=MOST_SEED, help="Random seed of noise, defects and signal. Default: the rig file's."
        ),
    ] = None,
) -> None:
    """Write a recording of the simulated rig, and show the truth that is in it."""
    with asking():
        from seod.api.simulations import COMPILING, unwritable  # noqa: PLC0415 - numerics, and a compiler
        from seod.api.simulations import simulate as ask  # noqa: PLC0415
        from seod.terminal.progress import bar  # noqa: PLC0415 - rich

        if why := unwritable(out):
            raise CommandError(f"--out {out}: {why}")
        with bar() as progress:

            def told(step: str, part: float) -> None:
                if step == COMPILING:
                    print(step, file=sys.stderr, flush=True)  # noqa: T201 - for whoever waits
                progress(step, part)

            found = ask(
                path,
                axis=axis,
                effect=effect or (),
                excitation=excitation,
                amplitude=amplitude,
                bias=bias,
                duration=duration,
                frequency=frequency,
                band=band,
                period=period,
                lines=lines,
                cycles=cycles,
                input=input_,
                noise=noise,
                latency=latency,
                seed=seed,
                progress=told,
            )
            found.save(out, lambda part: progress("writing", part))
        show(json.dumps({"file": str(out), **found.to_dict()}))
