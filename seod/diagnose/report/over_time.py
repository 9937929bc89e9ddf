"""Pictures over time: measurement and simulations, errors of windows and of whole recordings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.chart import AFTER, BEFORE, FLOOR, MEASURED, Chart, Curve
from seod.diagnose.report.pictures import Pictures
from seod.diagnose.report.words import told_runs
from seod.plots.style import new_figure, style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from seod.diagnose.result import Array, Diagnosis, Score, Whole
    from seod.diagnose.show.residual import Residual

WIDE: Final = 940.0
_SHOWN: Final = 12.0
"""Periods of the plant's frequency that the overlay shows."""
_BLOCKS_SHOWN: Final = 40
"""In which errors are shown over time."""


def draw(d: Diagnosis, unit: str) -> Figure:
    """The worst window and the errors there, as a picture of its own."""
    p = Pictures(d, unit)
    with style():
        figure = new_figure(9.8, 5.2)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        _overlay(p).draw(above)
        _errors(p).draw(below)
    return figure


def overlay(p: Pictures) -> str:
    """Measurement and both simulations where the baseline is at its worst."""
    return _overlay(p).wide()


def errors(p: Pictures) -> str:
    """What is left there, against the noise."""
    return _errors(p).wide()


def _overlay(p: Pictures) -> Chart:
    at = _worst(p)
    window, rows = p.windows[at], _shown_rows(p, at)
    t = window.t[rows]
    curves = [
        Curve(t, window.y[rows], "measured", MEASURED, 2.6),
        Curve(t, window.y_baseline[rows], "baseline", BEFORE, 1.3),
    ]
    if p.diagnosis.extends:
        curves.append(Curve(t, window.y_extended[rows], "extended", AFTER, 1.3, "5 3"))
    title = "A held-out window, simulated from its beginning: where the baseline is at its worst"
    return Chart(title, "", f"y [{p.unit}]", curves, WIDE, 270.0)


def _errors(p: Pictures) -> Chart:
    at = _worst(p)
    window, rows = p.windows[at], _shown_rows(p, at)
    t, flat = window.t[rows], np.full(len(window.t[rows]), 2.0 * p.noise(window))
    labels = {"baseline": "error of the baseline", "extended": "of the extended model"}
    curves = [Curve(t, left[at].error[rows], labels[label], colour, 1.0) for label, colour, left in p.models]
    curves.insert(0, Curve(t, -flat, "noise, two standard deviations", FLOOR, to=flat))
    return Chart("", "t [s]", f"y - simulated [{p.unit}]", curves, WIDE, 200.0)


def wholes(p: Pictures) -> list[str]:
    """Errors of one simulation of whole recordings, as far as that stays with them."""
    return [_whole(p, k, p.diagnosis.whole[k]) for k in told_runs(p.diagnosis)]


def _whole(p: Pictures, k: int, one: Whole) -> str:
    d = p.diagnosis
    models: list[tuple[str, str, Score, Array]] = [("baseline", BEFORE, d.baseline, one.y_baseline)]
    if p.diagnosis.extends:
        models.append(("extended", AFTER, d.extended, one.y_extended))
    curves = [Curve(one.t, one.y - np.mean(one.y[np.isfinite(one.y)]), "measured, less its mean", "#a9a9a9")]
    for label, colour, score, simulated in models:
        if not score.diverged:
            curves.append(Curve(one.t, one.y - simulated, f"error of the {label}", colour, 1.0))
    kind = ", held out" if any(run.unseen for run in d.extended.free_runs[k : k + 1]) else ""
    which = f" ({k + 1} of {len(d.whole)}{kind})" if len(d.whole) > 1 else ""
    title = f"The whole recording{which} in one simulation from its commands alone"
    return Chart(title, "t [s]", f"[{p.unit}]", curves, WIDE, 220.0).wide()


def over_blocks(p: Pictures) -> str:
    """Rms error of blocks of the windows, by their place in the recording."""
    parts = -(-_BLOCKS_SHOWN // len(p.windows))
    middle = np.concatenate([[np.mean(b) for b in np.array_split(w.t, parts)] for w in p.windows])
    curves = [Curve(middle, _rms(left, parts), label, colour, dots=True) for label, colour, left in p.models]
    noise = np.repeat([p.noise(w) for w in p.windows], parts)
    curves.append(Curve(middle, noise, "noise", FLOOR, dash="4 3"))
    title = "Over time: rms error within the held-out windows"
    return Chart(title, "t [s]", f"[{p.unit}]", curves, log_y=True).svg()


def _shown_rows(p: Pictures, at: int) -> slice:
    """The end of a window, as long as the eye can follow."""
    most = int(_SHOWN * 2.0 * math.pi / p.diagnosis.baseline.omega_n / p.tick)
    rows = len(p.windows[at].t)
    return slice(max(0, rows - max(most, 50)), rows)


def _rms(left: Sequence[Residual], parts: int = 1) -> Array:
    """Of each window, or of so many parts of each; nan where no sample is."""
    blocks = [block for r in left for block in np.array_split(r.error, parts)]
    return np.array([math.sqrt(np.nanmean(b**2)) if np.isfinite(b).any() else math.nan for b in blocks])


def _worst(p: Pictures) -> int:
    scored = [
        r._replace(error=np.where(w.scored, r.error, np.nan))
        for w, r in zip(p.windows, p.before, strict=True)
    ]
    return int(np.nanargmax(_rms(scored)))
