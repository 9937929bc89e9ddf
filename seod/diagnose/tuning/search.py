"""Numbers by which causes are searched and chosen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Beam:
    """Sets that are grown, one effect at a time."""

    width: int = 3
    """[sets] That are kept. Chosen."""
    second_plants: int = 2
    """[-] Second plants of them that are kept too. Chosen."""
    most_effects: int = 4
    """[effects] In a set that a search grows. Chosen."""
    least_gain: float = 0.02
    """[-] Mean log squared error that an effect must save. Measured: on clean recordings the best saves
    some 0.002."""
    least_gain_coarse: float = 1.0
    """[-] The same of a coarse sensor, whose noise is not known. Chosen."""
    as_well_part: float = 0.2
    """[-] Part of what an effect must save, up to which another set explains the recordings as well.
    Chosen."""
    richer_gain: float = 0.2
    """[-] Mean log squared error that a richer form (of friction, of a valve's lag, or a valve's map) must
    save to be grown in place of the plain one. Chosen."""


BEAM: Final = Beam()


@dataclass(frozen=True, slots=True)
class Budget:
    """How much a search may simulate."""

    search_s: float = 10.0
    """[s] Work that every search may use, after which no further cause is tried. Fits that follow have parts
    of it. Chosen: so that `normal` ends within 30 s for 60 s at 2 kHz on two idle cores. Measured: as far as
    11 s came before steps were exact at times (six records: 0.79 to 0.89 of the work)."""
    further_s: float = 10.0
    """[s] The same that one of few rows may use beyond, as what follows takes less there: the less, the more
    rows are searched. Chosen."""
    long_rows: int = 120_000
    """[rows] Searched, at which none of it would be left. Longer recordings than `BLOCKS.searched_rows` are
    searched in blocks of about so many rows, and have 4.7 s of it. Chosen: a minute at 2 kHz."""
    quick: float = 0.25
    """[-] Of that work at `--effort quick`. Chosen."""
    normal: float = 1.0
    """[-] At `normal`. Chosen."""
    thorough: float = math.inf
    """[-] At `thorough`: no end but the search's own. Chosen."""
    safety_s: float = 600.0
    """[s] By the clock, after which a search of limited effort ends in any case. Chosen: twenty times the
    usual."""
    trial_part: float = 0.04
    """[-] Part of it that a single trial may use: some wander off to plants that are slow to simulate.
    Chosen."""
    last_fit_part: float = 0.2
    """[-] Likewise of a fit to all windows that follows the search. Chosen."""
    drift_part: float = 1.4
    """[-] Likewise of asking whether a load drifts. Measured: eight fits of one run of 25 s at 1 kHz take
    half of it."""
    whole_recording_fits_part: float = 0.7
    """[-] Of it, and of what a short recording has beyond, what all fits of sets to whole recordings may use
    together. Chosen: as `search_s`. Measured: a minute at 2 kHz under gusts takes 29 s, with 0.9 33 s."""


BUDGET: Final = Budget()


@dataclass(frozen=True, slots=True)
class NoiseAlone:
    """Whether what is left is noise of any colour."""

    chance: float = 0.01
    """[-] Probability with which chance alone promises something of any cause. Chosen."""
    telling: float = 0.5
    """[-] Rows that have all of their past, or that rounding does not hide, over those that count, at least.
    Chosen."""
    much: float = 0.05
    """[-] NRMSE that is left, above which causes are tried whatever the past foretells of it. Chosen: a
    controller can be designed by less. What is named then still has to stand against noise of that colour."""
    most: float = 0.4
    """[-] Part of what is left that an effect makes up, from which on it may hide in the noise's memory.
    Chosen: of less what the past does not foretell tells more."""
    line_saves: float = 0.05
    """[-] Mean log squared error that the past no longer has to foretell without such a wave, at least.
    Measured: a line under a relay 0.15, gusts 0.03 at most."""
    line_alone: float = 0.8
    """[-] Part of what is left that such a wave makes up, from which on it is none of a noise. Measured: a
    line behind noise of long memory 0.92, where the past foretold the rest no better; gusts 0.4 at most."""
    by_noise: float = 1e-5
    """[-] Chance with which another effect makes up as much of noise, below which what is left is none.
    Measured: springs under a multisine 5e-7 at most, gusts 2e-4 at least."""
    noises: int = 64
    """[noises] Of which an effect may make up a part by chance. Chosen: mean and deviation, no quantile."""
    seed: int = 1
    """[-] From which they are drawn. Chosen."""


NOISE_ALONE: Final = NoiseAlone()


@dataclass(frozen=True, slots=True)
class FinalChoice:
    """Which set is the answer."""

    finalists: int = 3
    """[sets] That are fitted to all windows. Chosen."""
    near_best: float = 2.0
    """[-] Mean log squared error of a set above the best, over what an effect must save, up to which it is
    one of these. Chosen."""
    of_size: int = 2
    """[sets] Of each size that are fitted to whole recordings, where none comes down to the noise.
    Chosen."""
    climbed_causes: int = 8
    """[causes] That promise most, of which each is tried where recordings have few rows. Chosen."""
    misfit_gain: float = 0.2
    """[-] What an effect must save there, where any effect takes up a little of what is wrong. Chosen."""


FINAL_CHOICE: Final = FinalChoice()


@dataclass(frozen=True, slots=True)
class Prune:
    """Effects that leave the set again."""

    least_share: float = 5e-4
    """[-] Of the baseline's squared error above the noise that has to come back without an effect: less
    is 0 %. Chosen."""
    surely: float = 1.0
    """[-] Mean log squared error that an effect saves, from which on its size is not none, whatever its
    interval says: that takes the curve between its size and none for straight. Chosen."""
    by_chance: float = 0.01
    """[-] p-value of a gain in windows held out, above which it may be none. Chosen: the usual stricter one.
    Measured: of 505 causes rightly named the largest is 0.0007, of 218 others ten are above."""
    much_by_chance: float = 0.5
    """[-] The same of an effect that saves `surely`: a valve's limit acts in few windows, a dry friction in
    some more than in others. Measured: 0.08 and 0.02; of 793 causes rightly named the largest is 0.19."""
    foretold: float = 1.0
    """[-] Mean log squared error of windows held out that a cause saves, from which on it stays though fitted
    windows hardly show it: the error falls by 40 %. Chosen; 3.0 where a valve's limit acts in few windows."""
    beside_slow_offset: float = 0.25
    """[-] Of the log squared error that an effect saves, the least that it saves beside an offset of the
    sensor that moves slowly. Measured: 0.003 where a wave or a null stood for one, 0.9 of a hysteresis."""
    most_offset: float = 0.05
    """[-] NRMSE of windows up to which a sensor's zero that moves slowly is looked for in it. Chosen: a
    twentieth of the movement; what moves farther is the load. Measured: a constant load left 0.23."""
    far_off: float = 2.0
    """[-] NRMSE of one run of the whole recordings, over that of windows, beyond which it says nothing of an
    effect. Chosen: drift of a plant that integrates, or what has no name."""
    part_in_one_run: float = 0.25
    """[-] Of the log NRMSE that an effect saves in windows, what it has to save in one run. Measured: 0.07
    where a spring stood for an offset that moves, 0.77 and more of 29 causes that were there."""


PRUNE: Final = Prune()


@dataclass(frozen=True, slots=True)
class Race:
    """All causes of all parents, tried in stages."""

    glances_part: float = 0.6
    """[-] Of the work that is available when a race begins, what its glances may use. Chosen."""
    glanced_together: int = 8
    """[-] Glances between two looks at the budget: enough for all cores, few enough to end in time.
    Chosen."""
    first_tried: int = 12
    """[starts] Whose promise is believed before others are tried. Chosen."""
    starts_of_a_cause: int = 2
    """[starts] Of each parent's every cause, those that promise most. Measured: in all of 16 races the best
    set began at the first of them."""
    glance_steps: int = 2
    """[steps] From every start. Chosen."""
    remote_steps: int = 12
    """[steps] From one whose K_L and zeta are far from the baseline's. Chosen."""
    glance_part: float = 0.015
    """[-] Of the search's work that a glance or a look may use: some plants are slow to simulate. Chosen."""
    look_steps: int = 3
    """[steps] Further ones of the better causes. Chosen."""
    whole_steps: int = 4
    """[steps] Of the promising ones on all windows for trying. Chosen."""
    last_steps: int = 12
    """[steps] Further ones of the best. Chosen: twenty more gained little, and once a wrong set went
    ahead."""
    causes_looked_at: int = 9
    """[causes] Of a parent that are looked at. Chosen."""
    longest_wave: float = 1.02
    """[-] Numbers of a wave over the travel, over the least, up to which the least has stopped it.
    Chosen."""
    causes_on_all: int = 5
    """[causes] Of a parent that are fitted to all windows for trying. Chosen."""
    finished_at_least: int = 4
    """[sets] That are fitted to the end. Chosen."""
    finished_within: float = 1.0
    """[-] Others whose mean log squared error is that near the best are, too. Chosen."""


RACE: Final = Race()


@dataclass(frozen=True, slots=True)
class Refine:
    """Last fits of a set."""

    steps_elsewhere: int = 8
    """[steps] Of a fit from each other plant of the grid. Chosen."""
    uneven_errors: float = 1.4
    """[-] Squared error of a window over another's from which on they are not fitted alike. Chosen."""
    fewest_samples: int = 50
    """[rows] Of a segment whose other rows are held out: with fewer its initial state is all that they
    show. Chosen."""
    fine_steps: int = 40
    """[steps] Of a fit along a bent valley. Chosen."""
    fine_improvement: float = 1e-6
    """[-] Of the mean log squared error, below which such a fit has settled. Chosen: there steps gain little
    and lead far."""


REFINE: Final = Refine()


@dataclass(frozen=True, slots=True)
class Screen:
    """Windows on which causes are tried."""

    probed_s: float = 3.0
    """[s] On which every start is tried. Chosen."""
    screened_s: float = 6.0
    """[s] On which the better causes are fitted. Chosen."""
    grid_sets: int = 4
    """[sets] Of the grid, that times of switches are asked with. Chosen: each takes some seconds."""


SCREEN: Final = Screen()


@dataclass(frozen=True, slots=True)
class WholeRecordings:
    """Sets that are fitted to whole recordings."""

    fitted_causes: int = 3
    """[causes] That are fitted, of those that promise most. Chosen."""
    finished_causes: int = 2
    """[causes] Of them, and of those from far, that are fitted to the end. Chosen."""
    least_saving: float = 0.2
    """[-] Mean log squared error that one more effect has to save. Chosen."""
    most_effects: int = 5
    """[effects] In a set of few rows that grows by what errs less where no fit has seen. Chosen: one more
    than a search may find, so that the largest of its sets can grow, too."""


WHOLE_RECORDINGS: Final = WholeRecordings()
