"""Residuals over frequency, their whiteness, and what they still know of the input."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.signal import welch

from seod.diagnose.result import SD_OF_95

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array

_SEGMENT: Final = 2048
"""Longest segment of a spectrum [samples]."""


def spectrum(segments: Sequence[Array], rate_hz: float) -> tuple[Array, Array]:
    """Power spectral density of segments of one signal, their mean: frequencies [Hz], density [unit^2/Hz].

    Zero frequency is left out.
    """
    length = min(_SEGMENT, *(len(segment) for segment in segments))
    found = [welch(_present(segment), rate_hz, nperseg=length, detrend="constant") for segment in segments]
    density = np.average([each for _, each in found], axis=0, weights=[len(segment) for segment in segments])
    return np.asarray(found[0][0][1:]), np.asarray(density[1:])


class Correlation(NamedTuple):
    """Coefficients over lags [samples], and the bound within which 95 % lie where nothing is left."""

    lag: Array
    value: Array
    bound: float

    @property
    def outside(self) -> float:
        """Part of the lags beyond the bound, the lag 0 of an autocorrelation left out."""
        kept = np.abs(self.value) < 1.0 - 1e-9
        return float(np.mean(np.abs(self.value[kept]) > self.bound)) if kept.any() else 0.0


def autocorrelation(segments: Sequence[Array], lags: int) -> Correlation:
    """Of segments of a residual, up to so many samples."""
    value = _correlation([(segment, segment) for segment in segments], lags)[lags:]
    count = sum(len(segment) for segment in segments)
    return Correlation(np.arange(lags + 1.0), value, SD_OF_95 / math.sqrt(count))


def cross_correlation(inputs: Sequence[Array], residuals: Sequence[Array], lags: int) -> Correlation:
    """Of input and residual, positive lags: the residual follows; the bound is Bartlett's."""
    value = _correlation(list(zip(inputs, residuals, strict=True)), lags)
    own = (
        _correlation([(segment, segment) for segment in segments], lags) for segments in (inputs, residuals)
    )
    a, b = own
    count = sum(len(segment) for segment in residuals)
    bound = SD_OF_95 * math.sqrt(max(1.0, float(np.sum(a * b))) / count)
    return Correlation(np.arange(-lags, lags + 1.0), value, bound)


def _correlation(pairs: Sequence[tuple[Array, Array]], lags: int) -> Array:
    """Coefficients of the pairs' second on the first from -lags to lags, shape (2 lags + 1,)."""
    total, powers = np.zeros(2 * lags + 1), np.zeros(2)
    for first, second in pairs:
        x, y = (_present(each) - np.mean(_present(each)) for each in (first, second))
        size = 2 * len(x)
        product = np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)
        total += np.r_[product[size - lags :], product[: lags + 1]]
        powers += float(x @ x), float(y @ y)
    return np.asarray(total / max(math.sqrt(powers[0] * powers[1]), 1e-300))


def _present(x: Array) -> Array:
    """Missing samples as nothing left."""
    return np.where(np.isfinite(x), x, 0.0)
