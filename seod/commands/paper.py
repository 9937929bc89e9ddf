"""The command `seod paper`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seod.commands.common import MOST_WORKERS, CommandError, app, plain_errors, show


@app.command()
def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of pictures, numbers and page.")] = Path(
        "paper"
    ),
    figure: Annotated[
        list[str] | None,
        typer.Option(metavar="N", help="Only this: 4, 10 to 15, exponent or amplitude; repeatable."),
    ] = None,
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="local, or a scheduler of Dask: tcp://host:8786.")
    ] = "local",
    workers: Annotated[
        int | None,
        typer.Option(min=0, max=MOST_WORKERS, help="Processes of this machine; 0: this one. Default: 2."),
    ] = None,
) -> None:
    """Reproduce the paper's figures and tables on the simulated rigs: pictures, numbers and one page."""
    from seod.batch.executor import StoppedError  # noqa: PLC0415
    from seod.paper.command import compute_all, executor, write  # noqa: PLC0415 - numerics
    from seod.paper.words import TITLES  # noqa: PLC0415
    from seod.terminal.progress import bar  # noqa: PLC0415

    with plain_errors():
        if unknown := [name for name in figure or () if name not in TITLES]:
            raise CommandError(f"--figure {unknown[0]}: there are {', '.join(TITLES)}")
        if out.exists() and not out.is_dir():
            raise CommandError(f"--out {out}: is no folder")
        try:
            with bar() as told:
                found = compute_all(figure or list(TITLES), told, executor(scheduler, workers))
        except (ValueError, ImportError, StoppedError) as error:
            raise CommandError(str(error)) from error
        written = write(found, out)
        show(f"{len(written)} files in {out}; begin with {out / 'paper.html'}")
