"""What all commands share: the application they register with, how errors are told, how a rig file is read.

Each command imports only what it needs, so that `seod status` answers at once.
"""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seod.client import ClientError
from seod.config.errors import ConfigErrors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.model import RigConfig

app = typer.Typer(
    help="Live damping ratio and natural frequency of hydraulic servo actuators.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ConfigPath = Annotated[Path, typer.Argument(metavar="CONFIG", help="Rig file.", show_default=False)]
Duration = Annotated[float | None, typer.Option("--for", min=0.0, metavar="S", help="End after this long.")]
Columns = Annotated[
    str, typer.Option(metavar="t=time,u=cmd,y=pos", help="Columns whose names differ from t, u, y.")
]
Units = Annotated[
    str, typer.Option(metavar="y=deg,u=mV", help="Units where the file tells none, or wrong ones.")
]
Between = Annotated[str | None, typer.Option(metavar="FROM:TO", help="Only this part of DATA [s].")]


class CommandError(Exception):
    """A command cannot be carried out; the message says why."""


@contextmanager
def plain_errors() -> Iterator[None]:
    """Say what went wrong on stderr, in plain sentences, and exit with 1."""
    try:
        yield
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    except ConfigErrors as errors:
        print(errors, file=sys.stderr)  # noqa: T201 - each starts with file and line already
        raise typer.Exit(1) from None
    except (ClientError, CommandError) as error:
        print(f"seod: {error}", file=sys.stderr)  # noqa: T201
        raise typer.Exit(1) from None


def show(text: str) -> None:
    """Print an answer."""
    print(text, flush=True)  # noqa: T201


def rising(text: str, option: str) -> tuple[float, float]:
    """`LOW:HIGH` as numbers.

    Raises:
        CommandError: It is not that.
    """
    low, _, high = text.partition(":")
    try:
        pair = float(low), float(high)
    except ValueError:
        pair = 0.0, 0.0
    if not pair[0] < pair[1]:
        raise CommandError(f"{option} {text}: give two rising numbers, such as 0.5:60")
    return pair


def load(path: Path) -> RigConfig:
    """Read a rig file."""
    from seod.config.load import load_rig  # noqa: PLC0415 - pydantic, and the driver

    return load_rig(path)
