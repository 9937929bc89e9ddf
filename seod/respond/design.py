"""What to excite with: odd random-phase multisines or stepped sines, as large as the axis' limits allow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.loop.tones import MOST_TONES, Tone
from seod.respond.fit import Plant, model
from seod.respond.record import RespondError

if TYPE_CHECKING:
    from numpy.random import Generator

    from seod.respond.record import Array, Output

    Tones = tuple[Tone, ...]

ROOM: Final = 0.6
"""Part of the way to a limit that the expected motion may use."""
_GROUP: Final = 4
"""Of so many odd lines one is left out by chance: odd distortion shows there, even on even lines."""
_LOWEST: Final = 2
"""Lines that stay: they alone tell K_L."""
_PHASES: Final = 20
"""Random phases tried; those with the lowest peak are taken."""
_UNKNOWN_PEAK: Final = 2.5
"""Resonance to expect of a plant that is not known: that of zeta 0.2."""
SETTLING: Final = 8.0
"""Time constants after which a transient has gone."""


@dataclass(frozen=True)
class Excitation:
    """One drive.

    Attributes:
        period: After which it repeats [s].
        tones: Their sum.
        settling: Left out at the beginning [s].
        duration: Whole [s].
    """

    period: float
    tones: Tones
    settling: float
    duration: float

    def wave(self) -> Array:
        """One period [V], shape (n,), evenly sampled and fine enough for its peaks."""
        return _sum(self.tones, self.period, None, "velocity")

    @property
    def most(self) -> float:
        """Largest voltage."""
        return float(np.abs(self.wave()).max())

    def scaled(self, factor: float) -> Excitation:
        """With all amplitudes times `factor`."""
        return replace(self, tones=tuple(t._replace(amplitude=t.amplitude * factor) for t in self.tones))


@dataclass(frozen=True)
class Room:
    """What the motion may use, to each side of where the axis stands.

    Attributes:
        output: Whether positions or speeds are measured.
        measured: Of the measured quantity [unit, or unit/s].
        speed: Of the speed [unit/s]; infinite where only the measured quantity has limits.
        volts: [V].
    """

    output: Output
    measured: float
    speed: float
    volts: float


def multisines(
    band: tuple[float, float], period: float, realisations: int, output: Output, random: Generator
) -> list[Tones]:
    """Odd lines of the band with random phases, the largest sum 1 V; the same lines in each realisation.

    Positions would swing widest at the lowest lines: these are made smaller there, below the band's middle.

    Raises:
        RespondError: The band holds fewer than four odd multiples of 1 / period.
    """
    orders = _lines(band, period, random)
    omega = 2.0 * np.pi * orders / period
    middle = 2.0 * np.pi * math.sqrt(band[0] * band[1])
    weights = omega / np.hypot(omega, middle) if output == "position" else np.ones(len(orders))
    return [_best_phases(orders / period, weights, period, random) for _ in range(realisations)]


def _lines(band: tuple[float, float], period: float, random: Generator) -> Array:
    first, last = math.ceil(band[0] * period - 1e-9), math.floor(band[1] * period + 1e-9)
    odd = np.arange(first + 1 - first % 2, last + 1, 2, dtype=np.float64)
    if len(odd) > MOST_TONES * _GROUP // (_GROUP - 1):
        spread = np.geomspace(odd[0], odd[-1], MOST_TONES * _GROUP // (_GROUP - 1))
        odd = np.unique(2.0 * np.floor(spread / 2.0) + 1.0)
    groups = range(_LOWEST, len(odd) - _GROUP + 1, _GROUP)
    left_out = [k + int(random.integers(_GROUP)) for k in groups]
    kept = np.delete(odd, left_out)
    if len(kept) < 4:
        what = f"{len(odd)} odd multiples of 1 / {period:g} s lie in {band[0]:g}:{band[1]:g} Hz"
        raise RespondError(f"{what}; a longer period (--period) has more")
    return np.asarray(kept)


def _best_phases(hertz: Array, weights: Array, period: float, random: Generator) -> Tones:
    def tones(phases: Array) -> Tones:
        return tuple(map(Tone, hertz.tolist(), weights.tolist(), phases.tolist()))

    def peak(some: Tones) -> float:
        return float(np.abs(_sum(some, period, None, "velocity")).max())

    tried = [tones(random.uniform(0.0, 2.0 * np.pi, len(hertz))) for _ in range(_PHASES)]
    best = min(tried, key=peak)
    most = peak(best)
    return tuple(tone._replace(amplitude=tone.amplitude / most) for tone in best)


def sines(band: tuple[float, float], count: int) -> list[Tones]:
    """Single tones of 1 V, spread over the band by octaves."""
    return [(Tone(hertz, 1.0, 0.0),) for hertz in np.geomspace(*band, count).tolist()]


def _sum(tones: Tones, period: float, plant: Plant | None, output: Output) -> Array:
    """One period of the tones, or of what the plant makes of them."""
    hertz, amplitude, phase = np.array(tones).T
    count = int(min(20_000, max(64, 16 * period * hertz.max())))
    size = amplitude * np.exp(1j * phase)
    if plant is not None:
        size = size * model(plant, 2.0 * np.pi * hertz, output)
    t = np.arange(count) * (period / count)
    return np.asarray((np.exp(2j * np.pi * np.outer(t, hertz)) @ size).imag)


def largest(tones: Tones, period: float, room: Room, K_L: float, plant: Plant | None) -> float:
    """Factor to the tones at which the first limit would be reached; `plant` as far as it is known."""
    known = plant or Plant(K_L * _UNKNOWN_PEAK, 1e6, 1.0)
    reached = {
        room.volts: _sum(tones, period, None, "velocity"),
        room.measured: _sum(tones, period, known, room.output),
        room.speed: _sum(tones, period, known, "velocity"),
    }
    return min(limit / float(np.abs(wave).max()) for limit, wave in reached.items())


def settling_time(plant: Plant | None, hold: float | None) -> float:
    """Time in which transients of the plant, and of the slow hold of its position [rad/s], go by [s]."""
    if plant is None:
        own = 0.5
    else:
        root = math.sqrt(max(0.0, plant.zeta**2 - 1.0))
        own = SETTLING / (plant.omega_n * (plant.zeta - root))
    return own + (0.0 if hold is None else SETTLING / hold)
