"""The kernel's process, `python -m seod.model_monitor.worker FD`; it ends when its parent hangs up."""

from __future__ import annotations

import os
import sys
from multiprocessing.connection import Connection

from seod.processes.realtime import OTHERS_OOM, be_ended_sooner

NICE = 5
"""Below the gateway: whoever waits for it loses nothing."""


def serve(link: Connection) -> None:
    """Take a rig file as JSON and an axis, then residuals of segments until the parent hangs up.

    Answers are arrays; a text says why there is none.
    """
    from seod.config.model import RigConfig  # noqa: PLC0415
    from seod.model_monitor.models import kernel_model  # noqa: PLC0415 - after the process is nice

    text, axis = link.recv()
    model = kernel_model(RigConfig.model_validate_json(text), axis)
    while True:
        segment = link.recv()
        try:
            link.send(model.residual(segment) if model else "there is no model")
        except (ValueError, ArithmeticError) as error:
            link.send(f"{type(error).__name__}: {error}")


def main() -> int:
    """Entry point."""
    be_ended_sooner(OTHERS_OOM)
    os.nice(NICE)
    with Connection(int(sys.argv[1])) as link:
        try:
            serve(link)
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
