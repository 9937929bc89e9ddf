"""Points of the response with variance and coherence, and what lies on lines that were not excited.

Means over windows, then over realisations of a random-phase multisine (Pintelon and Schoukens, System
Identification, 2nd ed., chapters 2 to 4). The voltage is known exactly, whatever fed it back, so that
mean(Y) / mean(U) has no bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.respond.spectrum import excited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.respond.record import Array, Complex
    from seod.respond.spectrum import Flags, Spectra

_FLOOR: Final = 1e-3
"""Distortion below this part of the response is not told."""
_SURE: Final = 5.0
"""Standard deviations of what noise alone would show."""
_NEIGHBOURS: Final = 2
"""On each side, over which a variance is averaged: noise is even, and few windows tell it badly."""


@dataclass(frozen=True)
class Points:
    """The response at the excited lines; arrays of one length.

    Attributes:
        omega: Frequency [rad/s].
        G: Response [unit/V, or unit/s/V].
        sd: Standard deviation of its real and of its imaginary part.
        coherence: Between 0 and 1.
        volts: Amplitude of the excitation [V].
    """

    omega: Array
    G: Complex
    sd: Array
    coherence: Array
    volts: Array


@dataclass(frozen=True)
class Detection:
    """Lines that were not excited: what a linear plant leaves empty; arrays of one length.

    Attributes:
        omega: Frequency [rad/s].
        odd: The line's order is odd.
        level: Amplitude there, as a part of the response of the neighbouring excited lines.
        noise: Of which noise explains so much (RMS).
    """

    omega: Array
    odd: Flags
    level: Array
    noise: Array

    def distortion(self, odd: bool) -> tuple[float, bool] | None:
        """RMS part of the response beyond noise, and whether it is significant; None without such lines.

        Lines count by how well they are known.
        """
        chosen = self.odd == odd
        if not chosen.any():
            return None
        noise = self.noise[chosen] ** 2
        weight = 1.0 / (noise + _FLOOR**2)
        excess = float(weight @ (self.level[chosen] ** 2 - noise) / weight.sum())
        chance = float(np.linalg.norm(weight * noise)) / float(weight.sum())
        return math.sqrt(max(0.0, excess)), excess > _SURE * chance + _FLOOR**2


def points(realisations: Sequence[Spectra]) -> Points:
    """The response at the lines that all realisations excite.

    The variance is that of noise over the windows, and where there are several realisations that of their
    scatter, if it is larger: a nonlinear plant answers each of them a little differently.

    Args:
        realisations: Of the same period and orders; one or more.
    """
    chosen = np.logical_and.reduce([excited(each.u) for each in realisations])
    parts = [_response(each, chosen) for each in realisations]
    G = np.mean([part[0] for part in parts], axis=0)
    variance = np.mean([part[1] for part in parts], axis=0) / len(parts)
    if len(parts) > 1:
        scatter = np.sum([np.abs(part[0] - G) ** 2 for part in parts], axis=0) / (len(parts) - 1)
        variance = np.maximum(variance, _smooth(scatter / np.abs(G) ** 2) * np.abs(G) ** 2 / len(parts))
    u, y = (np.concatenate([getattr(each, name)[:, chosen] for each in realisations]) for name in ("u", "y"))
    volts = np.sqrt(np.mean(np.abs(u) ** 2, axis=0))
    return Points(realisations[0].omega[chosen], G, np.sqrt(0.5 * variance), coherence(u, y), volts)


def coherence(u: Complex, y: Complex) -> Array:
    """|sum Y conj U|^2 / (sum |Y|^2 sum |U|^2) over the first axis."""
    cross = np.abs(np.sum(y * u.conj(), axis=0)) ** 2
    return np.asarray(
        cross / np.maximum(np.sum(np.abs(u) ** 2, axis=0) * np.sum(np.abs(y) ** 2, axis=0), 1e-300)
    )


def _response(spectra: Spectra, chosen: Flags) -> tuple[Complex, Array]:
    """Response and variance of its complex value."""
    u, y = spectra.u[:, chosen], spectra.y[:, chosen]
    mean_u, n = u.mean(axis=0), len(u)
    G = y.mean(axis=0) / mean_u
    noise = _smooth(np.sum(np.abs(y - G * u) ** 2, axis=0) / (n - 1))
    return G, noise / n / np.abs(mean_u) ** 2


def _smooth(values: Array) -> Array:
    """Mean over the neighbours."""
    if len(values) < 2:
        return values
    wide = min(_NEIGHBOURS, len(values) - 1)
    kernel = np.ones(2 * wide + 1)
    total = np.convolve(values, kernel, "full")[wide:-wide]
    return np.asarray(total / np.convolve(np.ones(len(values)), kernel, "full")[wide:-wide])


def detection(realisations: Sequence[Spectra], found: Points) -> Detection:
    """Lines up to a little beyond the highest excited one that no realisation excites.

    What the feedback put into the voltage there is taken away by the response of the neighbours.
    """
    omega = realisations[0].omega
    empty = np.logical_and.reduce([~excited(each.u) for each in realisations])
    band = omega <= 1.05 * found.omega[-1] if len(found.omega) > 2 else omega > 0.0
    chosen = empty & band
    at, levels, noises = omega[chosen], [], []
    G = _between(found.omega, found.G, at)
    for each in realisations:
        u, y, n = each.u[:, chosen], each.y[:, chosen], len(each.u)
        left = y - G * u
        size = _between(found.omega, np.abs(found.G) * found.volts, at).real
        levels.append(np.abs(left.mean(axis=0)) / size)
        noises.append(np.sqrt(_smooth(left.var(axis=0, ddof=1)) / n) / size)
    odd = realisations[0].orders[chosen] % 2 == 1
    return Detection(at, odd, _rms(levels), _rms(noises))


def _rms(values: Sequence[Array]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


def _between(omega: Array, values: Complex | Array, at: Array) -> Complex:
    """Interpolated between the lines; beyond them the nearest."""
    return np.interp(at, omega, values.real) + 1j * np.interp(at, omega, values.imag)
