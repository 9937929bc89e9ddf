"""What all commands share: the application they register with, how errors are told, how a rig file is read.

Each command imports only what it needs, so that `seod status` answers at once.
"""

from __future__ import annotations

import math
import os
import signal
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from seod.client import ClientError
from seod.commands.examples import epilog, panel, place
from seod.commands.quantity import Gain as GainType
from seod.commands.quantity import seconds
from seod.config.errors import ConfigErrors
from seod.files.user_files import said
from seod.machine.limits import NeedsLinuxError, needs_linux

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from seod.config.model import RigConfig


_Function = TypeVar("_Function", bound="Callable[..., Any]")


_PLAIN: dict[Any, str] = {int: "NUMBER", float: "NUMBER", str: "NAME", list[str]: "NAME", Path: "FILE"}
"""What stands for a value in the help, by its type."""


class FiniteCommand(TyperCommand):
    """A command none of whose numbers is infinite or none at all, which ranges let through.

    Its `--help` is in colour and in groups on a terminal, plain elsewhere, and ends with examples.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line.

        Raises:
            typer.BadParameter: A number is not finite.
        """
        rest = super().parse_args(ctx, args)
        for param in self.get_params(ctx):
            value = ctx.params.get(param.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise typer.BadParameter("must be a finite number", ctx, param_hint=f"'{param.opts[0]}'")
        return rest

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help."""
        name = _words(ctx)
        for each in self.get_params(ctx):
            if each.metavar is None:
                each.metavar = _PLAIN.get(getattr(getattr(each, "type_descriptor", None), "annotation", None))
            if isinstance(each, TyperArgument):
                each.display_type = lambda ctx: ""  # type: ignore[method-assign] # noqa: ARG005 - its name says it
            elif sys.stdout.isatty() and getattr(each, "is_flag", False):
                each.metavar = ""  # it takes no value
        self.epilog = epilog(name)
        if not sys.stdout.isatty():
            super().format_help(ctx, formatter)
            return
        from rich.markup import escape  # noqa: PLC0415 - only where it is seen
        from typer import rich_utils  # noqa: PLC0415

        for each in self.params:
            each.rich_help_panel = panel(each.name or "", name) or each.rich_help_panel  # type: ignore[attr-defined] # typer's own
            if text := getattr(each, "help", None):
                each.help = escape(text)  # type: ignore[attr-defined] # likewise
        self.epilog = escape(self.epilog)
        rich_utils.rich_format_help(obj=self, ctx=ctx, markup_mode="rich")

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 - click's
        """Examples, a line each, as they are typed."""
        if self.epilog:
            formatter.write("\n" + self.epilog.replace("\n\n", "\n") + "\n")


def _words(ctx: Any) -> str:
    """A command's name, after those of the groups that it is in: `archive query`."""
    words = []
    while ctx.parent is not None:
        words.append(ctx.info_name or "")
        ctx = ctx.parent
    return " ".join(reversed(words))


@contextmanager
def ends_with_its_reader() -> Iterator[None]:
    """Where the reader of a pipe has gone, as in `| head`: end without a word, as other programs do."""
    try:
        with plain_errors():
            try:
                yield
            finally:
                show("", end="")  # what is still in the buffer
    except BrokenPipeError:
        _end_as_by_a_closed_pipe()


def _end_as_by_a_closed_pipe() -> None:
    """Die of SIGPIPE, which a shell tells as 141; with 1 where there are no such signals."""
    if not hasattr(signal, "SIGPIPE"):
        os._exit(1)
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    signal.raise_signal(signal.SIGPIPE)


class Group(TyperGroup):
    """All commands: help in colour on a terminal, plain errors everywhere, a quiet end under `| head`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """As they are learnt."""
        return sorted(super().list_commands(ctx), key=place)

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the command line; `--help` and `--version` print here."""
        with ends_with_its_reader():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with ends_with_its_reader():
            return super().invoke(ctx)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help."""
        if not sys.stdout.isatty():
            super().format_help(ctx, formatter)
            return
        from typer import rich_utils  # noqa: PLC0415 - only where it is seen

        rich_utils.rich_format_help(obj=self, ctx=ctx, markup_mode="rich")


class App(typer.Typer):
    """Its commands are `FiniteCommand`."""

    def command(self, *args: Any, **kwargs: Any) -> Callable[[_Function], _Function]:
        """As of `typer.Typer`."""
        return super().command(*args, **{"cls": FiniteCommand, **kwargs})


app = App(
    help="Live damping ratio and natural frequency of hydraulic servo actuators.",
    cls=Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def names() -> list[str]:
    """All commands, those of a group after its name: `archive query`."""
    groups = [("", app), *((f"{group.name} ", group.typer_instance) for group in app.registered_groups)]
    every = [
        before + (each.name or getattr(each.callback, "__name__", "").rstrip("_"))
        for before, group in groups
        if group is not None
        for each in group.registered_commands
    ]
    return sorted(every, key=place)


ConfigPath = Annotated[Path, typer.Argument(metavar="CONFIG", help="Rig file.", show_default=False)]
MOST_S = 1e9
"""Longest time that anyone can mean [s]: 30 years."""
MOST_V = 1e4
"""Largest voltage that anyone can mean [V]: a thousand times that of an amplifier."""
MOST_WORKERS = 1000
"""Most processes that one machine is asked for."""
MOST_SEED = 2**63 - 1
Duration = Annotated[
    float | None,
    typer.Option("--for", **seconds(), help="End after this long, such as 30 or '2 min'."),
]
Columns = Annotated[
    str,
    typer.Option(
        metavar="NAMES",
        help="Columns whose names differ: t=time,u=cmd,y=pos. t=50Hz: rows come at this rate.",
    ),
]
Units = Annotated[
    str, typer.Option(metavar="UNITS", help="Units where the file tells none, or wrong ones: y=deg,u=mV.")
]
Gain = Annotated[
    float | None,
    typer.Option(
        "--gain",
        metavar="GAIN",
        parser=GainType(),
        help="K_L, if it is known, such as '50 mm/s/V' (without a unit SI); left out: it is estimated.",
    ),
]
Between = Annotated[str | None, typer.Option(metavar="FROM:TO", help="Only this part of DATA, in seconds.")]


class CommandError(Exception):
    """A command cannot be carried out; the message says why."""


@contextmanager
def on_linux() -> Iterator[None]:
    """As `plain_errors`, for what excites a rig: that is told to need Linux elsewhere."""
    with plain_errors():
        needs_linux()
        yield


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
    except (ClientError, CommandError, NeedsLinuxError) as error:
        print(f"seod: {error}", file=sys.stderr)  # noqa: T201
        raise typer.Exit(1) from None
    except BrokenPipeError:  # whoever reads the answer has enough
        raise
    except OSError as error:
        print(f"seod: {said(error)}", file=sys.stderr)  # noqa: T201
        raise typer.Exit(1) from None


def show(text: str, end: str = "\n") -> None:
    """Print an answer.

    Raises:
        CommandError: The output takes nothing.
    """
    try:
        print(text, end=end, flush=True)  # noqa: T201
    except BrokenPipeError:
        raise
    except OSError as error:
        with Path(os.devnull).open("wb") as nothing:
            os.dup2(nothing.fileno(), sys.stdout.fileno())  # what is left cannot be told either
        raise CommandError(f"standard output: {error.strerror}") from error


def load(path: Path) -> RigConfig:
    """Read a rig file."""
    from seod.config.load import load_rig  # noqa: PLC0415 - pydantic, and the driver

    return load_rig(path)
