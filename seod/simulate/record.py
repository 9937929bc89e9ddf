"""Simulates and writes the recording, with progress on a terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from seod.files.user_files import irregular
from seod.simulate.csv_file import ENDINGS, write_csv
from seod.simulate.procedure import Simulation
from seod.simulate.summary import summary
from seod.terminal.progress import bar, watched
from sim.cache import are_compiled

if TYPE_CHECKING:
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.simulate.options import Options


def record(config: RigConfig, axis: str | None, options: Options, out: Path) -> dict[str, Any]:
    """Write the recording of an axis, of the only one if none is named; returns its summary.

    Raises:
        ValueError: Something that is wished cannot be; the message says why.
        OSError: A file cannot be read or written.
    """
    if config.simulation is None:
        raise ValueError(f"rig {config.rig} has no `simulation:` section: there is nothing to simulate")
    if not out.name.endswith(ENDINGS):
        raise ValueError(f"--out {out}: the name must end in {' or '.join(ENDINGS)}")
    if not out.parent.is_dir():
        raise ValueError(f"--out {out}: there is no directory {out.parent}")
    if options.input is not None and (why := irregular(options.input)):
        raise ValueError(f"--input {options.input}: {why}")
    simulation = Simulation(config, _chosen(config, axis), options)
    if not are_compiled(*simulation.compiled_parts):
        print("compiling the kernel (once)", file=sys.stderr, flush=True)  # noqa: T201 - for whoever waits
    columns = watched("simulating", simulation.run, simulation.fraction)
    with bar() as show:
        write_csv(out, columns, lambda part: show("writing", part))
    return summary(out, simulation, columns)


def _chosen(config: RigConfig, axis: str | None) -> str:
    there = ", ".join(config.axes)
    if axis is None and len(config.axes) > 1:
        raise ValueError(f"rig {config.rig} has the axes {there}: choose one by --axis")
    if axis is not None and axis not in config.axes:
        raise ValueError(f"no axis {axis!r}; there are {there}")
    return axis or next(iter(config.axes))
