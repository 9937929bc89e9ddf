"""The other end of a serial line, as a process: tells when commands move the rig, and when they stop.

    python bench/estop_rig.py CONFIG

A line on stdout each: `ready`, `moving` or `neutral`, and when that came [s, CLOCK_MONOTONIC].
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.serial_config import SerialOptions
from seod.config.load import load_rig
from seod.processes.realtime import freeze_collector, set_fifo
from sim.config import SimulationConfig
from sim.rig_end import compile_plant
from sim.serial_rig import SerialRig

if TYPE_CHECKING:
    from collections.abc import Sequence

PRIORITY = 60
STEP_S = 0.1


class TimedRig(SerialRig):
    """Stamps each change between neutral and any other command."""

    moving = False

    def _take(self, t: float, numbers: Sequence[float]) -> None:
        super()._take(t, numbers)
        moving = any(numbers)
        if moving is not self.moving:
            self.moving = moving
            print("moving" if moving else "neutral", repr(t), flush=True)


def main() -> None:
    config = load_rig(Path(sys.argv[1]))
    simulation = SimulationConfig.model_validate(config.simulation)
    compile_plant(simulation)
    rig = TimedRig(SerialOptions.model_validate(config.driver), simulation)
    rig.open()
    print("ready", time.monotonic(), flush=True)
    freeze_collector()
    set_fifo(PRIORITY)
    now = time.monotonic()
    while True:
        now = rig.step(now, STEP_S)


if __name__ == "__main__":
    main()
