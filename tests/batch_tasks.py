"""Short recordings for batches, and tasks for real workers, which find them by name."""

from __future__ import annotations

import json
import os
import signal
import time
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

TICK = 1e-3
ROWS = 600
DEADLY = 3


def write_recordings(folder: Path, count: int, rows: int = ROWS) -> None:
    """So many recordings of a second-order plant under steps, each with its own omega_n and noise."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        t, u, y = columns(number, rows)
        np.savetxt(
            folder / f"run-{number:05d}.csv",
            np.c_[t, u, y],
            delimiter=",",
            header="t,u,y [rad]",
            comments="",
            fmt="%.9g",
        )


def columns(number: int, rows: int = ROWS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], steps of +-1 V, and the position [rad] of K_L 12 rad/s/V, zeta 0.4, by small Euler steps."""
    omega_n, per_row = 55.0 + number % 17, 10
    t = np.arange(rows) * TICK
    u = np.where((np.arange(rows) // 60) % 2 == 0, 1.0, -1.0)
    y, position, speed, acceleration, step = np.zeros(rows), 0.0, 0.0, 0.0, TICK / per_row
    for k in range(rows):
        y[k] = position
        for _ in range(per_row):
            acceleration += step * (omega_n**2 * (12.0 * u[k] - speed) - 0.8 * omega_n * acceleration)
            speed += step * acceleration
            position += step * speed
    return t, u, y + np.random.default_rng(number).normal(scale=1e-3, size=rows)


def journal(out: Path, kind: str = "identify") -> list[str]:
    """Names of the results that a folder's journal has, in the order in which they came."""
    path = out / f"{kind}.journal"
    lines = path.read_text().splitlines() if path.exists() else []
    told = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]
    return [line["name"] for line in told if "name" in line]


def written(out: Path) -> dict[str, bytes]:
    """Everything that a batch wrote but its journal, by name."""
    files = [path for path in out.rglob("*") if path.is_file() and path.suffix != ".journal"]
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def squared(item: int) -> int:
    """A task that always ends well."""
    return item * item


def deadly(item: int) -> int:
    """A task of which one kills the worker that does it, every time."""
    if item == DEADLY:
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item


def greedy(item: int) -> int:
    """A task of which one takes more and more memory, 2.5 GB in 5 s, every time."""
    held = []
    for _ in range(250 if item == DEADLY else 0):
        held.append(np.ones(1_250_000))
        time.sleep(0.02)
    return item * item
