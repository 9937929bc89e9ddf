"""`seod run`: read the rig file, take the rig's lock, become the supervisor."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from seod.config.load import load_rig
from seod.process import write_memfd
from seod.supervisor import SupervisorArguments, become

if TYPE_CHECKING:
    from seod.config.model import RigConfig

ROWS_S = 2.0
"""Seconds of rows that the ring holds: how long the gateway may be busy without losing any."""


class LaunchError(Exception):
    """The daemon cannot be started; the message says why and what would help."""


def run(config_path: Path, duration: float | None, record: Path | None, parent: int | None = None) -> None:
    """Validate, lock, and replace this process by the supervisor. Returns only by raising.

    Raises:
        ConfigErrors: The rig file is wrong.
        LaunchError: The rig is run already.
    """
    config = load_rig(config_path)
    lock(config.rig)
    config_fd = write_memfd("seod-config", config.model_dump_json().encode())
    realtime = config.driver.get("realtime") is not False
    become(
        SupervisorArguments(
            config_fd=config_fd,
            config_path=str(config_path.resolve()),
            rig=config.rig,
            axes=len(config.axes),
            rows=ring_rows(config),
            priority=config.loop.priority,
            hang_timeout=config.loop.hang_timeout if realtime else 0.0,
            duration=duration,
            record=None if record is None else str(record.resolve()),
            parent=parent,
        )
    )


def ring_rows(config: RigConfig) -> int:
    """Length of the row ring: `ROWS_S` of rows, at least 1024."""
    return max(1024, int(config.loop.rate_hz * ROWS_S))


def spawn(config_path: Path, duration: float | None, record: Path | None) -> subprocess.Popen[bytes]:
    """The daemon as a child that ends with this process (for `--watch` and `--start`)."""
    command = [sys.executable, "-m", "seod.launch", str(config_path), str(os.getpid())]
    command += [repr(duration) if duration is not None else "", str(record or "")]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)  # noqa: S603 - our own


def lock_directory() -> Path:
    """Where locks lie: /run/seod for root and services, else the user's runtime directory."""
    for variable, below in (("RUNTIME_DIRECTORY", "."), ("XDG_RUNTIME_DIR", "seod")):
        if variable in os.environ:
            return Path(os.environ[variable]) / below
    if os.geteuid() == 0:
        return Path("/run/seod")
    return Path(tempfile.gettempdir()) / f"seod-{os.getuid()}"


def lock(rig: str) -> int:
    """Take the rig's lock for the life of this process (it survives exec).

    Raises:
        LaunchError: Another process has it; says which.
    """
    directory = lock_directory()
    directory.mkdir(mode=0o755, parents=True, exist_ok=True)
    path = directory / f"{rig}.lock"
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        owner = os.pread(fd, 32, 0).decode(errors="replace").strip() or "unknown"
        os.close(fd)
        raise LaunchError(
            f"rig {rig!r} is run already by process {owner} (lock {path}): stop that daemon first"
        ) from None
    os.ftruncate(fd, 0)
    os.pwrite(fd, f"{os.getpid()}\n".encode(), 0)
    os.set_inheritable(fd, True)
    return fd


def main() -> None:
    """Entry point of the process that `spawn` starts: arguments checked already by the command line."""
    path, parent, duration, record = sys.argv[1:5]
    try:
        run(Path(path), float(duration) if duration else None, Path(record) if record else None, int(parent))
    except Exception as error:  # noqa: BLE001 - the last place that can say it plainly
        sys.exit(f"seod: {error}")


if __name__ == "__main__":
    main()
