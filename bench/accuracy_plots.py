"""The plots of `bench/accuracy.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from accuracy_cases import GRID, TURNS, Case, about_the_plants
from accuracy_runs import METHODS
from accuracy_summary import NAMES, PLAIN, Summary, summary, wilson

if TYPE_CHECKING:
    from pathlib import Path

    from accuracy_summary import Found

COLORS = dict(zip(METHODS, ("#1f6fb4", "#2a9d57", "#d9822b", "#8b5fbf", "#9a9a9a"), strict=True))
MARKS = dict(zip((f"{turn:g}" for turn in TURNS), "osD^", strict=True))
TURN = 0.05
"""omega_n Ts of the plot that compares the methods."""


def draw(found: Found, folder: Path) -> None:
    """Three PNGs."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, drawer in (("bound", bound), ("methods", methods), ("varied", varied)):
        figure = drawer(found)
        figure.savefig(folder / f"accuracy-{name}.png", dpi=100)
        plt.close(figure)


def _wave_of(found: Found, cases: list[Case]) -> list[tuple[float, Summary]]:
    return [(case.zeta, s) for case in cases if (s := summary(found.get(case.name, []), "wave"))]


def bound(found: Found) -> plt.Figure:
    """Scatter over the bound, and coverage, of `wave` at 1 % noise."""
    figure, places = plt.subplots(2, 2, figsize=(9, 6), sharex=True, layout="constrained")
    for k, name in enumerate(NAMES):
        for turn in TURNS:
            _bound_line(places[:, k], _wave_of(found, [c for c in GRID if c.turn == turn]), f"{turn:g}", k)
        _bound_line(places[:, k], _wave_of(found, PLAIN), "the design's plants", k)
        places[0, k].axhline(1.1, color="gray", linestyle=":")
        places[0, k].set(title=name, ylabel="standard deviation / Cramer-Rao bound", ylim=(0.7, 1.4))
        places[1, k].axhspan(93, 97, color="#dddddd", zorder=0)
        places[1, k].set(ylabel="95 % interval covers [%]", ylim=(85, 100.5), xlabel="zeta", xscale="log")
        places[1, k].set_xticks([0.1, 0.2, 0.5, 1.0, 1.5], ["0.1", "0.2", "0.5", "1", "1.5"])
        places[1, k].minorticks_off()
    places[0, 0].legend(title="omega_n Ts", frameon=False, ncols=2, fontsize=8)
    figure.suptitle("wave at 1 % noise, one tick of delay (bars: 95 % of chance; grey: the goal)")
    return figure


def _bound_line(places: np.ndarray, line: list[tuple[float, Summary]], label: str, k: int) -> None:
    """The plants that have many runs are black dots; the grid's lines stand a little apart."""
    style = {"markersize": 4, "capsize": 2}
    style |= (
        {"linewidth": 0.8, "marker": MARKS[label]}
        if label in MARKS
        else {"color": "black", "fmt": "o", "zorder": 5}
    )
    shift = 1.02 ** (list(MARKS).index(label) - 1.5) if label in MARKS else 1.05
    zetas = np.array([zeta for zeta, _ in line]) * shift
    ratio = np.array([s.ratio[k] for _, s in line])
    chance = 1.96 * ratio / np.sqrt([2.0 * s.good for _, s in line])
    places[0].errorbar(zetas, ratio, chance, label=label, **style)
    covered = np.array([s.covered[k] / max(s.good, 1) for _, s in line])
    ends = np.abs(np.array([wilson(s.covered[k], s.good) for _, s in line]).T - covered)
    places[1].errorbar(zetas, 100 * covered, 100 * ends, **style)


def methods(found: Found) -> plt.Figure:
    """Bias and scatter together, of all methods over zeta."""
    figure, places = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    cases = [case for case in GRID if case.turn == TURN and case.name in found]
    for k, name in enumerate(NAMES):
        for method in METHODS:
            said = [summary(found[case.name], method) for case in cases]
            places[k].plot(
                [c.zeta for c in cases],
                [_error(s, k) for s in said],
                "o-",
                color=COLORS[method],
                label=method,
            )
        limit = [100 * np.sqrt(np.mean([h.bound[k] ** 2 for h in found[c.name]])) for c in cases]
        places[k].plot([c.zeta for c in cases], limit, "k:", label="Cramer-Rao bound")
        places[k].set(xscale="log", yscale="log", xlabel="zeta", ylabel=f"RMS error of {name} [%]")
        places[k].set_xticks([0.1, 0.2, 0.5, 1.0, 1.5], ["0.1", "0.2", "0.5", "1", "1.5"])
        places[k].minorticks_off()
    places[1].legend(frameon=False, fontsize=8)
    figure.suptitle(f"1 % noise, one tick of delay, omega_n Ts = {TURN}")
    return figure


def _error(s: Summary | None, k: int) -> float:
    """In %, of what is `ok`; nan where a fifth of the answers is not even there."""
    if s is None or s.good < 0.2 * s.runs:
        return np.nan
    return float(100.0 * np.hypot(s.bias[k], s.sd[k]))


def varied(found: Found) -> plt.Figure:
    """RMS error of zeta, mean of the three plants' logarithms, for all that is varied."""
    figure, place = plt.subplots(figsize=(9, 6.4), layout="constrained")
    labels = list(dict.fromkeys(_label(case.name) for _, case in about_the_plants()))
    for method in METHODS:
        points = [(_mean_error(found, label, method), at) for at, label in enumerate(labels)]
        xs, ys = np.array(points).T
        place.plot(xs, ys, "o", color=COLORS[method], label=method, alpha=0.85)
    place.set_yticks(range(len(labels)), [label or "plain: 1 % noise, delay=1" for label in labels])
    place.set(
        xscale="log", xlabel="RMS error of zeta [%], geometric mean of the three plants; only what is `ok`"
    )
    place.invert_yaxis()
    place.set_xlim(1e-3, None)
    place.grid(alpha=0.3)
    place.legend(frameon=False)
    return figure


def _label(name: str) -> str:
    return " ".join(name.split()[2:])


def _mean_error(found: Found, label: str, method: str) -> float:
    names = [case.name for _, case in about_the_plants() if _label(case.name) == label]
    errors = [_error(summary(found.get(name, []), method), 1) for name in names]
    return float(np.exp(np.mean(np.log(np.maximum(errors, 1.2e-3)))))
