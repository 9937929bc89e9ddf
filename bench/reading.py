"""How fast large files are read: CSV and MCAP of a seod recording, and the time of a core for a megabyte.

    python bench/reading.py [--megabytes 100] [--repeats 3] [--against FOLDER]

`--against` reads the same files with the sources in another folder, in turns; the ratio is of the medians.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np

from seod.record.csv_recorder import CsvLines, header
from seod.record.layout import AXIS_FIELDS, row_dtype
from seod.record.mcap_file import About, McapFile

RATE_HZ = 2000
READ = """
import sys, time
from seod.data import read
began = time.process_time()
rows = len(read(sys.argv[1]).t)
print(time.process_time() - began, rows)
"""


def table(count: int, first: int) -> np.ndarray:
    """Rows of one axis in a limit cycle."""
    rows = np.zeros(count, row_dtype(1))
    rows["tick"] = np.arange(first, first + count)
    rows["tick_t"] = t = 5000.0 + rows["tick"] / RATE_HZ
    axis = rows["axes"][:, 0]
    noise = np.random.default_rng(first).normal(0.0, 1e-3, count)
    for name in AXIS_FIELDS:
        axis[name] = np.nan
    axis["t"], axis["t_u"], axis["y"] = t - 3e-5, t + 2e-5, 0.2 * np.sin(115.0 * t) + noise
    axis["u"], axis["e_a"], axis["flags"] = np.sign(axis["y"]), 1.0, 3
    return rows


def write_csv(path: Path, size: int) -> None:
    """As the recorder does."""
    lines, first = CsvLines(1), 0
    with path.open("w") as file:
        file.write(header(("motor",)))
        while file.tell() < size:
            file.write(lines.lines(table(RATE_HZ, first)))
            first += RATE_HZ


def write_mcap(path: Path, size: int) -> None:
    """As the recorder does: a chunk each quarter of a second."""
    with path.open("wb") as stream:
        file = McapFile(stream, About("bench", ("motor",), "", "{}", 0.0, 0), 1)
        first = 0
        while stream.tell() < size:
            file.rows(table(RATE_HZ // 4, first))
            file.end_chunk()
            first += RATE_HZ // 4
        file.finish()


def timed(path: Path, sources: str) -> tuple[float, int]:
    """Time of a core [s] and rows, in a process of its own."""
    environment = {**os.environ, **({"PYTHONPATH": sources} if sources else {})}
    command = [sys.executable, "-c", READ, str(path)]
    out = subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, text=True, check=True, cwd=sources or None
    )
    time, rows = out.stdout.split()
    return float(time), int(rows)


def main() -> None:
    """Print a line for each format."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=100.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--against", default="", help="folder with other sources")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for suffix, make in (("csv", write_csv), ("mcap", write_mcap)):
            path = Path(folder, f"run.{suffix}")
            make(path, int(options.megabytes * 1e6))
            own, other = [], []
            for _ in range(options.repeats):
                own.append(timed(path, ""))
                if options.against:
                    other.append(timed(path, options.against))
            each = median(time for time, _ in own)
            size = path.stat().st_size / 1e6
            theirs = median(time for time, _ in other) if other else 0.0
            ratio = f"; against {theirs:.2f} s, ratio {each / theirs:.3f}" if other else ""
            speed = f"{each:.2f} s, {1e3 * each / size:.1f} ms a MB{ratio}"
            print(f"{suffix}: {size:.0f} MB, {own[0][1]} rows: {speed}", flush=True)


if __name__ == "__main__":
    main()
