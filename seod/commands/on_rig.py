"""Commands that take a rig file, and those about this machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seod.commands.common import CommandError, ConfigPath, Duration, app, load, plain_errors, show

if TYPE_CHECKING:
    from sim.config import SimulationConfig


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
    port: Annotated[
        str | None,
        typer.Option(help="Serial: the rig's own end of a real line; else it makes a pseudo terminal."),
    ] = None,
) -> None:
    """Be the simulated rig on the other end of the bus or line."""
    with plain_errors():
        config = load(path)
        if config.simulation is None:
            raise CommandError(f"{path} has no `simulation:` section: there is nothing to simulate")
        from drivers.base import DriverError  # noqa: PLC0415

        try:
            _be_rig(config.driver, config.simulation, control_port, duration, port)
        except (DriverError, OSError) as error:
            raise CommandError(str(error)) from error


def _be_rig(
    driver: dict[str, Any],
    simulation: SimulationConfig,
    control_port: int | None,
    duration: float | None,
    port: str | None,
) -> None:
    match driver["kind"]:
        case "can":
            from drivers.can_config import CanOptions  # noqa: PLC0415
            from sim import can_rig  # noqa: PLC0415

            can_rig.run(CanOptions.model_validate(driver), simulation, control_port, duration)
        case "serial":
            from drivers.serial_config import SerialOptions  # noqa: PLC0415
            from sim import serial_rig  # noqa: PLC0415

            serial_rig.run(SerialOptions.model_validate(driver), simulation, control_port, duration, port)
        case kind:
            text = f"driver.kind {kind} has no line with another end; `seod rig` needs can or serial"
            raise CommandError(text)


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
