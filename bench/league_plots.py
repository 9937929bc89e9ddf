"""The plots of `bench/league.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from accuracy_cases import ZETAS
from accuracy_summary import NAMES
from league_cases import FACTORS, GRID, NOISES, VARIED, factor
from league_runs import METHODS
from league_summary import AT, GOAL, done, of, summary

if TYPE_CHECKING:
    from pathlib import Path

    from league_summary import Found

COLORS = dict(
    zip(
        METHODS,
        ("#1f6fb4", "#2a9d57", "#58b0e3", "#d9822b", "#9a9a9a", "#b07aa1", "#c43c39", "#6b4c9a", "#8c6d31",
         "#e377c2", "#444444"),
        strict=True,
    )
)  # fmt: skip
MARKS = dict(zip(METHODS, "osDv^<>Ph*X", strict=True))


def draw(found: Found, folder: Path) -> None:
    """Four PNGs."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, drawer in (("zeta", over_zeta), ("noise", over_noise), ("varied", varied), ("wave", wave)):
        figure = drawer(found)
        figure.savefig(folder / f"league-{name}.png", dpi=100)
        plt.close(figure)


def _style(method: str) -> dict[str, object]:
    """Ours are thick lines with full marks."""
    ours = method in METHODS[:3]
    style = {
        "color": COLORS[method],
        "marker": MARKS[method],
        "markersize": 5 if ours else 4,
        "label": method,
    }
    return style | {"linewidth": 1.8 if ours else 0.9, "zorder": 5 if ours else 3}


def over_zeta(found: Found) -> plt.Figure:
    """RMS errors at 1 % noise over the damping."""
    figure, places = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
    cases = [case for case in GRID if case.noise == AT and case.name in found]
    for k, name in enumerate(NAMES):
        for method in METHODS:
            rms = [100 * s.rms[k] if (s := of(found, case, method)) else np.nan for case in cases]
            places[k].plot([case.zeta for case in cases], rms, **_style(method))
        limit = [100 * np.sqrt(np.mean([h["wave"].bound[k] ** 2 for h in found[c.name]])) for c in cases]
        places[k].plot([case.zeta for case in cases], limit, "k:", label="Cramer-Rao bound")
        places[k].set(xscale="log", yscale="log", xlabel="zeta", ylabel=f"RMS error of {name} [%]")
        places[k].set_xticks(ZETAS, [f"{zeta:g}" for zeta in ZETAS], fontsize=8)
        places[k].minorticks_off()
        places[k].grid(alpha=0.3)
    figure.legend(
        *places[0].get_legend_handles_labels(), loc="outside right center", frameon=False, fontsize=8
    )
    figure.suptitle(
        "1 % noise, one tick of delay, omega_n Ts = 0.05; the bound is that of wave's window", fontsize=10
    )
    return figure


def over_noise(found: Found) -> plt.Figure:
    """RMS errors over the noise, geometric means over the damping."""
    figure, places = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
    for k, name in enumerate(NAMES):
        for method in METHODS:
            places[k].plot(
                range(len(NOISES)), [_mean_at(found, method, x, k) for x in NOISES], **_style(method)
            )
        places[k].set(yscale="log", xlabel="noise [% of the amplitude]", ylabel=f"RMS error of {name} [%]")
        places[k].set_xticks(range(len(NOISES)), [f"{100 * x:g}" for x in NOISES])
        places[k].set_ylim(1e-4, 30)
        places[k].grid(alpha=0.3)
    figure.legend(
        *places[0].get_legend_handles_labels(), loc="outside right center", frameon=False, fontsize=8
    )
    figure.suptitle(
        "geometric mean over zeta 0.1 to 1.5; without noise: what the method itself is wrong by", fontsize=10
    )
    return figure


def _mean_at(found: Found, method: str, noise: float, k: int) -> float:
    said = [s.rms[k] for case in GRID if case.noise == noise and (s := of(found, case, method))]
    return float(100.0 * np.exp(np.mean(np.log(np.maximum(said, 1e-8))))) if said else np.nan


def varied(found: Found) -> plt.Figure:
    """RMS errors at 1 % noise for all that is varied, geometric means of the plants."""
    figure, places = plt.subplots(1, 2, figsize=(10, 5), sharey=True, layout="constrained")
    labels = [" ".join(f"{name}={value:g}" for name, value in each.items()) for each in FACTORS]
    for k, name in enumerate(NAMES):
        for method in METHODS:
            xs = [_mean_of(found, method, label, k) for label in labels]
            places[k].plot(xs, range(len(labels)), **(_style(method) | {"linestyle": "none"}))
        places[k].set(xscale="log", xlabel=f"RMS error of {name} [%]")
        places[k].grid(alpha=0.3)
    places[0].set_yticks(range(len(labels)), [label or "plain" for label in labels])
    places[0].invert_yaxis()
    figure.legend(
        *places[0].get_legend_handles_labels(), loc="outside right center", frameon=False, fontsize=8
    )
    figure.suptitle(
        "1 % noise, geometric mean of the plants; only where all of them have answers", fontsize=10
    )
    return figure


def _mean_of(found: Found, method: str, text: str, k: int) -> float:
    cases = [case for case in VARIED if case.noise == AT and factor(case) == text]
    said = [s.rms[k] for case in cases if (s := of(found, case, method))]
    return float(100.0 * np.exp(np.mean(np.log(said)))) if len(said) == len(cases) and said else np.nan


def wave(found: Found) -> plt.Figure:
    """RMS over the bound of `wave`, in all cases with noise."""
    figure, places = plt.subplots(2, 1, figsize=(10, 5.4), sharex=True, layout="constrained")
    cases = [case for case in done(found, noisy=True) if of(found, case, "wave")]
    said = [summary(found[case.name], "wave") for case in cases]
    for k, name in enumerate(NAMES):
        ratios, chance = [s.ratio[k] for s in said], [s.chance(k) for s in said]
        places[k].errorbar(
            range(len(said)), ratios, chance, fmt="o", markersize=4, capsize=2, color=COLORS["wave"]
        )
        places[k].axhline(GOAL, color="gray", linestyle=":")
        places[k].axhline(1.0, color="gray", linewidth=0.5)
        places[k].set(ylabel=f"{name}: RMS / bound", ylim=(0.6, max(1.6, *(1.05 * x for x in ratios))))
    names = [f"{case.zeta:g}, {100 * case.noise:g} % {factor(case)}" for case in cases]
    places[1].set_xticks(range(len(said)), names, rotation=90, fontsize=6)
    figure.suptitle("wave (bars: 95 % of chance; dotted: the goal)")
    return figure
