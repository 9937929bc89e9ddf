"""Pictures over time: measurement and simulations, errors of windows and of whole recordings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.chart import AFTER, BEFORE, FLOOR, MEASURED, Chart, Curve

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Array, Score, Whole
    from seod.diagnose.report.pictures import Pictures
    from seod.diagnose.show.residual import Residual

WIDE: Final = 940.0
_SHOWN: Final = 12.0
"""Periods of the plant's frequency that the overlay shows."""
_MOST_WHOLE: Final = 4
"""Recordings that are drawn as a whole."""


def overlay(p: Pictures) -> str:
    """Measurement and both simulations where the baseline is at its worst."""
    at = _worst(p)
    window, piece = p.windows[at], _piece(p, at)
    t = window.t[piece]
    curves = [
        Curve(t, window.y[piece], "measured", MEASURED, 2.6),
        Curve(t, window.y_baseline[piece], "baseline", BEFORE, 1.3),
    ]
    if p.extended:
        curves.append(Curve(t, window.y_extended[piece], "extended", AFTER, 1.3, "5 3"))
    title = "A held-out window, simulated from its beginning: where the baseline is at its worst"
    return Chart(title, "", f"y [{p.unit}]", curves, WIDE, 270.0).svg()


def errors(p: Pictures) -> str:
    """What is left there, against the noise."""
    at = _worst(p)
    window, piece = p.windows[at], _piece(p, at)
    t, flat = window.t[piece], np.full(len(window.t[piece]), 2.0 * p.noise(window))
    labels = {"baseline": "error of the baseline", "extended": "of the extended model"}
    curves = [Curve(t, left[at].error[piece], labels[label], colour, 1.0) for label, colour, left in p.models]
    curves.insert(0, Curve(t, -flat, "noise, two standard deviations", FLOOR, to=flat))
    return Chart("", "t [s]", f"y - simulated [{p.unit}]", curves, WIDE, 200.0).svg()


def wholes(p: Pictures) -> list[str]:
    """Errors of one simulation of each whole recording, as far as that stays with it."""
    return [_whole(p, k, one) for k, one in enumerate(p.diagnosis.whole[:_MOST_WHOLE])]


def _whole(p: Pictures, k: int, one: Whole) -> str:
    d = p.diagnosis
    models: list[tuple[str, str, Score, Array]] = [("baseline", BEFORE, d.baseline, one.y_baseline)]
    if p.extended:
        models.append(("extended", AFTER, d.extended, one.y_extended))
    curves = [Curve(one.t, one.y - np.mean(one.y[np.isfinite(one.y)]), "measured, less its mean", "#bbbbbb")]
    for label, colour, score, simulated in models:
        if not score.diverged:
            curves.append(Curve(one.t, one.y - simulated, f"error of the {label}", colour, 1.0))
    which = f" ({k + 1} of {len(d.whole)})" if len(d.whole) > 1 else ""
    title = f"The whole recording{which} in one simulation from its commands alone"
    return Chart(title, "t [s]", f"[{p.unit}]", curves, WIDE, 220.0).svg()


def over_windows(p: Pictures) -> str:
    """Rms error of each window, by its place in the recording."""
    middle = np.array([float(np.mean(w.t)) for w in p.windows])
    curves = [Curve(middle, _rms(p, left), label, colour, dots=True) for label, colour, left in p.models]
    curves.append(Curve(middle, np.array([p.noise(w) for w in p.windows]), "noise", FLOOR, dash="4 3"))
    title = "Over time: rms error of each held-out window"
    return Chart(title, "t [s]", f"[{p.unit}]", curves, log_y=True).svg()


def _piece(p: Pictures, at: int) -> slice:
    """The end of a window, as long as the eye can follow."""
    most = int(_SHOWN * 2.0 * math.pi / p.diagnosis.baseline.omega_n / p.tick)
    rows = len(p.windows[at].t)
    return slice(max(0, rows - max(most, 50)), rows)


def _rms(p: Pictures, left: Sequence[Residual]) -> Array:
    pairs = zip(p.windows, left, strict=True)
    return np.array([math.sqrt(float(np.nanmean(r.error[w.scored] ** 2))) for w, r in pairs])


def _worst(p: Pictures) -> int:
    return int(np.argmax(_rms(p, p.before)))
