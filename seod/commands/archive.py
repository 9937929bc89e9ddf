"""`seod archive`: catalogues of recordings. Its libraries are imported only when one of these runs."""

from __future__ import annotations

import os
import shutil
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from seod.commands.common import App, CommandError, Group, app, plain_errors, show

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

PROBLEMS: int = 3
"""Exit status of a build that has met recordings which cannot be read whole."""
_SHOWN = 20
"""Problems that are told one by one."""


class _Archive(Group):
    """`seod archive DIR` is `seod archive build DIR`."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command by its name; a word that is none is the archive that is built."""
        if args and self.get_command(ctx, args[0]) is None:
            args = ["build", *args]
        return super().resolve_command(ctx, args)


archive = App(
    help="Catalogues of recordings: seod archive DIR builds one, the other commands ask it.",
    cls=_Archive,
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(archive, name="archive")

Where = Annotated[
    str,
    typer.Argument(
        metavar="DIR", help="Folder of recordings, or a URL: s3://bucket/prefix.", show_default=False
    ),
]
Rig = Annotated[str | None, typer.Option(metavar="NAME", help="Only this rig.")]
Since = Annotated[
    str | None, typer.Option(metavar="TIME", help="Only what is later: 2026-01-31, or with 12:00 (UTC).")
]
Form = Annotated[
    Literal["csv", "parquet", "html", "json"] | None,
    typer.Option(help="Instead of a table; with --out its ending says it."),
]
Out = Annotated[Path | None, typer.Option(metavar="FILE", help="Write the answer into a file.")]
Plot = Annotated[Path | None, typer.Option(metavar="FILE", help="Draw it: PNG, SVG or PDF.")]
Quantity = Annotated[Literal["omega_n", "zeta", "K_L"], typer.Option(help="What is followed over time.")]


@contextmanager
def _asking() -> Iterator[None]:
    """As `plain_errors`, for archives."""
    from seod.archive.engines import ArchiveError  # noqa: PLC0415 - not needed by other commands

    with plain_errors():
        try:
            yield
        except (ArchiveError, ValueError) as error:
            raise CommandError(str(error)) from error


@archive.command()
def build(
    where: Where,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=256, help="Processes; left out: one a processor.")
    ] = None,
    identify: Annotated[
        bool, typer.Option(help="Identify excited segments of which no estimate was recorded.")
    ] = True,
    diagnose: Annotated[
        bool, typer.Option("--diagnose", help="Diagnose recordings in which the rig has left its model.")
    ] = False,
) -> None:
    """Build the catalogue of a folder of MCAP recordings, or bring it up to date.

    Exit status 3: recordings that were read now could not be read whole; what is whole of them is in it.
    """
    with _asking():
        from seod.archive.build import build as build_now  # noqa: PLC0415 - numpy
        from seod.terminal.progress import bar  # noqa: PLC0415 - rich

        count = workers or _processors()
        with bar() as told:
            built = build_now(where, count, identify, told)
            problems = dict(built.problems)
            if diagnose:
                from seod.archive.diagnosing import diagnose_left  # noqa: PLC0415 - numerics

                silent = diagnose_left(where, told)
                problems |= build_now(where, count, identify, told).problems
                problems |= {file: f"is not diagnosed: {why}" for file, why in silent.items()}
        gone = f", {built.gone} gone" if built.gone else ""
        days = f"; {built.days} days of the fleet" if built.days else ""
        show(f"{where}: {built.files} recordings, {built.read} read now{gone}{days}")
        _tell(problems)
    if problems:
        raise typer.Exit(PROBLEMS)


def _processors() -> int:
    affinity = getattr(os, "sched_getaffinity", None)  # of Linux: those that this process may use
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _tell(problems: Mapping[str, str]) -> None:
    for file in sorted(problems)[:_SHOWN]:
        print(f"! {file}: {problems[file]}", file=sys.stderr)  # noqa: T201
    if len(problems) > _SHOWN:
        more = "SELECT DISTINCT file, problem FROM segments WHERE problem IS NOT NULL"
        print(f"! and {len(problems) - _SHOWN} more: {more}", file=sys.stderr)  # noqa: T201


@archive.command()
def query(
    where: Where,
    sql: Annotated[
        str, typer.Argument(metavar="SQL", help="Over `segments` and `fleet`.", show_default=False)
    ],
    to: Form = None,
    out: Out = None,
) -> None:
    """Ask the catalogue in SQL (DuckDB), over `segments` and `fleet`; nothing is written by it."""
    with _asking():
        from seod.archive.sql import ask  # noqa: PLC0415 - duckdb

        _answer(ask(where, sql), to, out, "seod archive query")


@archive.command()
def trend(
    where: Where,
    quantity: Quantity = "omega_n",
    rig: Rig = None,
    since: Since = None,
    plot: Plot = None,
    to: Form = None,
    out: Out = None,
) -> None:
    """Show how omega_n, zeta or K_L of each axis changes over time, the surest change first."""
    with _asking():
        from seod.archive import questions  # noqa: PLC0415 - duckdb

        from_then = _time(since)
        table = questions.trend(where, quantity, rig, from_then)
        if plot is not None:
            _draw([questions.points(where, quantity, rig, from_then)], quantity, plot)
        _answer(table, to, out, f"Trend of {quantity}")


@archive.command("left-model")
def left_model(where: Where, rig: Rig = None, since: Since = None, to: Form = None, out: Out = None) -> None:
    """Show which rigs have left their model, since when, and why as far as a diagnosis says."""
    with _asking():
        from seod.archive import questions  # noqa: PLC0415 - duckdb

        _answer(questions.left_model(where, rig, _time(since)), to, out, "Rigs that have left their model")


@archive.command()
def causes(where: Where, rig: Rig = None, since: Since = None, to: Form = None, out: Out = None) -> None:
    """Show the causes that diagnoses have named: in how many rigs, since when, with which parameters."""
    with _asking():
        from seod.archive import questions  # noqa: PLC0415 - duckdb

        _answer(questions.causes(where, rig, _time(since)), to, out, "Causes")


@archive.command()
def compare(
    where: Where,
    rig: Annotated[str, typer.Argument(metavar="RIG", help="One rig.", show_default=False)],
    other: Annotated[str, typer.Argument(metavar="RIG", help="The other.", show_default=False)],
    quantity: Quantity = "omega_n",
    since: Since = None,
    plot: Plot = None,
    to: Form = None,
    out: Out = None,
) -> None:
    """Show two rigs side by side: means, spread, and whether they differ; --quantity is of the picture."""
    with _asking():
        from seod.archive import questions  # noqa: PLC0415 - duckdb

        from_then = _time(since)
        table = questions.compare(where, rig, other, from_then)
        if plot is not None:
            names = dict.fromkeys((rig, other))
            _draw([questions.points(where, quantity, each, from_then) for each in names], quantity, plot)
        _answer(table, to, out, f"{rig} and {other}")


def _draw(points: list[Any], quantity: str, plot: Path) -> None:
    from seod.archive.pictures import draw  # noqa: PLC0415 - matplotlib
    from seod.plots.style import save  # noqa: PLC0415

    save(draw([row for table in points for row in table.to_pylist()], quantity), plot)


def _time(since: str | None) -> datetime | None:
    from datetime import UTC, datetime  # noqa: PLC0415

    if since is None:
        return None
    try:
        told = datetime.fromisoformat(since)
    except ValueError as error:
        raise CommandError(f"--since {since}: is no time such as 2026-01-31 or 2026-01-31T12:00") from error
    return told if told.tzinfo else told.replace(tzinfo=UTC)


def _answer(table: Any, to: str | None, out: Path | None, title: str) -> None:
    """Print it, or write it into a file."""
    from seod.archive import answers  # noqa: PLC0415 - pyarrow

    form = answers.form_of(to, out)
    if out is not None and form is not None:
        answers.write(out, answers.packed(table, form, title))
        show(f"{out}: {len(table)} rows")
    elif form is not None:
        show(answers.packed(table, form, title).decode().rstrip("\n"))
    else:
        width = shutil.get_terminal_size((answers.WIDTH, 0)).columns if sys.stdout.isatty() else answers.WIDTH
        show(answers.as_text(table, width))
