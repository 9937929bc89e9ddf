"""Pictures that show whether what is left is noise: spectra, correlations, harmonics, phase."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.chart import AFTER, BEFORE, FLOOR, MEASURED, Chart, Curve
from seod.diagnose.show.distortion import harmonics, period
from seod.diagnose.show.spectra import autocorrelation, cross_correlation, spectrum

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.report.pictures import Pictures
    from seod.diagnose.show.residual import Residual
    from seod.diagnose.show.spectra import Correlation

_LAGS: Final = 4.0
"""Periods of the plant's frequency that correlations reach to."""


def spectra(p: Pictures) -> str:
    """Densities of measurement and errors, and the noise's."""
    rate = 1.0 / p.tick
    kinds = [
        ("measured", MEASURED, [w.y for w in p.windows]),
        ("baseline", BEFORE, _errors(p.before)),
    ]
    if p.extended:
        kinds.append(("extended", AFTER, _errors(p.after)))
    curves = [Curve(*spectrum(pieces, rate), label, colour) for label, colour, pieces in kinds]
    sd = float(np.mean([p.noise(w) for w in p.windows]))
    ends = curves[0].x[[0, -1]]
    curves.append(Curve(ends, np.full(2, 2.0 * sd**2 / rate), "noise", FLOOR, dash="4 3"))
    title = "Spectra: measurement, errors, noise"
    return Chart(title, "f [Hz]", f"[{p.unit}²/Hz]", curves, log_x=True, log_y=True).svg()


def whiteness(p: Pictures) -> str:
    """Autocorrelation of the errors."""
    lags = _lags(p)
    return _correlated(
        p,
        "Whiteness: does the error know its own past?",
        lambda left: autocorrelation(_errors(left), lags),
    )


def input_left(p: Pictures) -> str:
    """Correlation of the errors with the command."""
    lags, inputs = _lags(p), [w.u for w in p.windows]
    return _correlated(
        p,
        "Cross-correlation: does the error still know the command?",
        lambda left: cross_correlation(inputs, _errors(left), lags),
    )


def distortion(p: Pictures) -> str | None:
    """Harmonics of measurement and errors; None where the command is not periodic in the windows."""
    length = period(p.windows[0].u)
    if length is None or length < 8.0:
        return None
    kinds = [
        ("measured", MEASURED, [w.y for w in p.windows]),
        ("baseline", BEFORE, _errors(p.before)),
    ]
    if p.extended:
        kinds.append(("extended", AFTER, _errors(p.after)))
    curves = []
    for label, colour, pieces in kinds:
        found = harmonics(pieces, length)
        curves.append(Curve(found.number, found.amplitude, label, colour, dots=True))
    title = "Harmonics: odd ones are symmetric causes, even ones are not"
    return Chart(title, "harmonic", f"amplitude [{p.unit}]", curves, log_y=True).svg()


def over_phase(p: Pictures) -> str | None:
    """Error over the phase of the cycle; None where the command is not periodic."""
    length = period(p.windows[0].u)
    if length is None or length < 8.0:
        return None
    turn = np.concatenate([_phase(w.u, length) for w in p.windows])
    return p.bins("Over the phase of the cycle", "phase [cycles]", f"error [{p.unit}]", turn, "error")


def _correlated(p: Pictures, title: str, of: Callable[[Sequence[Residual]], Correlation]) -> str:
    kinds = [("baseline", BEFORE, p.before), ("extended", AFTER, p.after)][: 1 + p.extended]
    curves, bound, lag = [], 0.0, np.zeros(1)
    for label, colour, left in kinds:
        found = of(left)
        lag, bound = found.lag * 1e3 * p.tick, found.bound
        curves.append(Curve(lag, found.value, f"{label}: {found.outside:.0%} outside", colour))
    curves.append(Curve(lag, np.full(len(lag), -bound), "", FLOOR, to=np.full(len(lag), bound)))
    return Chart(title, "lag [ms] (grey: 95 % of white noise)", "correlation", curves).svg()


def _lags(p: Pictures) -> int:
    longest = _LAGS * 2.0 * math.pi / p.diagnosis.baseline.omega_n / p.tick
    return int(min(max(longest, 20), 0.3 * min(len(w.t) for w in p.windows), 2000))


def _errors(left: Sequence[Residual]) -> list[Array]:
    return [each.error for each in left]


def _phase(u: Array, length: float) -> Array:
    """Of each row, from the strongest component of the command at its period [cycles, 0 to 1]."""
    rows = np.arange(len(u))
    turn = np.exp(-2j * math.pi * rows / length)
    start = np.angle(np.sum(np.where(np.isfinite(u), u, 0.0) * turn)) / (2.0 * math.pi)
    return np.asarray((rows / length + start + 0.25) % 1.0)
