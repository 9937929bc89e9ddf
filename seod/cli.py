"""The command line: `seod`."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from seod import PROTOCOL, __version__, own_packages
from seod.commands import (  # noqa: F401 - they register themselves
    archive,
    batch,
    begin,
    diagnose,
    fleet,
    identify,
    on_rig,
    over_tcp,
    paper,
    recordings,
    report,
    response,
    simulate,
)
from seod.commands.common import app, show


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


def _open_streams() -> None:
    """Standard streams that were closed (`>&-`) go nowhere; a file opened later would take their place."""
    for fd, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            os.open(os.devnull, os.O_RDWR)  # the lowest that is free: this one
            setattr(sys, name, open(fd, mode, closefd=False, encoding="utf-8"))  # noqa: SIM115 - until the end


def main() -> None:
    """Entry point of the command `seod`."""
    _open_streams()
    try:
        own_packages()
    except ImportError as error:
        sys.exit(f"seod: {error}")
    app()


if __name__ == "__main__":
    main()
