"""The command `seod init`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seod.commands.common import CommandError, app, plain_errors, show

if TYPE_CHECKING:
    from seod.init.text import Limits


@app.command()
def init(
    out: Annotated[Path, typer.Option(metavar="FILE", help="The new rig file.")] = Path("rig.yaml"),
    virtual: Annotated[bool, typer.Option("--virtual", help="A simulated rig, to begin with.")] = False,
    dbc: Annotated[
        Path | None, typer.Option(metavar="FILE", help="DBC of the bus that sensor and amplifier are on.")
    ] = None,
    serial_port: Annotated[
        str | None, typer.Option("--serial", metavar="PORT", help="A board on a serial line instead.")
    ] = None,
    interface: Annotated[
        str, typer.Option(metavar="NAME", help="CAN interface, such as can0, or vector:0.")
    ] = "can0",
    listen: Annotated[
        bool, typer.Option("--listen", help="Listen two seconds on it: which messages come, how often.")
    ] = False,
    sensor: Annotated[
        str | None, typer.Option(metavar="MESSAGE.SIGNAL", help="What measures; default: the only that can.")
    ] = None,
    output: Annotated[
        str | None, typer.Option(metavar="MESSAGE.SIGNAL", help="What commands; default: the only that can.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HERTZ", min=1.0, max=1e4, help="Rate of the sensor's message.")
    ] = None,
    travel: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="Limit: ends of the movement.")
    ] = None,
    speed: Annotated[str | None, typer.Option(metavar="SPEED", help="Limit: largest speed.")] = None,
    most: Annotated[
        str | None, typer.Option("--output-limit", metavar="VOLTS", help="Limit: largest command.")
    ] = None,
    amplitude: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Limit: half the peak-to-peak movement.")
    ] = None,
    e_a: Annotated[str | None, typer.Option("--e-a", metavar="VOLTS", help="The relay's amplitude.")] = None,
    watchdog: Annotated[
        str | None, typer.Option(metavar="SECONDS", help="The amplifier's own, which the rig must have.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
) -> None:
    """Propose a commented rig file; limits are never guessed, but options, or asked for on a terminal."""
    with plain_errors():
        from drivers.base import DriverError  # noqa: PLC0415 - pydantic
        from seod.init.signals import InitError  # noqa: PLC0415
        from seod.init.text import Limits  # noqa: PLC0415

        if out.exists() and not force:
            raise CommandError(f"{out} exists: --force replaces it")
        if [virtual, dbc is not None, serial_port is not None].count(True) != 1:
            raise CommandError("say what there is: --virtual, --dbc FILE or --serial PORT")
        limits = Limits(speed, most, amplitude, e_a, watchdog, travel)
        try:
            if dbc is not None:
                text = _on_bus(out, dbc, interface, listen, (sensor, output), rate, limits)
            else:
                text = _shipped(out, serial_port, limits)
        except (InitError, DriverError) as error:
            raise CommandError(str(error)) from error
        _write(out, text)


def _shipped(out: Path, port: str | None, limits: Limits) -> str:
    """A shipped rig file, with the name of the new one; that of a real board with limits of its own."""
    from seod.api.rig_file import RigFile  # noqa: PLC0415
    from seod.init.text import on_line  # noqa: PLC0415

    values = {} if port is None else on_line(_asked(limits, is_speed=False), port)
    return (
        RigFile.shipped("virtual" if port is None else "arduino")
        .with_values({"rig": _name(out), **values})
        .text
    )


def _on_bus(
    out: Path,
    dbc: Path,
    interface: str,
    listen: bool,
    named: tuple[str | None, str | None],
    rate: float | None,
    limits: Limits,
) -> str:
    from seod.config.units import RATES  # noqa: PLC0415
    from seod.init import listen as bus  # noqa: PLC0415
    from seod.init import signals  # noqa: PLC0415
    from seod.init.text import Bus, can_rig  # noqa: PLC0415

    kind, colon, channel = interface.partition(":")
    kind, channel = (kind, channel) if colon else ("socketcan", interface)
    seen = bus.heard(kind, channel) if listen else None
    found = signals.candidates(dbc)
    if seen is not None:
        names = {each.identifier: each.message for each in found}
        for identifier, often in sorted(seen.items()):
            _tell(f"heard {names.get(identifier, 'unknown')} (0x{identifier:x}), {often:.4g} a second")
    measured = signals.sensor(found, named[0], seen)
    command = signals.output(found, named[1], measured)
    _tell(f"sensor: {measured}\noutput: {command}")
    hertz = rate or (seen or {}).get(measured.identifier) or measured.rate_hz
    if hertz is None:
        raise signals.InitError(f"how often does {measured.message} come? --rate HERTZ, or --listen")
    where = Bus(_relative(dbc, out), kind, channel, float(f"{hertz:.3g}"))
    return can_rig(_name(out), where, measured, command, _asked(limits, measured.dimension not in RATES))


def _asked(limits: Limits, is_speed: bool) -> Limits:
    """With what a person answers, where one is there."""
    from dataclasses import replace  # noqa: PLC0415

    from seod.init.text import QUESTIONS, missing  # noqa: PLC0415

    if not sys.stdin.isatty():
        return limits
    from seod.terminal.console import ask, console  # noqa: PLC0415 - rich

    for name in missing(limits, is_speed):
        limits = replace(limits, **{name: ask(console(), f"{QUESTIONS[name]}: ")})
    return limits


def _write(out: Path, text: str) -> None:
    """Checked first: what is written can be run, once its limits are right."""
    from seod.config.load import load_text  # noqa: PLC0415 - pydantic
    from seod.files.user_files import write_text  # noqa: PLC0415

    load_text(text, str(out), out.parent.resolve())
    write_text(out, text)
    show(f"{out}: look at each line, then `seod check {out}`")


def _relative(dbc: Path, out: Path) -> str:
    """The DBC as seen from the rig file's folder."""
    import os  # noqa: PLC0415

    return os.path.relpath(dbc.resolve(), out.parent.resolve())


def _name(out: Path) -> str:
    return out.name.partition(".")[0] or "rig"


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - beside the answer
