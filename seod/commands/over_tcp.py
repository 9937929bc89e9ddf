"""Commands to a daemon that runs, over TCP."""

from __future__ import annotations

import inspect
import json
import math
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seod.client import DEFAULT_HOST, DEFAULT_PORT, Client, EndedError
from seod.client.connection import speaks_tls
from seod.client.nearby import find
from seod.commands.common import MOST_V, CommandError, Duration, app, plain_errors, show
from seod.commands.quantity import seconds, volts
from seod.files.user_files import irregular

if TYPE_CHECKING:
    from collections.abc import Callable

Axis = Annotated[str | None, typer.Argument(help="Axis; all of them, or the only one, if left out.")]
Json = Annotated[bool, typer.Option("--json", help="The daemon's answer as JSON.")]


def client_command(function: Callable[..., None]) -> Callable[..., None]:
    """Make a command of a function of a `Client`: adds the options that say where the daemon is."""

    def connection(
        host: Annotated[str, typer.Option(envvar="SEOD_HOST", help="Where the daemon runs.")] = DEFAULT_HOST,
        port: Annotated[
            int, typer.Option(envvar="SEOD_PORT", help="Its port.", min=1, max=65535)
        ] = DEFAULT_PORT,
        rig_name: Annotated[
            str | None,
            typer.Option("--rig", metavar="NAME", help="The daemon of this rig, on this computer."),
        ] = None,
        token: Annotated[
            str | None,
            typer.Option(envvar="SEOD_TOKEN", help="Its token, if it wants one; `ps` shows it to everyone."),
        ] = None,
        token_file: Annotated[
            Path | None,
            typer.Option(metavar="FILE", envvar="SEOD_TOKEN_FILE", help="Read the token from this file."),
        ] = None,
        tls: Annotated[
            Path | None, typer.Option(metavar="PEM", help="Use TLS; trust this certificate.")
        ] = None,
    ) -> None: ...

    @wraps(function)
    def command(
        host: str,
        port: int,
        rig_name: str | None,
        token: str | None,
        token_file: Path | None,
        tls: Path | None,
        **arguments: Any,
    ) -> None:
        with plain_errors():
            if tls is not None and (why := irregular(tls)):
                raise CommandError(f"{tls}: {why}")
            if rig_name is not None:
                _, host, port, _ = find(rig_name)
            try:
                with Client(host, port, _token(token, token_file), tls) as client:
                    function(client, **arguments)
            except EndedError as error:
                if tls is None and speaks_tls(host, port):
                    told = f"{host}:{port} wants TLS: --tls PEM names the certificate to trust"
                    raise CommandError(told) from error
                raise

    signatures = [inspect.signature(f, eval_str=True) for f in (function, connection)]
    own, common = (list(signature.parameters.values()) for signature in signatures)
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own[1:] + common]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined] # what typer reads
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    app.command(function.__name__.rstrip("_"))(command)
    return function


def _token(token: str | None, file: Path | None) -> str | None:
    """The client's token; one that is given by itself counts before a file.

    Raises:
        CommandError: The file holds none, or others can read it.
    """
    if token or file is None:
        return token
    from seod.config.tokens import TokenError, read_token_file  # noqa: PLC0415 - pydantic

    try:
        return read_token_file(file)
    except TokenError as error:
        raise CommandError(str(error)) from error


@client_command
def status(client: Client, as_json: Json = False) -> None:
    """Show the whole rig at once."""
    from seod.terminal import text  # noqa: PLC0415

    answer = client.status()
    show(json.dumps(answer) if as_json else text.status(answer))


@client_command
def get(client: Client, axis: Axis = None, as_json: Json = False) -> None:
    """Show an axis: state, settings and newest estimate."""
    from seod.terminal import text  # noqa: PLC0415

    answer = client.get(axis)
    show(json.dumps(answer) if as_json else text.axis(answer))


@client_command
def watch(
    client: Client,
    duration: Duration = None,
    count: Annotated[int | None, typer.Option(min=1, help="End after so many estimates.")] = None,
    axis: Annotated[str | None, typer.Option(help="Only this axis.")] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HERTZ",
            min=1e-3,
            max=1e4,
            help="Estimates a second of each axis, at most. Default: all in a terminal, else 2.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Each message as a line of JSON.")] = False,
) -> None:
    """Show live estimates: a table in a terminal, else one line for each."""
    from seod.terminal.live_view import watch as show_live  # noqa: PLC0415

    show_live(client, duration, count, axis=axis, rate_hz=rate, as_json=as_json)


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
        values[name] = _assigned(name, value)
    return axis, values


def _assigned(name: str, value: str) -> float | str:
    """A number, or words: the daemon reads units, for it knows those of the axis.

    Raises:
        typer.BadParameter: A unit that no such setting has.
    """
    from seod.config.units import SETTINGS, dimension_of, parse_quantity  # noqa: PLC0415 - only a few need it

    try:
        number = float(value)
    except ValueError:
        if dimension_of(value) is None:
            return {"true": True, "false": False}.get(value, value)
    else:
        if not math.isfinite(number):
            raise typer.BadParameter(f"{name}={value}: must be a finite number")
        return number
    try:
        parse_quantity(value, *SETTINGS.get(name, ()))
    except ValueError as error:
        raise typer.BadParameter(f"{name}: {error}") from error
    return value


def _check_assignments(words: list[str]) -> list[str]:
    read_assignments(words)
    return words


Assignments = Annotated[
    list[str],
    typer.Argument(
        metavar="[AXIS] NAME=VALUE",
        help="e_a, bias, hysteresis, K_L ('50 mm/s/V'; without a unit SI), method, two_phase; "
        "with a speed reference, trim.",
        callback=_check_assignments,
    ),
]


@client_command
def set_(client: Client, assignments: Assignments, as_json: Json = False) -> None:
    """Change settings of an axis."""
    from seod.terminal import text  # noqa: PLC0415

    axis, values = read_assignments(assignments)
    answer = client.set(axis, **values)
    if as_json:
        show(json.dumps(answer))
        return
    show(text.settings(answer["settings"], client.get(answer["axis"]).get("units")))


@client_command
def start(
    client: Client,
    axis: Axis = None,
    wait: Annotated[
        bool,
        typer.Option("--wait", help="Until each axis has an estimate of quality ok, or why it has none."),
    ] = False,
    timeout: Annotated[
        float, typer.Option(**seconds(), help="With --wait: give up after this long.", show_default="30 s")
    ] = 30.0,
    hold: Annotated[
        bool, typer.Option("--hold", help="Hold the rig (guard.dead_man) until Ctrl-C, then stop it.")
    ] = False,
) -> None:
    """Excite an axis, or all."""
    if hold:
        from seod.client.keepalive import hold_until_interrupted  # noqa: PLC0415

        hold_until_interrupted(client, axis)
    elif wait:
        from seod.client.waiting import start_and_wait  # noqa: PLC0415
        from seod.terminal import text  # noqa: PLC0415

        for estimate in start_and_wait(client, axis, timeout).values():
            show(text.estimate(estimate))
    else:
        client.start(axis)
        show(f"{axis or 'all axes'}: started")


@client_command
def stop(client: Client, axis: Axis = None) -> None:
    """End the excitation; the axis goes back to where it stood."""
    client.stop(axis)
    show(f"{axis or 'all axes'}: stopped, and goes back to where it stood")


@client_command
def estop(client: Client) -> None:
    """Neutral at once; needs a reset afterwards."""
    client.estop()
    show("neutral; `seod reset` leaves the fault")


@client_command
def reset(client: Client, axis: Axis = None) -> None:
    """Leave the fault, of an axis or of all; starts a new loop where it has died."""
    client.reset(axis)
    show(f"{axis or 'all axes'}: reset")


@client_command
def ramp(
    client: Client,
    low: Annotated[float, typer.Option("--from", **volts(0.0, MOST_V), help="Smallest e_a.")],
    high: Annotated[float, typer.Option("--to", **volts(0.0, MOST_V), help="Largest e_a.")],
    axis: Axis = None,
    steps: Annotated[int, typer.Option(min=2, max=100, help="Amplitudes.")] = 8,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw it into a file: .png, .svg or .pdf.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Results as JSON.")] = False,
) -> None:
    """Raise e_a in steps: smallest clean amplitude, zeta and omega_n over e_a."""
    from seod.calibrate import ramp as procedure  # noqa: PLC0415 - numerics
    from seod.calibrate.procedure import CalibrationError  # noqa: PLC0415

    try:
        procedure.run(client, axis, low, high, steps, plot, as_json)
    except CalibrationError as error:
        raise CommandError(str(error)) from error
