"""How much of what does not repeat acts on the load: gusts, a pump, a seal. The rest is the sensor's.

What acts on the load reaches the readings through the plant: its spectrum peaks where the plant does and
falls off beyond, faster than that of noise between plant and reading. Spectra of both kinds are added up so
that the sum is most likely (Whittle, Arkiv foer Matematik 2, 1953).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.stats import chi2

from seod.diagnose.result import OnLoad
from seod.diagnose.tuning.account import LOAD_NOISE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import Plant, WindowResidual
    from seod.diagnose.result import Array, Mask


class Bands(NamedTuple):
    """The spectrum of what is left, of its change from sample to sample where readings are a position.

    Attributes:
        omega: Mean frequency of a band [rad/s]; shape (b,), as the others.
        power: Mean of its periodogram [unit^2].
        bins: How many are in it.
        tick: Between samples [s].
        lowest: Of a window [rad/s].
    """

    omega: Array
    power: Array
    bins: Array
    tick: float
    lowest: float


def on_load(parts: Sequence[WindowResidual], plant: Plant) -> OnLoad | None:
    """The share of the squared error that acts on the load, and its 95 % interval.

    None where rows are too few, or noise is all above the frequencies of the plant.

    Args:
        parts: What a model leaves of windows, without what is systematic.
        plant: Of that model.
    """
    bands = _bands(parts, plant)
    if bands is None:
        return None
    shapes, loads = _shapes(bands, plant)
    sizes = np.array([_in_error(each, bands, plant) for each in shapes])
    best = _added(bands, shapes)
    most_cost = _cost(bands, best @ shapes) + 0.5 * float(chi2.ppf(LOAD_NOISE.surely, 1))
    share = _share(best, sizes, loads)
    ends = (_furthest(bands, shapes, sizes, one, loads, most_cost, best) for one in (loads, ~loads))
    least, most = ends
    return OnLoad(share, min(least, share), max(most, share))


def _bands(parts: Sequence[WindowResidual], plant: Plant) -> Bands | None:
    """Of windows at the first one's rate; None where they do not tell both sides of the plant's frequency."""
    ticks = [float(np.median(np.diff(one.t))) if len(one.t) > 1 else 0.0 for one in parts]
    own = [
        one
        for one, tick in zip(parts, ticks, strict=True)
        if math.isclose(tick, ticks[0], rel_tol=LOAD_NOISE.same_tick)
    ]
    long = [one for one in own if len(one.t) >= LOAD_NOISE.fewest_rows]
    if not long or not ticks[0] > 0.0:
        return None
    spectra = [_spectrum(one, ticks[0], plant) for one in long]
    omega, power = (np.concatenate(each) for each in zip(*spectra, strict=True))
    lowest, highest = float(np.min(omega)), float(np.max(omega))
    if not lowest < plant.omega_n < LOAD_NOISE.below * highest:
        return None
    band = np.floor(LOAD_NOISE.bands * np.log2(omega / lowest)).astype(int)
    rows = [_without_lines(omega[band == k], power[band == k]) for k in np.unique(band)]
    means = [(float(np.mean(w)), float(np.mean(p)), float(len(w))) for w, p in rows if np.any(p > 0.0)]
    if len(means) < LOAD_NOISE.bands:
        return None
    centres, powers, counts = (np.array(column) for column in zip(*means, strict=True))
    return Bands(centres, powers, counts, ticks[0], lowest)


def _spectrum(one: WindowResidual, tick: float, plant: Plant) -> tuple[Array, Array]:
    """Frequencies [rad/s] and periodogram of a window, tapered, but for its slowest bins."""
    known = np.flatnonzero(one.scored)
    error = np.interp(np.arange(len(one.t)), known, one.error[known])
    change = error - np.mean(error) if plant.sees_speed else np.diff(error)
    taper = np.hanning(len(change))
    power = np.abs(np.fft.rfft(taper * (change - np.mean(change)))) ** 2 / float(taper @ taper)
    omega = np.asarray(2.0 * math.pi * np.fft.rfftfreq(len(change), tick), np.float64)
    return omega[LOAD_NOISE.first_bin : -1], power[LOAD_NOISE.first_bin : -1]


def _without_lines(omega: Array, power: Array) -> tuple[Array, Array]:
    """Bins of a band but for those of a hum: of noise hardly one is so far above the median."""
    near = power <= LOAD_NOISE.line * max(float(np.median(power)), 1e-300)
    return omega[near], power[near]


def _shapes(bands: Bands, plant: Plant) -> tuple[Array, Mask]:
    """Spectra of kinds of noise at the bands, shape (k, b), and which of them act on the load."""
    omega, tick = bands.omega, bands.tick
    highest = math.pi / tick
    s = 1j * omega
    speed = (s + 2.0 * plant.zeta * plant.omega_n) / (
        s * s + 2.0 * plant.zeta * plant.omega_n * s + plant.omega_n**2
    )
    load = np.abs(speed) ** 2 * (1.0 if plant.sees_speed else tick**2)
    shapes = [load] + [load / (1.0 + (omega / (each * plant.omega_n)) ** 2) for each in LOAD_NOISE.gusts]
    of_load = len(shapes)
    change = np.ones_like(omega) if plant.sees_speed else np.abs(1.0 - np.exp(-s * tick)) ** 2
    corners = np.geomspace(bands.lowest, highest, LOAD_NOISE.colours)
    shapes += [change] + [change / np.abs(1.0 - np.exp(-(each + s) * tick)) ** 2 for each in corners]
    slow = np.geomspace(bands.lowest, max(LOAD_NOISE.slow * plant.omega_n, bands.lowest), 2)
    shapes += [change / (1.0 + (omega / each) ** 2) ** 2 for each in slow]
    every = np.array(shapes)
    return every / (every @ bands.bins)[:, None], np.arange(len(every)) < of_load


def _in_error(shape: Array, bands: Bands, plant: Plant) -> float:
    """Squared error of a reading by a spectrum of `_shapes`, but for a factor that is the same for all."""
    if plant.sees_speed:
        return float(shape @ bands.bins)
    return float((shape / np.abs(1.0 - np.exp(-1j * bands.omega * bands.tick)) ** 2) @ bands.bins)


def _cost(bands: Bands, total: Array) -> float:
    """Negative log likelihood of a spectrum; a taper makes neighbours alike."""
    return float((bands.power / total + np.log(total)) @ bands.bins) / LOAD_NOISE.alike


def _added(bands: Bands, shapes: Array, price: Array | None = None, begin: Array | None = None) -> Array:
    """Weights of spectra, shape (k,), none below 0, of the likeliest sum.

    Fisher's scoring, each step least squares. Half the square of what they cost by `price` is added.
    """
    rows, level = bands.bins / LOAD_NOISE.alike, float(bands.power @ bands.bins)
    extra = np.zeros(len(shapes)) if price is None else price
    floor = 1e-9 * level * np.max(shapes, axis=0)

    def cost(weights: Array) -> float:
        return _cost(bands, weights @ shapes + floor) + 0.5 * float(extra @ weights) ** 2

    weights = np.full(len(shapes), level / len(shapes)) if begin is None else begin
    for _ in range(LOAD_NOISE.rounds):
        scale = np.sqrt(rows) / (weights @ shapes + floor)
        try:
            better = nnls(np.vstack([(shapes * scale).T, extra]), np.r_[scale * bands.power, 0.0])[0]
        except RuntimeError:  # by rounding it goes round in circles
            break
        step, now, part = better - weights, cost(weights), 1.0
        while cost(weights + part * step) > now and part > LOAD_NOISE.shortest:
            part *= 0.5
        weights = weights + part * step
        if now - cost(weights) < LOAD_NOISE.enough:
            break
    return weights


def _share(weights: Array, sizes: Array, loads: Mask) -> float:
    every = weights * sizes
    return float(every[loads].sum() / every.sum())


def _furthest(
    bands: Bands, shapes: Array, sizes: Array, against: Mask, loads: Mask, most_cost: float, best: Array
) -> float:
    """The share of the load with as little of some spectra as is still likely enough."""
    price = np.where(against, sizes / float(best @ sizes), 0.0)
    share, low, high = _share(best, sizes, loads), *LOAD_NOISE.prices
    for _ in range(LOAD_NOISE.halvings):
        middle = math.sqrt(low * high)
        weights = _added(bands, shapes, middle * price, best)
        if _cost(bands, weights @ shapes) <= most_cost:
            share, low = _share(weights, sizes, loads), middle
        else:
            high = middle
    return share
