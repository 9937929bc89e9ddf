"""Numbers by which it is said what was found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Answer:
    """What is said of the residual."""

    outlier_beyond: float = 4.0
    """[sd] Of the noise, beyond which a sample is an outlier, where there are any. Chosen."""
    most_outliers: float = 0.03
    """[-] Part of the samples that are. Chosen."""
    mostly_constant: float = 0.5
    """[-] Part of a run's squared error that is one offset, from which on that is said. Chosen."""
    saved_alone: float = 1.0
    """[-] Mean log squared error that a cause saves of windows fitted, above which Eq. 1 is not called right,
    though none is named. Chosen: a factor of e. Measured: a hardening spring under a sweep 1.5, gusts 0.3."""
    other_plant: float = 0.02
    """[-] Part by which K_L, omega_n or zeta of a held-out recording differs, from which on that is said.
    Chosen: less matters to no controller."""
    other_plant_sds: float = 4.0
    """[sd] Of both together that it differs by, at least. Chosen: runs of one rig differ by two or three."""


ANSWER: Final = Answer()


@dataclass(frozen=True, slots=True)
class Bootstrap:
    """How sure a held-out error is, by drawing blocks of the windows."""

    draws: int = 2000
    """[-] Of so many blocks as there are. Chosen: the share of draws beyond an end is then known to a
    deviation of 0.35 %."""
    fewest_blocks: int = 20
    """[blocks] To draw from, at least; windows are divided where there are fewer. Chosen."""
    quantiles: tuple[float, float] = (0.025, 0.975)
    """[-] Ends of the interval. The contract's: 95 %."""
    seed: int = 1
    """[-] Of the draws, so that an answer is the same again. Chosen."""


BOOTSTRAP: Final = Bootstrap()


@dataclass(frozen=True, slots=True)
class ExperimentTrial:
    """A next experiment, simulated."""

    periods: float = 25.0
    """[periods] Of omega_n, that it lasts at least. Chosen."""
    lasts_s: tuple[float, ...] = (1.5, 5.0)
    """[s] Within which it lasts. Chosen."""
    fewest_periods: float = 3.0
    """[periods] Of a slow plant, that it lasts in any case, if need be with fewer samples a second.
    Chosen."""
    most_samples: int = 6000
    """[rows] Of it. Chosen."""
    tries: int = 10
    """[-] Amplitudes until the travel is that of the recording. Chosen."""
    cycles: float = 3.0
    """[periods] Of a limit cycle in each of two phases. Chosen: the configuration's own default."""
    shift: float = 0.25
    """[periods] By which switches of the second are late. Chosen: likewise."""
    gone: float = 1e6
    """[sd] Error of what is no number any more. Chosen: far more than any rival's."""
    derivative_step: float = 1e-4
    """[-] Part of a searched number by which a rival's derivatives are taken. Chosen."""


TRIAL: Final = ExperimentTrial()


@dataclass(frozen=True, slots=True)
class FoundEffects:
    """What could stand in a found effect's place."""

    near: float = 2.0
    """[-] Mean log squared error of a set with another cause above that of the found one, over what an
    effect must save, up to which it is fitted to all windows. Chosen."""
    surely_worse: float = 0.05
    """[-] Chance by which windows held out would foretell a set with another cause as much less well, below
    which it is worse. Chosen: as usual."""
    repeated: float = 2.0
    """[waves] Over the travel, below which nothing shows that a wave repeats. Chosen."""


FOUND_EFFECTS: Final = FoundEffects()


@dataclass(frozen=True, slots=True)
class NextExperiment:
    """Which experiment separates causes."""

    misses_by: float = 1.0
    """[-] Times the noise by which the rival must miss, once it is fitted: its squared error is then
    doubled. Chosen."""
    pressure_differs: float = 0.03
    """[-] Part of the load pressure's deviation by which the models must differ for it to be worth a
    sensor. Chosen."""
    rivals_tried: int = 3
    """[-] Rivals that are tried. Chosen."""
    starts_tried: int = 2
    """[-] Places from which a rival's fit begins. Chosen."""
    band: tuple[float, float] = (0.1, 3.0)
    """[-] Frequencies that are asked for over the plant's own, from and to. Chosen."""
    highest: float = 0.4
    """[-] Over the sampling rate, at most. Chosen: below half of it."""
    steps: float = 0.3
    """[-] Pairs of steps in a period of the plant's own. Chosen: it comes to rest between them."""
    relay: tuple[float, ...] = (0.25, 0.5, 1.0)
    """[-] A relay's amplitudes one after the other, over the recordings' largest command. Chosen: causes of
    different amplitude dependence come apart."""
    sine: tuple[float, ...] = (0.125, 1.0)
    """[-] A sine's. Chosen: friction shows in the small one."""
    multisine: tuple[float, ...] = (0.25, 1.0)
    """[-] A multisine's. Chosen."""


NEXT_EXPERIMENT: Final = NextExperiment()


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What remains, and what it goes with."""

    negligible: float = 2e-4
    """[-] Part of the squared error that is as good as explained: starts fitted to short windows leave
    some. Chosen."""
    named_share: float = 0.08
    """[-] Of the rest that a smooth function has to explain, to be named. Chosen."""
    bins: int = 16
    """[bins] Of that function. Chosen."""


UNEXPLAINED: Final = Unexplained()


@dataclass(frozen=True, slots=True)
class Pipeline:
    """Recordings that are refused, and what is told while they are searched."""

    mostly_noise: float = 0.7
    """[-] NRMSE of noise alone from which on nothing can be identified. Chosen."""
    searched_again: float = 0.8
    """[-] Of all work, that is told while causes are searched with other commands. Chosen."""


PIPELINE: Final = Pipeline()
