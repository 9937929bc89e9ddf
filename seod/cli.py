"""The command line: `seod`."""

from __future__ import annotations

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


def main() -> None:
    """Entry point of the command `seod`."""
    try:
        own_packages()
    except ImportError as error:
        sys.exit(f"seod: {error}")
    app()


if __name__ == "__main__":
    main()
