"""In the guest that will be cut off: records onto an ext4 image for ever, and tells the host how far it is.

    python record_rows.py IMAGE PROGRESS

Each line of PROGRESS holds the rows taken so far and those that the recorder says are on the disk.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from mounting import mount

from seod.record.layout import row_dtype
from seod.record.mcap_file import About
from seod.record.recorder import McapRecorder
from seod.record.series import Rotation

ROWS = 20
PERIOD_S = 0.02


def block(first: int) -> np.ndarray:
    """Rows with nothing but their numbers in them."""
    rows = np.zeros(ROWS, row_dtype(1))
    rows["tick"] = np.arange(first, first + ROWS)
    rows["tick_t"] = time.monotonic()
    return rows


def main(image: str, progress: str) -> None:
    """Record 1000 rows a second until killed."""
    disk = mount(image)
    about = About("cut-off", ["motor"], "", "{}", time.time(), 0)
    recorder = McapRecorder(disk / "a.mcap", about, Rotation(size=40_000))
    with Path(progress).open("w") as told:
        taken = 0
        while True:
            recorder.add(block(taken))
            taken += ROWS
            told.write(f"{taken} {recorder.report()['rows']}\n")
            told.flush()
            time.sleep(PERIOD_S)


main(*sys.argv[1:])
