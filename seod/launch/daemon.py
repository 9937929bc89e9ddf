"""`seod run`: read the rig file, take the rig's lock, become the supervisor."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from drivers import driver_class
from seod.config.channels import output_channels
from seod.config.load import load_rig
from seod.config.settings import on_clock
from seod.config.token_field import WITH_TOKENS
from seod.config.tokens import RIGHTS, TokenError, variable, with_tokens
from seod.files.user_files import not_recordable
from seod.launch.locks import LockedError, lock_claims, lock_rig
from seod.processes.handover import write_memfd
from seod.supervisor.arguments import SupervisorArguments, become
from sim.cache import cache_folder, compile_plant, is_plant_compiled

if TYPE_CHECKING:
    from seod.config.model import RigConfig
    from seod.config.server import ServerConfig

ROWS_S = 2.0
"""Seconds of rows that the ring holds: how long the gateway may be busy without losing any."""


class LaunchError(Exception):
    """The daemon cannot be started; the message says why and what would help."""


def run(config_path: Path, duration: float | None, record: Path | None, parent: int | None = None) -> None:
    """Validate, lock, and replace this process by the supervisor. Returns only by raising.

    Raises:
        ConfigErrors: The rig file is wrong.
        LaunchError: The rig or its actuators are in use, its tokens or the recording cannot be had, or its
            simulation cannot be compiled.
    """
    if record is not None and (why := not_recordable(record)):
        raise LaunchError(f"--record {record}: {why}")
    try:
        config = with_tokens(load_rig(config_path))
    except TokenError as error:
        raise LaunchError(str(error)) from error
    lock(config)
    prepare(config)
    for right in RIGHTS:  # the gateway has them from here on
        os.environ.pop(variable(right), None)
    config_fd = write_memfd("seod-config", config.model_dump_json(context=WITH_TOKENS).encode())
    become(
        SupervisorArguments(
            config_fd=config_fd,
            config_path=str(config_path.resolve()),
            rig=config.rig,
            axes=len(config.axes),
            rows=ring_rows(config),
            priority=config.loop.priority,
            hang_timeout=config.loop.hang_timeout if on_clock(config) else 0.0,
            gateway_timeout=config.guard.gateway_timeout,
            duration=duration,
            record=None if record is None else str(record.resolve()),
            parent=parent,
            panel=has_panel(config.server),
            fleet=config.mqtt is not None,
        )
    )


def lock(config: RigConfig) -> None:
    """Take the rig, and what its driver commands, for the life of this process.

    Raises:
        LaunchError: Another daemon has it.
    """
    kind = driver_class(config.driver["kind"])
    outputs = output_channels(config)
    try:
        lock_rig(config.rig)
        lock_claims(kind.claims(kind.Options.model_validate(config.driver), outputs))
    except LockedError as error:
        raise LaunchError(str(error)) from error


def prepare(config: RigConfig) -> None:
    """Have the machine code of a simulated plant before a loop needs it: then it only has to be loaded."""
    kinds = config.simulation.kinds if config.simulation else ()
    if driver_class(config.driver["kind"]).acts_on != "simulation" or is_plant_compiled(kinds):
        return
    if cache_folder() is None:
        told = "compiling the plant at each start: no folder to keep it in, set NUMBA_CACHE_DIR to one"
        print(told, flush=True)  # noqa: T201 - for whoever waits
        return  # the loop does it, before it says that it is ready
    print("compiling the plant (once)", flush=True)  # noqa: T201 - likewise
    try:
        compile_plant(kinds)
    except subprocess.CalledProcessError as error:
        raise LaunchError("the simulated plant cannot be compiled, see above") from error


def has_panel(server: ServerConfig) -> bool:
    """Whether anything is served that the panel's process serves."""
    return server.panel or server.scpi or server.foxglove


def ring_rows(config: RigConfig) -> int:
    """Length of the row ring: `ROWS_S` of rows, at least 1024."""
    return max(1024, int(config.loop.rate_hz * ROWS_S))


def spawn(config_path: Path, duration: float | None, record: Path | None) -> subprocess.Popen[bytes]:
    """The daemon as a child that ends with this process (for `--watch` and `--start`)."""
    command = [sys.executable, "-m", "seod.launch.daemon", str(config_path), str(os.getpid())]
    command += [repr(duration) if duration is not None else "", str(record or "")]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)  # noqa: S603 - our own


def main() -> None:
    """Entry point of the process that `spawn` starts: arguments checked already by the command line."""
    path, parent, duration, record = sys.argv[1:5]
    try:
        run(Path(path), float(duration) if duration else None, Path(record) if record else None, int(parent))
    except Exception as error:  # noqa: BLE001 - the last place that can say it plainly
        sys.exit(f"seod: {error}")


if __name__ == "__main__":
    main()
