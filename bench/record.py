"""What a recording costs: time of a core and bytes for each row, and a day of it; rows as CDR against JSON.
Then a frame of the bus log in each format of python-can, against the shortest a frame takes on a bus.

    python bench/record.py [--rows 20000] [--pairs 10]

Rows are those of a limit cycle with noise, 500 a chunk, as the recorder writes them at 2 kHz.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from statistics import median

import can
import numpy as np

from seod.record.layout import AXIS_FIELDS, row_dtype
from seod.record.mcap_file import About, McapFile
from seod.record.series import Rotation, Series

RATE_HZ = 2000
CHUNK = RATE_HZ // 4
DAY_S = 86_400
FORMATS = ("log", "asc", "blf", "mf4")
FRAME_US = 111.0
"""A frame with 8 bytes, of 111 bits unstuffed, at 1 Mbit/s."""


def limit_cycle(count: int) -> np.ndarray:
    """Rows as a rig of 117 rad/s gives them, quantised and noisy; tick times as a real loop has them."""
    random = np.random.default_rng(1)
    rows = np.zeros(count, row_dtype(1))
    t = 5000.0 + np.arange(count) / RATE_HZ + np.abs(random.normal(0.0, 5e-6, count))
    rows["tick"], rows["tick_t"] = np.arange(count), t
    axis = rows["axes"][:, 0]
    y = np.round((0.2 * np.sin(115.0 * t) + random.normal(0.0, 1e-3, count)) / 1e-6) * 1e-6
    u = -np.copysign(0.5, y)
    values = {"t": t, "y": y, "u": u, "t_u": t + 2e-5 + np.abs(random.normal(0.0, 2e-6, count)), "signal": -y}
    for name, value in (values | {"e_a": 0.5, "K_L": 17.0, "ps": np.nan, "temperature": np.nan}).items():
        axis[name] = value
    axis["state"], axis["flags"] = 2, 3
    return rows


class JsonRows(McapFile):
    """The same rows as JSON, which more programs read and which the recorder does not write."""

    def rows(self, rows: np.ndarray) -> None:
        times = (rows["tick_t"] * 1e9).astype(np.int64).tolist()
        for log, tick, t, axes in zip(
            times, rows["tick"].tolist(), rows["tick_t"].tolist(), rows["axes"].tolist(), strict=True
        ):
            numbers = {name: x if x == x else None for name, x in zip(AXIS_FIELDS, axes[0], strict=False)}
            row = {"tick": tick, "t_tick": t, **numbers, "state": axes[0][-2], "flags": axes[0][-1]}
            self._writer.add_message(self._rows[0], log, json.dumps(row, separators=(",", ":")).encode(), log)


def write(rows: np.ndarray, kind: type[McapFile]) -> tuple[float, float]:
    """Time of the processor [us] and bytes for each row; the disk's own time is not in it."""
    about = About("bench", ["motor"], "", "{}", 0.0, 0)
    with tempfile.TemporaryDirectory() as folder:
        series = Series(Path(folder) / "a.mcap", about, Rotation(), dict, 0.0)
        series._file = kind(series._disk, about, 1)
        began = time.thread_time()
        for at in range(0, len(rows), CHUNK):
            series.put([rows[at : at + CHUNK]], 0.0)
        spent = time.thread_time() - began
        size = series.bytes
        series.finish(0.0)
    return spent / len(rows) * 1e6, size / len(rows)


def log_frames(suffix: str, count: int) -> float:
    """Time of the processor [us] for each frame of a bus log, with the file's end."""
    frames = [
        can.Message(timestamp=1.7e9 + n * 1e-3, arbitration_id=513, data=n.to_bytes(8), is_extended_id=False)
        for n in range(count)
    ]
    with tempfile.TemporaryDirectory() as folder:
        began = time.thread_time()
        logger = can.Logger(Path(folder) / f"bus.{suffix}")
        for frame in frames:
            logger(frame)
        logger.stop()
        return (time.thread_time() - began) / count * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--pairs", type=int, default=10)
    options = parser.parse_args()
    rows = limit_cycle(options.rows)
    results = [(write(rows, McapFile), write(rows, JsonRows)) for _ in range(options.pairs)]
    cost, size = (median(cdr[k] for cdr, _ in results) for k in (0, 1))
    cost_json, size_json = (median(other[k] for _, other in results) for k in (0, 1))
    ratio = median(cdr[0] / other[0] for cdr, other in results)
    print(f"a row: {cost:.2f} us, {size:.1f} bytes  (as JSON {cost_json:.2f} us, {size_json:.1f} bytes)")
    print(f"cost against JSON, median of {options.pairs} pairs: {ratio:.2f}")
    print(
        f"a core at {RATE_HZ} Hz: {cost * RATE_HZ / 1e4:.2f} %  (as JSON {cost_json * RATE_HZ / 1e4:.2f} %)"
    )
    day = RATE_HZ * DAY_S
    print(f"24 h at {RATE_HZ} Hz: {size * day / 1e9:.1f} GB  (as JSON {size_json * day / 1e9:.1f} GB)")
    for suffix in FORMATS:
        spent = log_frames(suffix, options.rows)
        print(f"a frame of the bus as .{suffix}: {spent:.1f} us  (of {FRAME_US:.0f} us on a full bus)")


if __name__ == "__main__":
    main()
