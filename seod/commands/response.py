"""The command `seod response`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from seod.commands.common import (
    MOST_S,
    MOST_SEED,
    MOST_V,
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
def response(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="[DATA...]", help="Recordings, instead of a rig.")
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
            metavar="V",
            min=1e-6,
            max=MOST_V,
            help="Largest voltage. Default: e_a, or less to fit the limits.",
        ),
    ] = None,
    band: Annotated[
        str | None,
        typer.Option(metavar="LOW:HIGH", help="[Hz]. Default: a 20th to 3 times what the relay tells."),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(metavar="S", min=1e-3, max=MOST_S, help="Of the multisine, or of DATA. Default: found."),
    ] = None,
    periods: Annotated[
        int | None, typer.Option(min=3, max=1000, help="Of each multisine, to average over. Default: 6.")
    ] = None,
    realisations: Annotated[
        int | None, typer.Option(min=1, max=100, help="Multisines with other phases. Default: 4.")
    ] = None,
    points: Annotated[int | None, typer.Option(min=4, max=200, help="Sines. Default: 20.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, max=MOST_SEED, help="Of the phases. Default: 1.")] = None,
    relay: Annotated[
        bool | None,
        typer.Option("--relay/--no-relay", help="Run the relay before, to compare. Default: yes."),
    ] = None,
    e_a: Annotated[
        float | None,
        typer.Option("--e-a", metavar="V", min=1e-6, max=MOST_V, help="Of that relay. Default: as set."),
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
        typer.Option(metavar="S", min=0.0, max=1e3, help="Delay, if it is known; left out: it is estimated."),
    ] = None,
    output: Annotated[Literal["position", "velocity"], typer.Option(help="What y of DATA is.")] = "position",
    columns: Columns = "",
    units: Units = "",
    between: Between = None,
    as_json: Annotated[bool, typer.Option("--json", help="The answer as JSON.")] = False,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Bode plot into a PNG file.")] = None,
) -> None:
    """Measure the frequency response: points, fit, Bode plot beside what the limit cycle tells."""
    from seod.calibrate.procedure import CalibrationError  # noqa: PLC0415 - numerics
    from seod.data.source import ReadError  # noqa: PLC0415
    from seod.respond import command, live  # noqa: PLC0415
    from seod.respond.record import RespondError  # noqa: PLC0415

    with plain_errors():
        given: dict[str, Any] = {
            "kind": kind,
            "amplitude": amplitude,
            "band": None if band is None else _pair("--band", band),
            "periods": periods,
            "realisations": realisations,
            "points": points,
            "relay": relay,
            "e_a": e_a,
            "seed": seed,
        }
        chosen = {name: value for name, value in given.items() if value is not None}
        part = None if between is None else rising(between, "--between")
        options = command.Options(
            axis, gain, delay, output, columns, units, part, period, limit_cycle, predict, as_json, plot
        )
        _check(paths, config, chosen, options)
        try:
            rig = None if config is None else load(config)
            if paths:
                show(command.from_recordings(paths, rig, options))
            elif rig is not None and config is not None:
                show(command.on_rig(rig, config, live.Options(period=period, **chosen), options))
        except (ReadError, RespondError, CalibrationError) as error:
            raise CommandError(str(error)) from error


def _check(paths: list[Path] | None, config: Path | None, chosen: dict[str, Any], options: Any) -> None:
    """What does not go together."""
    if not paths and config is None:
        raise CommandError("give recordings, or a rig by --config")
    live_only = sorted(f"--{name.replace('_', '-')}" for name in chosen)
    if paths and (live_only or options.predict):
        what = ", ".join([*live_only, *(["--predict"] if options.predict else [])])
        raise CommandError(f"{what}: for a rig that is excited, not for recordings")
    default = type(options)()
    for name in ("output", "columns", "units", "between", "relay"):
        if not paths and getattr(options, name) != getattr(default, name):
            option = {"relay": "limit-cycle"}.get(name, name)
            raise CommandError(f"--{option}: for recordings, not for a rig")


def _pair(option: str, text: str) -> tuple[float, float]:
    """`LOW:HIGH` as numbers above 0.

    Raises:
        CommandError: It is not that.
    """
    pair = rising(text, option)
    if not 0.0 < pair[0] < pair[1] < math.inf:
        raise CommandError(f"{option} {text}: give two rising numbers above 0, such as 0.5:60")
    return pair
