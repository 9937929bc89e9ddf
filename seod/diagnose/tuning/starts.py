"""Numbers by which fits begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np


@dataclass(frozen=True, slots=True)
class Baseline:
    """The grid from which Eq. 1 is fitted."""

    dampings: tuple[float, ...] = (0.02, 0.1, 0.4, 1.2, 5.0)
    """[-] zeta. Chosen."""
    frequencies: int = 14
    """[-] Frequencies of it. Chosen."""
    fastest_ticks: float = 0.5
    """[rad] Its largest omega_n times the sampling interval: 13 samples a period. Chosen."""
    least_range: float = 2.0
    """[-] Its largest omega_n over its least, at least. Chosen."""
    fit_steps: int = 20
    """[steps] Of a fit from a point of it, with a load bias or without. Chosen: nothing is known yet."""
    lowest_frequency: float = 0.3
    """[-] Searched frequency over the dominant one, at least; half a period is in each window, too.
    Chosen."""
    kept_points: int = 3
    """[points] Of the grid, from which the search goes on. Chosen."""
    windows_s: float = 3.0
    """[s] Of windows in which the grid is searched. Chosen."""
    whole_rows: int = 30_000
    """[rows] Of whole recordings in which it is searched, at most. Chosen: a quarter of a minute at 2 kHz,
    where all rows took a quarter of the time of a diagnosis that finds nothing."""
    above_limit_cycle: float = 1.2
    """[-] omega_n over the limit cycle's, which delay and backlash make slower. Chosen."""
    limit_cycle_damping: float = 0.3
    """[-] zeta of that plant. Chosen."""
    slowest_plant: float = 2.0
    """[rad/s] omega_n that is searched at least, while neither movement nor samples are slow. Chosen."""
    slow_movement: float = 0.5
    """[-] Dominant frequency over that, up to which a movement is slow; then `lowest_frequency` holds.
    Chosen."""
    slowest_ticks: float = 2e-3
    """[rad] omega_n times the sampling interval, at most: at 1 kHz and above `slowest_plant` holds.
    Chosen."""
    undamped: float = 0.02
    """[-] zeta of the best plant up to which one that is damped is fitted, too. Chosen: the grid's least."""
    damped: float = 0.4
    """[-] zeta from which on a point of the grid is damped. Chosen."""
    short_segment_s: float = 0.25
    """[s] Least length of the short segments. Chosen."""
    short_segment_rows: int = 100
    """[rows] Likewise. Chosen."""


BASELINE: Final = Baseline()


@dataclass(frozen=True, slots=True)
class EffectStarts:
    """Where effects begin."""

    wave_size: float = 0.1
    """[-] Amplitude with which a wave begins, over the size in whose steps it is searched. Chosen: small, a
    first step finds the right one."""
    settling_steps: int = 2
    """[steps] Of the initial states of a parent whose residual's lines are looked for. Chosen."""
    little_damped: float = 0.3
    """[-] zeta below which a plant's own oscillation may be a disturbance. Chosen."""
    other_plant: float = 0.3
    """[-] Difference of the logarithm of omega_n or zeta from which on plants are others. Chosen: a
    third."""


EFFECT_STARTS: Final = EffectStarts()


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a residual's spectrum, where waves begin."""

    tried: int = 3
    """[-] Largest lines that are tried. Chosen."""
    bins: int = 2048
    """[bins] Of readings over the place. Chosen."""
    finer: int = 4
    """[-] Points of the spectrum over those of an unpadded one. Chosen."""
    width: int = 3
    """[-] Points of an unpadded one, either way, that belong to a line: no other is looked for there.
    Chosen: beyond its main lobe."""


LINES: Final = Lines()


@dataclass(frozen=True, slots=True)
class RelayCompare:
    """How a plant of the relay's grid is compared, and steps from it."""

    cycles_before: float = 12.0
    """[periods] Limit cycles from rest until a plant is compared. Chosen."""
    parts: int = 3
    """[-] Of the recording in which it is. Chosen."""
    cycles_a_part: float = 5.0
    """[periods] Limit cycles in each. Chosen."""
    fewest_samples: int = 20
    """[rows] In each. Chosen."""
    rest_in_gap: float = 0.5
    """[-] Place in its gap where the load begins, from a flank, over the gap. Chosen."""
    delays: tuple[float, ...] = (0.025, 0.05, 0.075, 0.1, 0.15)
    """[periods] Delays, of the limit cycle. Chosen."""
    ramps: tuple[float, ...] = tuple(np.geomspace(0.06, 0.48, 16).tolist())
    """[periods] How long a valve's ramps last, of the limit cycle. Chosen."""
    least_gain: float = 1e-3
    """[-] Share of the squares that a step gains, at least. Chosen."""
    derivative_step: float = 1e-3
    """[-] Differences of derivatives. Chosen."""
    most_simulations: int = 160
    """[-] Of the steps from a plant. Chosen."""
    not_simulated: float = 10.0
    """[-] Error of a plant that cannot be simulated, over the recording. Chosen."""
    ranges: tuple[tuple[float, ...], ...] = ((0.1, 30.0), (0.01, 20.0), (1e-3, 0.3))
    """[-] Of omega_n over the limit cycle's frequency, zeta, and delay over its period. Chosen."""
    longest_ramp: float = 0.5
    """[periods] A ramp's length, at most, in the delay's place. Chosen."""
    share_range: tuple[float, ...] = (0.01, 0.995)
    """[-] Of shares. Chosen."""
    strongest_disturbance: float = 1e5
    """[unit/s^2] Acceleration by which a plant is tried, at most. Chosen."""


COMPARE: Final = RelayCompare()


@dataclass(frozen=True, slots=True)
class RelayGrid:
    """Plants that may make a relay's limit cycle."""

    frequencies: tuple[float, ...] = (*np.geomspace(0.8, 5.0, 14).tolist(), 7.0, 10.0)
    """[-] omega_n over the limit cycle's frequency. Chosen."""
    frequencies_disturbed: tuple[float, ...] = tuple(np.geomspace(0.4, 5.0, 18).tolist())
    """[-] The same of a plant that a disturbance shakes. Chosen."""
    dampings: tuple[float, ...] = (0.05, 0.15, 0.3, 0.6, 1.2, 4.0)
    """[-] zeta. Chosen."""
    frequencies_ramped: tuple[float, ...] = tuple(np.geomspace(0.4, 8.0, 16).tolist())
    """[-] The same of a plant behind a slow valve, which makes the cycle slow. Chosen."""
    other_ramp: float = 0.2
    """[-] Logarithm of their ramps' times by which such plants differ, at least. Chosen."""
    kept_ramps: int = 3
    """[plants] Of those, that are kept. Chosen."""
    growth_compared_within: float = 3.0
    """[-] Mean log squared error over the least, up to which a plant goes on with how the limit cycle
    grew. Chosen."""
    kept_prompt: int = 4
    """[plants] Without a delay that are kept, of different damping. Chosen."""
    kept_late: int = 2
    """[plants] With one, likewise. Chosen."""
    settled_richer: int = 2
    """[plants] With a plain form that settle with each richer one that acts beside it. Chosen."""


GRID: Final = RelayGrid()


@dataclass(frozen=True, slots=True)
class RelayPlant:
    """A plant of the grid."""

    slight_delay: float = 0.05
    """[rad] Delay times omega_n, up to which a plant may stand for one without. Chosen."""


PLANT: Final = RelayPlant()


@dataclass(frozen=True, slots=True)
class SearchRoots:
    """Plants from which the search begins."""

    different_plant: float = 0.2
    """[-] Part of a plant's residual by which another must differ there, to be a start of its own.
    Chosen."""
    far_from_noise: float = 3.0
    """[-] Squared error of plants over the noise's, from which on one with a load is tried. Chosen."""
    hidden: float = 0.5
    """[-] NRMSE with an offset and a delay over the baseline's, up to which they hid the plant. Chosen."""
    shows_no_sign: float = 0.3
    """[-] Mean log squared error that the baseline behind a sensor without sign saves, to be a start: many a
    position begins at 0 and never goes below. Chosen: a quarter of the squares."""
    over_damped: float = 2.0
    """[-] zeta of Eq. 1 with a load from which on a plant that oscillates is a start, too. Chosen: the slower
    of its rates is a fourteenth of the other."""
    hardly_damped: float = 0.02
    """[-] zeta down to which that one may be: less is that of a plant which is none. Chosen."""
    pulled_back: int = 2
    """[plants] Of a load that is pulled back, by segments of several lengths, that are fitted. Chosen."""
    shortest_rows: int = 25
    """[rows] Of such segments, at least. Chosen: five unknowns and a parabola of each."""
    load_saves: float = 1.0
    """[-] Mean log squared error that Eq. 1 with a load saves, for plants without to be none. Chosen: a
    factor of e."""


SEARCH_ROOTS: Final = SearchRoots()


@dataclass(frozen=True, slots=True)
class RampGrid:
    """Speeds of a valve behind which plants are looked for."""

    lost: float = 0.5
    """[-] Part of the command's deviation that the quickest of them loses. Chosen: of 18 records with such a
    valve seven were missed, all with 0.83 to 1.12; all seven that lost less were found."""
    halvings: int = 12
    """[-] Of the range in which that speed is found. Chosen: to a thousandth of its logarithm."""
    step: float = 1.25
    """[-] From one speed to the next. Measured: of binary noise a plant behind one 1.26 times as fast left
    1.4 to 1.9 times the error."""
    speeds: int = 13
    """[-] So many: down to a fifteenth of the quickest. Chosen: the seven were as slow as a twelfth."""


RAMP_GRID: Final = RampGrid()


@dataclass(frozen=True, slots=True)
class FrictionGrid:
    """Levels of dry friction behind which plants are looked for."""

    levels: tuple[float, ...] = (0.1, 0.15, 0.23, 0.35, 0.5, 0.75, 1.1, 1.7, 2.5)
    """[-] Over K_L omega_n times the command's deviation. Measured: of seven levels from 0.2 to 3 six fits of
    six came to the plant of a load that mostly stands."""


FRICTION_GRID: Final = FrictionGrid()


@dataclass(frozen=True, slots=True)
class HiddenPlants:
    """Plants that are looked for behind a cause."""

    rows: int = 4000
    """[rows] In which they are looked for, at most. Measured: five of seven slow valves are found, as in
    all."""
    kept: int = 2
    """[plants] Behind different sizes that are fitted, the best of the grid. Chosen."""


HIDDEN_PLANTS: Final = HiddenPlants()


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of a movement, which make numbers without a unit."""

    least: float = 1e-30
    """[any] Of speed, pressure, travel and oscillation: of a load that stands still they are 0. Chosen."""
    outliers_of_travel: float = 1e-3
    """[-] Part of the samples at each end of the travel that do not count: outliers. Chosen."""
    usual_pressures: float = 0.95
    """[-] Part of the load pressures that are at most the size of it. Chosen: it is seldom exceeded."""
    warmer: float = 0.5
    """[K] Range of the temperature above which it changes. Chosen."""
    pressed: float = 0.02
    """[-] Range of the supply pressure over the nominal one, above which it changes. Chosen."""
    few_moves: int = 3
    """[-] Movements between reversals up to which the travel stands for them. Chosen."""


SIZES: Final = Sizes()


@dataclass(frozen=True, slots=True)
class Unsigned:
    """A sensor that reads without a sign."""

    outliers: float = 1e-3
    """[-] Part of the readings below the one that counts as the least. Chosen."""
    below: float = 5.0
    """[sd] Of the noise, below the least reading that any may be; beside a part of y's range. Chosen."""
    below_part: float = 0.05
    """[-] That part. Chosen."""
    near_zero: float = 0.1
    """[-] Part of the range of y within which the least reading is, of a sensor that was at 0. Chosen."""
    frequencies: int = 12
    """[-] Frequencies of the grid. Chosen."""
    slowest: float = 4.0
    """[-] Its least omega_n, over half a period in the shortest recording. Chosen: two periods."""
    fastest: float = 8.0
    """[-] Its largest, likewise, at least. Chosen: twice the least."""
    fastest_ticks: float = 0.6
    """[rad] Its largest times the sampling interval. Chosen: a tenth of the sampling rate."""
    dampings: tuple[float, ...] = (0.2, 0.7, 2.0, 6.0)
    """[-] zeta of the grid. Chosen."""
    places: int = 24
    """[-] Gains of a position that are tried. Chosen."""
    gains: tuple[float, float] = (0.4, 4.0)
    """[-] From the least of them to the largest, over the one whose range is that of the readings. Chosen: a
    decade; readings without a sign have down to half the range."""
    upright: float = 1.2
    """[-] Squared error of a negative gain over that of a positive one, from which on it counts as less.
    Chosen."""
    kept: int = 2
    """[plants] From which readings are given a sign. Chosen."""
    root_steps: int = 40
    """[steps] Of a fit of the baseline with such a sensor to whole recordings, from each of these. Chosen: it
    is where the search begins."""
    signed_again: int = 3
    """[-] Times that readings are given the sign of the plant that was fitted to them. Chosen."""
    signed_steps: int = 8
    """[steps] Of each of those fits. Chosen."""


UNSIGNED: Final = Unsigned()
