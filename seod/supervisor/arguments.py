"""What the supervisor is given, and how `seod run` becomes it. Standard library only."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class SupervisorArguments:
    """What `seod run` worked out from the rig file before it became the supervisor.

    Attributes:
        config_fd: memfd with the validated rig file as JSON.
        config_path: Where it lies.
        rig: Name of the rig.
        axes: Number of axes.
        rows: Length of the row ring.
        priority: SCHED_FIFO priority of the loop.
        hang_timeout: Silence of the loop that counts as a hang [s]; 0 on simulated time, where none does.
        gateway_timeout: Silence of the gateway that counts as a hang [s].
        duration: How long to run [s], or None.
        record: File to record to, or None.
        parent: Process whose end ends the daemon (`seod run --watch`), or None.
        panel: Whether there is a panel.
        fleet: Whether the rig is one of a fleet.
    """

    config_fd: int
    config_path: str
    rig: str
    axes: int
    rows: int
    priority: int
    hang_timeout: float
    gateway_timeout: float
    duration: float | None
    record: str | None
    parent: int | None
    panel: bool = False
    fleet: bool = False


def become(arguments: SupervisorArguments) -> None:
    """Replace this process by the supervisor; the process number stays the one that systemd knows.

    All that validated the rig file (pydantic and more) is left behind.
    """
    os.set_inheritable(arguments.config_fd, True)
    command = [sys.executable, "-m", "seod.supervisor", json.dumps(asdict(arguments))]
    os.execv(sys.executable, command)  # noqa: S606 - our own module
