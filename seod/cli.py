"""The command line. Each command imports only what it needs, so that `seod status` answers at once."""

from __future__ import annotations

import inspect
import json
import sys
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seod import PROTOCOL, __version__, data_commands
from seod.client import DEFAULT_HOST, DEFAULT_PORT, Client, ClientError
from seod.config.errors import ConfigErrors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from seod.config.model import RigConfig

app = typer.Typer(
    help="Live damping ratio and natural frequency of hydraulic servo actuators.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ConfigPath = Annotated[Path, typer.Argument(metavar="CONFIG", help="Rig file.", show_default=False)]
Axis = Annotated[str | None, typer.Argument(help="Axis; all of them, or the only one, if left out.")]
Duration = Annotated[float | None, typer.Option("--for", min=0.0, metavar="S", help="End after this long.")]
Json = Annotated[bool, typer.Option("--json", help="The daemon's answer as JSON.")]


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


def load(path: Path) -> RigConfig:
    """Read a rig file."""
    from seod.config.load import load_rig  # noqa: PLC0415 - pydantic, and the driver

    return load_rig(path)


def client_command(function: Callable[..., None]) -> Callable[..., None]:
    """Make a command of a function of a `Client`: adds the options that say where the daemon is."""

    def connection(
        host: Annotated[str, typer.Option(help="Where the daemon runs.")] = DEFAULT_HOST,
        port: Annotated[int, typer.Option(help="Its port.", min=1, max=65535)] = DEFAULT_PORT,
        token: Annotated[
            str | None, typer.Option(envvar="SEOD_TOKEN", help="Its token, if it wants one.")
        ] = None,
        tls: Annotated[
            Path | None, typer.Option(metavar="PEM", help="Use TLS; trust this certificate.")
        ] = None,
    ) -> None: ...

    @wraps(function)
    def command(host: str, port: int, token: str | None, tls: Path | None, **arguments: Any) -> None:
        with plain_errors(), Client(host, port, token, tls) as client:
            function(client, **arguments)

    signatures = [inspect.signature(f, eval_str=True) for f in (function, connection)]
    own, common = (list(signature.parameters.values()) for signature in signatures)
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own[1:] + common]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined] # what typer reads
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    app.command(function.__name__.rstrip("_"))(command)
    return function


def _version(wanted: bool) -> None:
    if wanted:
        show(f"seod {__version__}, protocol {PROTOCOL}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
]


@app.callback()
def options(version: Version = False) -> None:
    """Live damping ratio and natural frequency of hydraulic servo actuators."""


@app.command()
def run(
    path: ConfigPath,
    duration: Duration = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record to this .mcap file, or rows to .csv."),
    ] = None,
    start: Annotated[bool, typer.Option("--start", help="Excite all axes at once.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Show live estimates.")] = False,
) -> None:
    """Run the daemon in the foreground."""
    from seod import launch  # noqa: PLC0415

    with plain_errors():
        try:
            if not (start or watch):
                launch.run(path, duration, record)  # replaces this process
            raise typer.Exit(_attend(path, duration, record, start, watch))
        except launch.LaunchError as error:
            raise CommandError(str(error)) from error


def _attend(path: Path, duration: float | None, record: Path | None, start: bool, watch: bool) -> int:
    from seod.attend import AttendError, attend  # noqa: PLC0415

    try:
        return abs(attend(load(path), path, duration, record, start, watch))
    except AttendError as error:
        raise CommandError(str(error)) from error


@app.command()
def rig(
    path: ConfigPath,
    duration: Duration = None,
    control_port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Instead of the rig file's.")
    ] = None,
) -> None:
    """Be the simulated rig on the other end of the bus."""
    with plain_errors():
        config = load(path)
        if config.simulation is None:
            raise CommandError(f"{path} has no `simulation:` section: there is nothing to simulate")
        if config.driver["kind"] != "can":
            kind = config.driver["kind"]
            raise CommandError(f"driver.kind {kind} has no bus with another end; `seod rig` needs kind: can")
        from drivers.base import DriverError  # noqa: PLC0415
        from drivers.can_config import CanOptions  # noqa: PLC0415
        from sim.can_rig import run as run_rig  # noqa: PLC0415

        try:
            run_rig(CanOptions.model_validate(config.driver), config.simulation, control_port, duration)
        except (DriverError, OSError) as error:
            raise CommandError(str(error)) from error


@app.command()
def latency(
    duration: Annotated[
        float, typer.Option("--for", min=0.1, metavar="S", help="Measure for this long.")
    ] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON.")] = False,
) -> None:
    """Show how late this machine and the loop wake up, and what to change."""
    from seod.measure_latency import MeasureError, measure  # noqa: PLC0415 - the whole loop

    with plain_errors():
        try:
            report = measure(duration)
        except MeasureError as error:
            raise CommandError(str(error)) from error
        show(json.dumps(report.as_json()) if as_json else report.as_text())


@app.command()
def calibrate(
    path: ConfigPath,
    axis: Annotated[str | None, typer.Option(help="This axis alone.")] = None,
    pressures: Annotated[
        int, typer.Option(min=1, help="Measure at so many supply pressures; asks for each.")
    ] = 1,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the change, write nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Move and write without asking.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Results as JSON.")] = False,
) -> None:
    """Measure polarity, K_L, null, deadband and delay; write them into the rig file."""
    from seod.calibrate import shell  # noqa: PLC0415 - numerics
    from seod.calibrate.procedure import CalibrationError  # noqa: PLC0415

    with plain_errors():
        config = load(path)
        if axis is not None and axis not in config.axes:
            raise CommandError(f"no axis {axis!r}; {path} has {', '.join(config.axes)}")
        try:
            axes = list(config.axes) if axis is None else [axis]
            shell.calibrate(config, path, axes, pressures, shell.Wishes(dry_run, yes, as_json))
        except (CalibrationError, OSError) as error:
            raise CommandError(str(error)) from error


@app.command()
def check(path: ConfigPath) -> None:
    """Validate a rig file and compute its bus load."""
    from seod.config.check import check as judge  # noqa: PLC0415

    with plain_errors():
        report = judge(load(path))
        show(str(report))
        raise typer.Exit(report.exit_status)


@client_command
def status(client: Client, as_json: Json = False) -> None:
    """Show the whole rig at once."""
    from seod import text  # noqa: PLC0415

    answer = client.status()
    show(json.dumps(answer) if as_json else text.status(answer))


@client_command
def get(client: Client, axis: Axis = None, as_json: Json = False) -> None:
    """Show an axis: state, settings and newest estimate."""
    from seod import text  # noqa: PLC0415

    answer = client.get(axis)
    show(json.dumps(answer) if as_json else text.axis(answer))


@client_command
def watch(
    client: Client,
    duration: Duration = None,
    count: Annotated[int | None, typer.Option(min=1, help="End after so many estimates.")] = None,
) -> None:
    """Show live estimates: a table in a terminal, else one line for each."""
    from seod.view import watch as show_live  # noqa: PLC0415

    show_live(client, duration, count)


def read_assignments(words: list[str]) -> tuple[str | None, dict[str, float | str]]:
    """`["motor", "e_a=1.5"]` to axis and values; a word that is no number stays a word.

    Raises:
        typer.BadParameter: Something else.
    """
    axis = None if "=" in words[0] else words[0]
    values: dict[str, float | str] = {}
    for word in words[axis is not None :]:
        name, equals, value = word.partition("=")
        if not equals:
            raise typer.BadParameter(f"{word!r} is not NAME=VALUE, such as e_a=1.5")
        try:
            values[name] = float(value)
        except ValueError:
            values[name] = {"true": True, "false": False}.get(value, value)
    return axis, values


def _check_assignments(words: list[str]) -> list[str]:
    read_assignments(words)
    return words


Assignments = Annotated[
    list[str],
    typer.Argument(
        metavar="[AXIS] NAME=VALUE...",
        help="e_a, bias [V], hysteresis [axis unit], K_L, method; in velocity mode reference, trim=false.",
        callback=_check_assignments,
    ),
]


@client_command
def set_(client: Client, assignments: Assignments, as_json: Json = False) -> None:
    """Change settings of an axis."""
    from seod import text  # noqa: PLC0415

    axis, values = read_assignments(assignments)
    answer = client.set(axis, **values)
    show(json.dumps(answer) if as_json else text.settings(answer["settings"]))


@client_command
def start(client: Client, axis: Axis = None) -> None:
    """Excite an axis, or all."""
    client.start(axis)


@client_command
def stop(client: Client, axis: Axis = None) -> None:
    """End the excitation; the axis goes back to where it stood."""
    client.stop(axis)


@client_command
def estop(client: Client) -> None:
    """Neutral at once; needs a reset afterwards."""
    client.estop()


@client_command
def reset(client: Client, axis: Axis = None) -> None:
    """Leave the fault, of an axis or of all; starts a new loop where it has died."""
    client.reset(axis)


@client_command
def ramp(
    client: Client,
    low: Annotated[float, typer.Option("--from", min=0.0, metavar="V", help="Smallest e_a.")],
    high: Annotated[float, typer.Option("--to", min=0.0, metavar="V", help="Largest e_a.")],
    axis: Axis = None,
    steps: Annotated[int, typer.Option(min=2, max=100, help="Amplitudes.")] = 8,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw it into a PNG file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Results as JSON.")] = False,
) -> None:
    """Raise e_a in steps: smallest clean amplitude, zeta and omega_n over e_a."""
    from seod.calibrate import ramp as procedure  # noqa: PLC0415 - numerics
    from seod.calibrate.procedure import CalibrationError  # noqa: PLC0415

    try:
        procedure.run(client, axis, low, high, steps, plot, as_json)
    except CalibrationError as error:
        raise CommandError(str(error)) from error


app.command()(data_commands.info)
app.command()(data_commands.export)


def main() -> None:
    """Entry point of the command `seod`."""
    app()


if __name__ == "__main__":
    main()
