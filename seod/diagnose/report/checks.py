"""Pictures that show whether what is left is noise: spectra, correlations, harmonics, phase."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.chart import FLOOR, MEASURED, Chart, Curve
from seod.diagnose.report.fields import over_phase
from seod.diagnose.show.distortion import harmonics, period
from seod.diagnose.show.spectra import autocorrelation, cross_correlation, spectrum

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.report.pictures import Pictures
    from seod.diagnose.result import Array
    from seod.diagnose.show.residual import Residual
    from seod.diagnose.show.spectra import Correlation

_LAGS: Final = 4.0
"""Periods of the plant's frequency that correlations reach to."""
_SHORTEST: Final = 8.0
"""Period of a command that is looked at [samples]."""


def spectra(p: Pictures) -> str:
    """Densities of measurement and errors, and the noise's."""
    rate = 1.0 / p.tick
    curves = [Curve(*spectrum([w.y for w in p.windows], rate), "measured", MEASURED)]
    curves += [Curve(*spectrum(_errors(left), rate), label, colour) for label, colour, left in p.models]
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
    length = _period(p)
    if length is None:
        return None
    measured = harmonics([w.y for w in p.windows], length)
    curves = [Curve(measured.number, measured.amplitude, "measured", MEASURED, dots=True)]
    for label, colour, left in p.models:
        found = harmonics(_errors(left), length)
        odd, even = (f"{100.0 * found.share(k) / measured.share(1):.2g}" for k in (1, 2))
        told = f"{label}: odd {odd} %, even {even} %"
        curves.append(Curve(found.number, found.amplitude, told, colour, dots=True))
    title = "Distortion: symmetric causes make odd harmonics, others even ones"
    return Chart(title, "harmonic", f"amplitude [{p.unit}]", curves, log_y=True).svg()


def phase(p: Pictures) -> str | None:
    """Error over the phase of the cycle; None where the command is not periodic."""
    length = _period(p)
    if length is None:
        return None
    return over_phase(p, np.concatenate([_phase(w.u, length) for w in p.windows]))


def _period(p: Pictures) -> float | None:
    """Of the command [samples], where a cycle has enough of them."""
    length = period(p.windows[0].u)
    return None if length is None or length < _SHORTEST else length


def _correlated(p: Pictures, title: str, of: Callable[[Sequence[Residual]], Correlation]) -> str:
    curves, bound, lag = [], 0.0, np.zeros(1)
    for label, colour, left in p.models:
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
