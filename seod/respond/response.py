"""A frequency response from segments of recordings: points, fit of Eq. 1, and how far to believe it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.respond.broadband import broadband
from seod.respond.fit import fit
from seod.respond.period import find_period
from seod.respond.points import Detection, Points, detection, points
from seod.respond.spectrum import spectra

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.respond.fit import Fit
    from seod.respond.record import Segment

_SETTLED: Final = 0.2
"""First part of a recording, at least a period, in which a transient may be left."""
_UNSURE: Final = {"omega_n": 0.03, "zeta": 0.1, "K_L": 0.1}
"""Relative standard deviations above which an answer is noisy."""
_DISTORTED: Final = 0.1
"""Part of the response on lines that were not excited, above which the plant is not linear."""
_OFF: Final = 0.1
"""Likewise what the fit leaves of the points, where noise does not explain it."""
_RANGE: Final = (0.02, 10.0)


@dataclass(frozen=True)
class Response:
    """The answer.

    Attributes:
        points: By frequency.
        detection: Lines that were not excited; None where there are none.
        fit: Eq. 1 with its delay free (or as it was given).
        without_delay: Eq. 1 without delay.
        quality: `ok`, or `noisy`, `nonlinear`, `out_of_range`.
        message: What is wrong, where it is not `ok`.
        periodic: The excitation repeats; else spectra were averaged.
    """

    points: Points
    detection: Detection | None
    fit: Fit
    without_delay: Fit
    quality: str
    message: str
    periodic: bool


def respond(
    segments: Sequence[Segment], K_L: float | None = None, delay: float | None = None, lag: float = 0.0
) -> Response:
    """The response that all segments tell together.

    Args:
        segments: Of one plant and one output. Neighbours with the same period are realisations of one
            excitation; others, as of a stepped sine, add points.
        K_L: Gain [unit/s/V], if it is known; None: estimated.
        delay: Beyond the recordings' own times [s], if it is known; None: estimated.
        lag: Time constant of the sensor [s].

    Raises:
        RespondError: They tell no response.
    """
    known = [_with_period(segment) for segment in segments]
    found, lines = [], []
    for period, group in groupby(known, key=lambda segment: segment.period):
        if period is None:
            found += [broadband(segment) for segment in group]
            continue
        part, empty = _periodic(list(group))
        found.append(part)
        lines.append(empty)
    whole = joined(found)
    output = segments[0].output
    best, plain = fit(whole, output, K_L, delay, lag), fit(whole, output, K_L, 0.0, lag)
    empty_lines = _together(lines)
    quality, message = _judged(best, empty_lines)
    return Response(whole, empty_lines, best, plain, quality, message, bool(lines))


def _with_period(segment: Segment) -> Segment:
    """With its period, and without its beginning, if it repeats and nobody has said so."""
    if segment.period is not None:
        return segment
    period = find_period(segment)
    if period is None:
        return segment
    span = float(segment.t[-1] - segment.t[0])
    return replace(segment.after(float(segment.t[0]) + max(period, _SETTLED * span)), period=period)


def _periodic(group: Sequence[Segment]) -> tuple[Points, Detection]:
    """Points and empty lines of the realisations of one excitation."""
    every = [spectra(segment) for segment in group]
    least = min(len(each.orders) for each in every)
    every = [replace(s, orders=s.orders[:least], u=s.u[:, :least], y=s.y[:, :least]) for s in every]
    found = points(every)
    return found, detection(every, found)


def joined(parts: Sequence[Points]) -> Points:
    """All points, by frequency."""
    names = ("omega", "G", "sd", "coherence", "volts")
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    order = np.argsort(columns["omega"], kind="stable")
    return Points(**{name: column[order] for name, column in columns.items()})


def _together(parts: Sequence[Detection]) -> Detection | None:
    kept = [part for part in parts if len(part.omega)]
    if not kept:
        return None
    names = ("omega", "odd", "level", "noise")
    return Detection(**{name: np.concatenate([getattr(part, name) for part in kept]) for name in names})


def _judged(best: Fit, empty: Detection | None) -> tuple[str, str]:
    """The first that applies."""
    plant, sd = best.plant, best.sd
    if not _RANGE[0] < plant.zeta < _RANGE[1]:
        return "out_of_range", f"zeta would be {plant.zeta:.3g}"
    for odd, word in ((True, "odd"), (False, "even")):
        level = None if empty is None else empty.distortion(odd)
        if level is not None and level[1] and level[0] > _DISTORTED:
            return (
                "nonlinear",
                f"{word} lines that were not excited carry {100 * level[0]:.0f} % of the response",
            )
    for name, most in _UNSURE.items():
        value = abs(getattr(plant, name))
        if sd[name] > most * value:
            return "noisy", f"{name} is hardly told: {value:.3g} +- {1.96 * sd[name]:.2g}"
    if best.misfit > 2.0 and best.error > _OFF:
        return (
            "nonlinear",
            f"Eq. 1 leaves {100 * best.error:.0f} % of the points, and noise does not explain it",
        )
    return "ok", ""
