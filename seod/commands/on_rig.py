"""Commands that take a rig file, and those about this machine."""

from __future__ import annotations

import json
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from seod.commands.common import CommandError, ConfigPath, Duration, app, load, on_linux, plain_errors, show
from seod.commands.quantity import seconds
from seod.config.errors import ConfigErrors


@app.command()
def run(
    path: ConfigPath,
    duration: Duration = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Record to this .mcap file, or rows to .csv.")
    ] = None,
    start: Annotated[bool, typer.Option("--start", help="Excite all axes at once.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Show live estimates.")] = False,
) -> None:
    """Run the daemon in the foreground."""
    with on_linux():
        from seod.launch import daemon  # noqa: PLC0415

        try:
            if not (start or watch):
                daemon.run(path, duration, record)  # replaces this process
            raise typer.Exit(_run_until_it_ends(path, duration, record, start, watch))
        except ConfigErrors as errors:
            print(errors, file=sys.stderr)  # noqa: T201 - each starts with file and line already
            raise typer.Exit(os.EX_CONFIG) from None  # a unit must not try that again
        except daemon.LaunchError as error:
            raise CommandError(str(error)) from error


def _run_until_it_ends(
    path: Path, duration: float | None, record: Path | None, start: bool, watch: bool
) -> int:
    from seod.launch.with_client import StartError, run_with_client  # noqa: PLC0415

    try:
        return abs(run_with_client(load(path), path, duration, record, start, watch))
    except StartError as error:
        raise CommandError(str(error)) from error


@app.command()
def neutral(path: ConfigPath) -> None:
    """Write neutral to a rig whose daemon has ended (what the unit does last)."""
    if os.environ.get("EXIT_STATUS") == str(os.EX_CONFIG):
        return  # as ExecStopPost=: the rig file is wrong, as has been told, and nothing was started
    with plain_errors():
        from seod.launch.last_neutral import write_neutral  # noqa: PLC0415

        why = write_neutral(load(path))
        if why:
            raise CommandError(f"neutral not written: {why}")
        show("neutral written")


@app.command()
def upgrade(path: ConfigPath) -> None:
    """Make a rig file of an earlier version one of this version; the earlier one is kept as NAME~."""
    with plain_errors():
        from seod.config.upgrade import UpgradeError, upgraded  # noqa: PLC0415
        from seod.files.user_files import keep_earlier  # noqa: PLC0415

        try:
            text = upgraded(path.read_text("utf-8-sig"), str(path), path.parent.resolve())
        except (UpgradeError, UnicodeDecodeError) as error:
            raise CommandError(str(error)) from error
        if text is None:
            show(f"{path} is of this version already: nothing to change")
            return
        keep_earlier(path)
        path.write_text(text, "utf-8")
        show(f"{path} is of this version now; as it was: {path}~")


@app.command()
def rig(
    path: ConfigPath,
    duration: Duration = None,
    control_port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Instead of the rig file's.")
    ] = None,
    port: Annotated[
        str | None,
        typer.Option(help="Serial: the rig's own end of a real line; else it makes a pseudo terminal."),
    ] = None,
) -> None:
    """Be the simulated rig on the other end of the bus or line."""
    with on_linux():
        config = load(path)
        if config.simulation is None:
            raise CommandError(f"{path} has no `simulation:` section: there is nothing to simulate")
        from drivers import driver_class  # noqa: PLC0415
        from drivers.base import DriverError  # noqa: PLC0415

        try:
            driver = driver_class(config.driver["kind"])
            if not driver.peer:
                text = f"driver.kind {config.driver['kind']} has no line with another end"
                raise CommandError(f"{text}; `seod rig` needs can or serial")
            options = driver.Options.model_validate(config.driver)
            import_module(driver.peer).run(options, config.simulation, control_port, duration, port)
        except DriverError as error:
            raise CommandError(str(error)) from error


@app.command()
def latency(
    duration: Annotated[
        float, typer.Option("--for", **seconds(0.1, 86_400.0), help="Measure for this long.")
    ] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON.")] = False,
) -> None:
    """Show how late this machine and the loop wake up, and what to change."""
    with on_linux():
        from seod.latency.measure import MeasureError, measure  # noqa: PLC0415 - the whole loop

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
        int, typer.Option(min=1, max=100, help="Measure at so many supply pressures; asks for each.")
    ] = 1,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the change, write nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Move and write without asking.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Results as JSON.")] = False,
) -> None:
    """Measure polarity, K_L, null, deadband and delay; write them into the rig file."""
    with on_linux():
        from seod.calibrate import shell  # noqa: PLC0415 - numerics
        from seod.calibrate.procedure import CalibrationError  # noqa: PLC0415

        config = load(path)
        if axis is not None and axis not in config.axes:
            raise CommandError(f"no axis {axis!r}; {path} has {', '.join(config.axes)}")
        try:
            axes = list(config.axes) if axis is None else [axis]
            shell.calibrate(config, path, axes, pressures, shell.Options(dry_run, yes, as_json))
        except CalibrationError as error:
            raise CommandError(str(error)) from error


@app.command()
def check(path: ConfigPath) -> None:
    """Validate a rig file and compute its bus load."""
    from seod.config.check import check as judge  # noqa: PLC0415

    with plain_errors():
        report = judge(load(path), path)
        show(str(report))
        raise typer.Exit(report.exit_status)
