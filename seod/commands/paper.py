"""The command `seod paper`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seod.commands.common import CommandError, app, plain_errors, show


@app.command()
def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of pictures, numbers and page.")] = Path(
        "paper"
    ),
    figure: Annotated[
        list[str] | None,
        typer.Option(metavar="N", help="Only this: 4, 10 to 15, exponent or amplitude; repeatable."),
    ] = None,
) -> None:
    """Reproduce the paper's figures and tables on the simulated rigs: pictures, numbers and one page."""
    from seod.paper.command import compute_all, write  # noqa: PLC0415 - numerics
    from seod.paper.words import TITLES  # noqa: PLC0415
    from seod.terminal.progress import bar  # noqa: PLC0415

    with plain_errors():
        if unknown := [name for name in figure or () if name not in TITLES]:
            raise CommandError(f"--figure {unknown[0]}: there are {', '.join(TITLES)}")
        if out.exists() and not out.is_dir():
            raise CommandError(f"--out {out}: is no folder")
        with bar() as told:
            found = compute_all(figure or list(TITLES), told)
        written = write(found, out)
        show(f"{len(written)} files in {out}; begin with {out / 'paper.html'}")
