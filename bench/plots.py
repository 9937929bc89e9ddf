"""The plots of `bench/loop.py`."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING, Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from seod.latency.report import Latencies

OURS, THEIRS, THIRD = "#1f6fb4", "#d9822b", "#7a7a7a"


def draw(found: dict[str, Any], folder: Path, machine: str) -> Iterator[Path]:
    """One PNG for each part that was run; yields their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    drawers = {"lateness": lateness, "phases": phases, "axes": axes, "rate": rate}
    for part, values in found.items():
        figure, place = plt.subplots(figsize=(8, 4.2), layout="constrained")
        drawers[part](place, values)
        place.text(1.0, -0.17, machine, transform=place.transAxes, ha="right", fontsize=7, color="gray")
        path = folder / f"loop-{part}.png"
        figure.savefig(path, dpi=110)
        plt.close(figure)
        yield path


def lateness(place: plt.Axes, sums: dict[str, Latencies]) -> None:
    edges = np.geomspace(1, 2e4, 64)
    styles = {"seod loop": (OURS, 2.0), "cyclictest": (THEIRS, 2.0), "bare loop": (THIRD, 1.0)}
    for name, (color, width) in styles.items():
        counts = sums[name].counts
        us = np.maximum(np.fromiter(counts, float), 1.0)
        share = np.histogram(us, edges, weights=list(counts.values()))[0] / sums[name].total
        place.stairs(share, edges, color=color, linewidth=width, label=f"{name}, {sums[name].total} wake-ups")
    place.set(xscale="log", yscale="log", xlabel="lateness [us]", ylabel="share of the wake-ups")
    place.set_title("How late a tick begins at 2 kHz, SCHED_FIFO 50")
    place.axvline(500, color="gray", linestyle=":", linewidth=1)
    place.annotate("one period", (520, 0.93), xycoords=("data", "axes fraction"), fontsize=8, color="gray")
    place.legend(loc="upper right", bbox_to_anchor=(1, 0.9), frameon=False)


def phases(place: plt.Axes, medians: dict[str, float]) -> None:
    bars = place.bar(list(medians), list(medians.values()), color=OURS)
    place.bar_label(bars, fmt="%.1f")
    place.margins(y=0.12)
    place.set(ylabel="median [us]", title=f"Where a tick of one axis goes: {sum(medians.values()):.1f} us")


def axes(place: plt.Axes, found: dict[int, list[float]]) -> None:
    counts = list(found)
    medians = [statistics.median(values) for values in found.values()]
    slope, offset = np.polyfit(counts, medians, 1)
    for count, values in found.items():
        place.plot([count] * len(values), values, ".", color=THIRD, label="a round" if count == 1 else None)
    place.plot(counts, medians, "o", color=OURS, label="median")
    place.plot(
        counts, np.polyval([slope, offset], counts), color=OURS, label=f"{offset:.1f} + {slope:.1f} x axes"
    )
    place.plot(1, 20, "_", color=THEIRS, markersize=18, markeredgewidth=2, label="goal, one axis")
    place.set(xlabel="axes", ylabel="tick, all but waiting [us]", title="What a tick costs", ylim=(0, None))
    place.legend(frameon=False)


def rate(place: plt.Axes, late: dict[float, tuple[int, int, int]]) -> None:
    ours, theirs, ticks = np.array(list(late.values()), float).T
    at = np.arange(len(late))
    for shift, values, color, name in (
        (-0.2, ours, OURS, "seod loop"),
        (0.2, theirs, THEIRS, "empty loop in C"),
    ):
        bars = place.bar(at + shift, 100 * values / ticks, 0.38, color=color, label=name)
        place.bar_label(bars, [f"{value:.0f}" for value in values], fontsize=8)
    place.set_xticks(at, [f"{hz / 1e3:g}" for hz in late])
    place.set(xlabel="rate [kHz]", ylabel="ticks more than a period late [%]")
    place.set_title("Late ticks against rate (numbers: late ticks)")
    place.legend(frameon=False)
