"""The command `seod batch`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from seod.commands.answers import asking
from seod.commands.common import (
    MOST_S,
    MOST_V,
    MOST_WORKERS,
    Between,
    Columns,
    CommandError,
    Gain,
    Units,
    app,
    load,
    show,
)
from seod.commands.quantity import hertz, seconds, volts

if TYPE_CHECKING:
    from seod.batch.run import Batch, Outcome, Show

MOST_TOLD = 20
"""Failures that are printed; the table has all."""


@app.command()
def batch(
    kind: Annotated[
        Literal["diagnose", "identify", "response", "simulate"],
        typer.Argument(metavar="KIND", help="diagnose, identify, response or simulate."),
    ],
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES", help="Recordings, each asked by itself, or folders. For simulate: rig files."
        ),
    ],
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="local, or a scheduler of Dask: tcp://host:8786.")
    ] = "local",
    workers: Annotated[
        int | None,
        typer.Option(
            min=0, max=MOST_WORKERS, help="Processes of this machine; 0: without Dask. Default: processors."
        ),
    ] = None,
    memory: Annotated[
        str, typer.Option(metavar="SIZE", help="Most of each local worker, such as '2 GB'.")
    ] = "auto",
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Results and their table; what is there is not done again.")
    ] = Path("batch"),
    seeds: Annotated[
        str | None, typer.Option(metavar="SEEDS", help="Of simulate: 0-99, or 1,4,10-19. Default: 0.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="CONFIG", help="Rig file that the recordings are of.")
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Of recordings and rig files with several.")] = None,
    method: Annotated[
        Literal["output_error", "wave", "exact", "peaks"] | None, typer.Option(help="Of identify.")
    ] = None,
    gain: Gain = None,
    delay: Annotated[float | None, typer.Option(**seconds(0.0, 100.0), help="Delay, if it is known.")] = None,
    output: Annotated[Literal["position", "velocity"] | None, typer.Option(help="What y is.")] = None,
    offset: Annotated[
        bool | None, typer.Option("--offset/--no-offset", help="A velocity y may have an offset.")
    ] = None,
    hold: Annotated[
        Literal["zero", "first"] | None,
        typer.Option(help="Whether u holds until the next row or runs straight on to it."),
    ] = None,
    columns: Columns = "",
    units: Units = "",
    between: Between = None,
    effort: Annotated[
        Literal["quick", "normal", "thorough"] | None, typer.Option(help="Of diagnose.")
    ] = None,
    relevance: Annotated[
        float | None, typer.Option(metavar="PERCENT", min=0.0, max=100.0, help="Of diagnose.")
    ] = None,
    period: Annotated[
        float | None, typer.Option(**seconds(1e-3, MOST_S), help="Of a multisine, or of the data.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME.PARAMETER=VALUE", help="In the simulated plant; repeatable."),
    ] = None,
    excitation: Annotated[str | None, typer.Option(metavar="KIND", help="As of seod simulate.")] = None,
    amplitude: Annotated[float | None, typer.Option(**volts(0.0, MOST_V), help="Default: e_a.")] = None,
    duration: Annotated[float | None, typer.Option(**seconds(0.0, MOST_S), help="Default: 10 s.")] = None,
    frequency: Annotated[float | None, typer.Option(**hertz(), help="Of a sine, or of steps.")] = None,
    band: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="Of sweep or multisine, in Hz.")
    ] = None,
    noise: Annotated[
        float | None, typer.Option(min=0.0, max=1e6, help="Standard deviation of the simulated noise.")
    ] = None,
) -> None:
    """Ask the same of many files, on many workers: a result for each, a table, and what failed."""
    options: dict[str, Any] = {
        "config": config,
        "axis": axis,
        "method": method,
        "gain": gain,
        "delay": delay,
        "output": output,
        "offset": offset,
        "hold": hold,
        "columns": columns or None,
        "units": units or None,
        "between": between,
        "effort": effort,
        "relevance": relevance,
        "period": period,
        "effect": effect or None,
        "excitation": excitation,
        "amplitude": amplitude,
        "duration": duration,
        "frequency": frequency,
        "band": band,
        "noise": noise,
    }
    with asking():
        from seod.batch.run import Batch  # noqa: PLC0415 - numerics, and a compiler
        from seod.terminal.progress import bar  # noqa: PLC0415 - rich

        if config is not None:
            load(config)  # what is wrong with it is told once, before the work
        with Batch(kind, files, out, options, seeds) as work:
            with bar() as progress:
                outcome = _done(work, progress, scheduler, workers, memory)
            _tell(kind, outcome)
    if outcome.failures:
        raise typer.Exit(1)


def _done(work: Batch, progress: Show, scheduler: str, workers: int | None, memory: str) -> Outcome:
    """What becomes of it, whoever does it; however it ends, how to go on is told."""
    from seod.batch.door import door  # noqa: PLC0415
    from seod.batch.executor import StoppedError  # noqa: PLC0415
    from seod.terminal.console import console  # noqa: PLC0415

    talk = console()
    try:
        with door(scheduler, workers, memory, talk.print) as executor:
            if link := getattr(executor, "link", None):
                talk.print(f"dashboard: {link}")
            return work.run(executor, progress)
    except ImportError as error:
        raise CommandError(str(error)) from error
    except StoppedError as error:
        raise CommandError(f"{error}; {_resume(work)}") from error
    except KeyboardInterrupt:
        talk.print(f"seod: interrupted; {_resume(work)}")
        raise


def _resume(work: Batch) -> str:
    return f"{work.done} of {len(work.tasks)} are done, and the same command goes on from there"


def _tell(kind: str, outcome: Outcome) -> None:
    failed = len(outcome.failures)
    before = f", {outcome.before} of them before" if outcome.before else ""
    for name, why in list(outcome.failures.items())[:MOST_TOLD]:
        show(f"! {name}: {why.removeprefix(f'{name}: ')}")
    if failed > MOST_TOLD:
        show(f"! and {failed - MOST_TOLD} more, in the table")
    show(f"{kind}: {outcome.inputs} files{before}, {failed} failed; table: {outcome.table}")
