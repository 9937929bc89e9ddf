"""The archive at work: 10,000 recordings of 1,000 rigs, of which 50 have left their model.

    python bench/archive.py [--rigs 1000] [--keep FOLDER]

Makes recordings by the recorder's own file layout: few rows, omega_n drifts by known amounts, 50 rigs leave
their model for good, with a cause, 20 others for one recording. Builds the catalogue with one and with two
processes, kills a builder again and again, and asks which rigs left their model, since when, why. Each figure
stands beside its goal. Costs are told in processor time as well, which others on the machine change less.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from seod.archive import questions
from seod.archive.build import build
from seod.archive.catalogue import rows
from seod.archive.layout import FOLDER
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH, AxisState
from seod.record.layout import ESTIMATES, EVENTS, MODEL_ERRORS, row_dtype
from seod.record.mcap_file import About, McapFile

if TYPE_CHECKING:
    from seod.record.disk import DiskFile

DAYS = 10
"""Recordings of a rig, one a week."""
BEGAN = datetime(2026, 1, 5, 8, 0, tzinfo=UTC)
ROWS, RATE_HZ = 60, 20.0
ESTIMATED = 12
LEFT, SHORTLY = 50, 20
STUDENT = 2.306
"""Of `DAYS` - 2 degrees of freedom, 95 %."""
CAUSES = (("coulomb_friction", "level", 500.0, "N m"), ("valve_deadband", "half_width", 0.05, "V"))


class Rig(NamedTuple):
    """What is planted.

    Attributes:
        name: Of the rig.
        omega_n: In the beginning [rad/s].
        drift: Of it [rad/s in 100 days].
        leaves: Number of the recording in which it leaves its model; None: it never does.
        returns: Whether it keeps to it again in the next one.
        cause: What the diagnosis names.
    """

    name: str
    omega_n: float
    drift: float
    leaves: int | None
    returns: bool
    cause: tuple[str, str, float, str]


def rigs(count: int, seed: int = 1) -> list[Rig]:
    """Rigs, of which `LEFT` in 1,000 leave their model for good and `SHORTLY` for one recording."""
    draw = random.Random(seed)
    leaving = draw.sample(range(count), max(1, count * (LEFT + SHORTLY) // 1000))
    for_good = set(leaving[: max(1, count * LEFT // 1000)])
    return [
        Rig(
            f"pump{k:04}",
            draw.uniform(80.0, 140.0),
            draw.choice((0.0, 0.0, -3.0, -6.0)),
            draw.randrange(2, DAYS - 1) if k in leaving else None,
            k not in for_good,
            draw.choice(CAUSES),
        )
        for k in range(count)
    ]


def write_all(folder: Path, fleet: list[Rig]) -> int:
    """All recordings, and the reports of those that left; returns the bytes."""
    total = 0
    for number, rig in enumerate(fleet):
        own = folder / rig.name
        own.mkdir(parents=True)
        for week in range(DAYS):
            began = BEGAN + timedelta(days=7 * week, seconds=17 * number)
            content = recording(rig, week, began, number)
            (own / f"{began:%Y-%m-%d}.mcap").write_bytes(content)
            total += len(content)
        if rig.leaves is not None:
            at = BEGAN + timedelta(days=7 * rig.leaves, seconds=17 * number)
            (own / f"{at:%Y-%m-%d}.diagnosis.json").write_text(json.dumps(report(rig)))
    return total


def report(rig: Rig) -> dict[str, Any]:
    """As much of a diagnosis as the archive reads."""
    name, parameter, value, unit = rig.cause
    told = {parameter: {"value": value, "unit": unit, "ci95": [0.9 * value, 1.1 * value]}}
    return {"verdict": "effects", "effects": [{"name": name, "parameters": told}]}


def is_left(rig: Rig, week: int) -> bool:
    """Whether a rig is away from its model in a recording."""
    return rig.leaves is not None and (week == rig.leaves or (week > rig.leaves and not rig.returns))


def omega_n(rig: Rig, week: int) -> float:
    """The true one [rad/s]."""
    return rig.omega_n + rig.drift * 7.0 * week / 100.0


class _Memory(io.BytesIO):
    """What the recorder's layout is written into."""


def recording(rig: Rig, week: int, began: datetime, seed: int) -> bytes:
    """One MCAP file as the recorder writes it."""
    out = _Memory()
    clock = 1000.0
    offset_ns = round((began.timestamp() - clock) * 1e9)
    told = {"rig": rig.name, "simulation": {}, "axes": {"motor": {}}}
    about = About(
        rig.name, ["motor"], f"rig: {rig.name}\n", json.dumps(told), began.timestamp(), offset_ns,
        {"motor": "rad"},
    )  # fmt: skip
    file = McapFile(cast("DiskFile", out), about, 1)
    table = ticks(clock, 100 * seed + week)
    file.rows(table)
    draw = np.random.default_rng(100 * seed + week)
    times = np.linspace(clock + 0.5, float(table["tick_t"][-1]), ESTIMATED)
    for t in times.tolist():
        file.note(ESTIMATES + "motor", t, estimate(t, omega_n(rig, week), draw))
    for t in times[::2].tolist():
        file.note(MODEL_ERRORS + "motor", t, model_error(t, is_left(rig, week)))
    if is_left(rig, week):
        why = "motor: position beyond its limit"
        file.note(
            EVENTS,
            clock + 2.0,
            {"event": "fault", "t": clock + 2.0, "axis": "motor", "code": "limit", "why": why},
        )
    file.end_chunk()
    file.finish()
    return out.getvalue()


def ticks(clock: float, seed: int) -> Any:
    """Rows of one axis: a quarter idle, the rest excited."""
    table = np.zeros(ROWS, row_dtype(1))
    t = clock + np.arange(ROWS) / RATE_HZ
    draw = np.random.default_rng(seed)
    own = table["axes"][:, 0]
    table["tick"], table["tick_t"] = np.arange(ROWS), t
    excited = np.arange(ROWS) >= ROWS // 4
    own["t"], own["t_u"] = t, t + 1e-3
    own["y"] = draw.normal(size=ROWS)
    own["e_a"] = np.where(excited, 0.4, np.nan)
    own["ps"], own["temperature"] = 7e6 + 1e4 * draw.normal(size=ROWS), 313.0
    own["state"] = np.where(excited, AxisState.EXCITING, AxisState.ARMED)
    own["flags"] = FLAG_FRESH | np.where(excited, FLAG_EXCITING, 0)
    table["axes"][:, 0] = own
    return table


def estimate(t: float, value: float, draw: Any) -> dict[str, Any]:
    """A notification of the daemon, as far as the archive reads it, and some of what it does not read."""
    measured = {
        "zeta": 0.2 + 0.004 * draw.normal(), "zeta_sd": 0.004, "omega_n": value + 0.3 * draw.normal(),
        "omega_n_sd": 0.3, "K_L": 20.0 + 0.1 * draw.normal(), "K_L_sd": 0.1,
    }  # fmt: skip
    return {
        "axis": "motor",
        "t": t,
        "age_s": 0.01,
        "delay_s": 0.004,
        "method": "wave",
        "quality": "ok",
        **measured,
    }


def model_error(t: float, left: bool) -> dict[str, Any]:
    """Likewise of the model beside."""
    nrmse = 0.21 if left else 0.015
    return {"axis": "motor", "t": t, "rms": 0.1 * nrmse, "nrmse": nrmse, "left": left, "model": "linear"}


def content_of(folder: Path) -> dict[str, bytes]:
    """The catalogue's files."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in (folder / FOLDER).rglob("*.parquet")}


class Cost(NamedTuple):
    """Of a build: seconds by the clock and of processors, those of workers included."""

    wall: float
    cpu: float


def timed_build(folder: Path, workers: int) -> Cost:
    """A build from nothing."""
    shutil.rmtree(folder / FOLDER, ignore_errors=True)
    began, used = time.perf_counter(), cpu_s()
    build(folder, workers)
    return Cost(time.perf_counter() - began, cpu_s() - used)


def cpu_s() -> float:
    """Processor time of this process and of its children that have ended [s]."""
    told = os.times()
    return told.user + told.system + told.children_user + told.children_system


def killed_builds(folder: Path, workers: int, whole_s: float) -> int:
    """Builds from nothing with a SIGKILL each, until one ends; returns how many were killed."""
    shutil.rmtree(folder / FOLDER, ignore_errors=True)
    draw = random.Random(2)
    killed = 0
    while True:
        command = [
            sys.executable,
            "-m",
            "seod.cli",
            "archive",
            "build",
            str(folder),
            "--workers",
            str(workers),
        ]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as builder:
            try:
                builder.wait(1.0 + draw.uniform(0.2, 0.5) * whole_s)
            except subprocess.TimeoutExpired:
                builder.send_signal(signal.SIGKILL)
            if builder.wait() == 0:
                return killed
        killed += 1


def exponent(sizes: list[int], seconds: list[float]) -> float:
    """p of t = a + b n^p, by least squares of the logarithms."""
    from scipy.optimize import least_squares

    n, t = np.array(sizes, float), np.array(seconds)
    begin = [math.log(max(t[0] * 0.5, 1e-4)), math.log(t[-1] / n[-1]), 1.0]
    fit = least_squares(lambda x: np.log(np.exp(x[0]) + np.exp(x[1]) * n ** x[2]) - np.log(t), begin)
    return float(fit.x[2])


def scaling(folder: Path, fleet: list[Rig]) -> tuple[list[int], list[float]]:
    """Processor seconds of builds of parts of the recordings, the least of three each."""
    sizes, seconds = [], []
    for count in sorted({1, 10, 100, len(fleet)}):
        part = folder.parent / f"part{count}"
        for rig in fleet[:count]:
            shutil.copytree(folder / rig.name, part / rig.name, copy_function=os.link)
        sizes.append(count * DAYS)
        seconds.append(min(timed_build(part, 1).cpu for _ in range(3)))
    return sizes, seconds


def check_answer(table: Any, fleet: list[Rig]) -> str:
    """The rigs that were planted and no other, each with time and cause; or what is wrong."""
    planted = {rig.name: rig for rig in fleet if rig.leaves is not None and not rig.returns}
    told = {row["rig"]: row for row in table.to_pylist()}
    if told.keys() != planted.keys():
        return f"{len(planted.keys() - told.keys())} missing, {len(told.keys() - planted.keys())} too many"
    for number, rig in enumerate(fleet):
        if rig.name in planted:
            at = BEGAN + timedelta(days=7 * cast("int", rig.leaves), seconds=17 * number)
            row = told[rig.name]
            if abs((row["since"] - at).total_seconds()) > 5.0 or rig.cause[0] not in (row["why"] or ""):
                return f"{rig.name}: {row}, planted {at}, {rig.cause}"
    return f"the {len(planted)} that were planted and no other, each with its time and its cause"


def main() -> None:
    """Print the figures."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--rigs", type=int, default=1000)
    options.add_argument("--keep", type=Path, help="a folder that stays")
    asked = options.parse_args()
    root = asked.keep or Path(tempfile.mkdtemp(prefix="seod-archive-"))
    try:
        run(root, rigs(asked.rigs))
    finally:
        if asked.keep is None:
            shutil.rmtree(root)


def run(root: Path, fleet: list[Rig]) -> None:
    """All of it in a folder."""
    folder, count = root / "recordings", len(fleet) * DAYS
    began = time.perf_counter()
    size = write_all(folder, fleet) / 1e6
    made_s = time.perf_counter() - began
    print(f"{count} recordings of {len(fleet)} rigs, {size:.0f} MB, made in {made_s:.0f} s")
    print(f"load of the machine, with {os.cpu_count()} processors: {os.getloadavg()[0]:.1f}")
    whole_s = building(folder, count)
    undisturbed = content_of(folder)
    killed = killed_builds(folder, 2, whole_s)
    same = content_of(folder) == undisturbed
    print(f"killed by SIGKILL {killed} times on the way, then left alone; same bytes: {same}")
    asking(folder, fleet)
    drifts(folder, fleet)
    print(f"rows of the catalogue: {len(rows(folder))}, {sum(map(len, undisturbed.values())) / 1e6:.2f} MB")
    sizes, seconds = scaling(folder, fleet)
    told = ", ".join(f"{n}: {t:.2f} s" for n, t in zip(sizes, seconds, strict=True))
    print(f"processor time of a build by 1 process: {told}")
    print(f"  exponent {exponent(sizes, seconds):.2f} (t = a + b n^p; goal: 1.00 +- 0.05)")


def building(folder: Path, count: int) -> float:
    """Build with one process, with two, and with nothing new; returns the seconds of two."""
    one = timed_build(folder, 1)
    undisturbed = content_of(folder)
    two = timed_build(folder, 2)
    for workers, cost in ((1, one), (2, two)):
        rate = f"{count / cost.wall:.0f} recordings/s ({count / cost.cpu:.0f} per second of a processor)"
        print(f"built with --workers {workers}: {cost.wall:.1f} s, {rate}")
    print(f"  the same bytes by both: {content_of(folder) == undisturbed}")
    began = time.perf_counter()
    build(folder)
    again_s = time.perf_counter() - began
    print(f"built again, nothing new: {again_s:.2f} s; same bytes: {content_of(folder) == undisturbed}")
    return two.wall


def asking(folder: Path, fleet: list[Rig]) -> None:
    """Which rigs left their model, since when, why."""
    asked_s = []
    for _ in range(5):
        began = time.perf_counter()
        table = questions.left_model(folder, None, None)
        asked_s.append(time.perf_counter() - began)
    print(f"which rigs left their model, since when, why: {check_answer(table, fleet)}")
    print(f"  answered in {sorted(asked_s)[2]:.3f} s (median of 5; goal: 1 s)")
    began = time.perf_counter()
    command = [sys.executable, "-m", "seod.cli", "archive", "left-model", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    print(f"  the whole command, with its start: {time.perf_counter() - began:.2f} s")


def drifts(folder: Path, fleet: list[Rig]) -> None:
    """How many planted drifts lie in the trends' intervals."""
    trend = {row["rig"]: row for row in questions.trend(folder, "omega_n", None, None).to_pylist()}
    change, sd = "change in 100 days [rad/s]", "its sd [rad/s]"
    off = [(trend[rig.name][change] - rig.drift) / trend[rig.name][sd] for rig in fleet]
    inside = 100.0 * np.mean(np.abs(off) < STUDENT)
    print(f"drifts of omega_n: the planted one in the 95 % interval for {inside:.1f} % of {len(fleet)} rigs")


if __name__ == "__main__":
    main()
