"""`seod run`: read the rig file, take the rig's lock, become the supervisor."""

from __future__ import annotations

import errno
import os
import socket
import struct
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from seod.config.load import load_rig
from seod.process import write_memfd
from seod.settings import on_clock
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
    become(
        SupervisorArguments(
            config_fd=config_fd,
            config_path=str(config_path.resolve()),
            rig=config.rig,
            axes=len(config.axes),
            rows=ring_rows(config),
            priority=config.loop.priority,
            hang_timeout=config.loop.hang_timeout if on_clock(config) else 0.0,
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


def lock(rig: str) -> None:
    """Take the rig's lock for the life of this process, exec included.

    It is a name in the kernel: seen by all users, and gone with its owner however that ends.

    Raises:
        LaunchError: Another process has it; says which.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as mine:
        name = f"\0seod/{rig}"
        try:
            mine.bind(name)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            owner = lock_owner(mine, name)
            raise LaunchError(f"rig {rig!r} is run already by {owner}: stop that daemon first") from None
        mine.listen(128)
        os.set_inheritable(mine.fileno(), True)
        mine.detach()


def lock_owner(mine: socket.socket, name: str) -> str:
    """Who holds a lock, for people."""
    try:
        mine.connect(name)
        pid, _, _ = struct.unpack("3i", mine.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    except OSError:  # it ends just now
        return "another process"
    return f"process {pid}"


def main() -> None:
    """Entry point of the process that `spawn` starts: arguments checked already by the command line."""
    path, parent, duration, record = sys.argv[1:5]
    try:
        run(Path(path), float(duration) if duration else None, Path(record) if record else None, int(parent))
    except Exception as error:  # noqa: BLE001 - the last place that can say it plainly
        sys.exit(f"seod: {error}")


if __name__ == "__main__":
    main()
