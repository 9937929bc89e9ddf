"""Numbers by which residuals are judged: what is systematic, and what repeats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Account:
    """Shares of the baseline's error."""

    lost: float = 1e3
    """[-] NRMSE from which on a model has run away: of its residual nothing can be said. Chosen."""


ACCOUNT: Final = Account()


@dataclass(frozen=True, slots=True)
class Halves:
    """Whether windows that were fitted and windows held out show the same."""

    shows_more: float = 2.0
    """[-] Squared error over the noise's from which on windows show something, where those of the other half
    are down to it. Measured: of 59 records with a right answer the worst fitted window had 1.29."""
    errs_more: float = 3.0
    """[-] Squared error of windows held out over that of windows fitted, as the load moves equally fast, from
    which on it is not noise alone. Measured: of 60 hidden records with a right answer at most 2.44, of four
    in servo loops in which more than noise is left 3.8 to 77."""
    chance: float = 2e-5
    """[-] Probability with which noise may pass it. Chosen; of those four at most 1e-5, of gusts 1e-4."""
    slow_bends: int = 2
    """[-] Degree of what an offset that moves slowly does in a window. Chosen: windows are a quarter of the
    recording at most, which has four half-waves."""


HALVES: Final = Halves()


@dataclass(frozen=True, slots=True)
class BlackBox:
    """Functions of the states that may explain a residual."""

    ridges: tuple[float, ...] = (1e-6, 1e-4, 1e-2, 1.0)
    """[-] Penalties that are tried, over the mean square of a column. Chosen."""
    horizons: float = 2.0
    """[-] Times ahead in a part whose errors are compared, at least: shorter ones would not be independent.
    Chosen."""
    alike: float = 5.0
    """[-] Correlation times of what is left in a fold of a sweep's window, at least: what is alike in it and
    beside it would foretell itself. Chosen."""
    most_folds: int = 16
    """[folds] Of such a window, at most. Chosen."""
    sharp: float = 0.05
    """[-] Part of the largest speed or command at which its sign is taken for a step. Chosen."""
    waves: int = 4
    """[-] Half waves over the travel. Chosen."""
    hinges: tuple[float, ...] = (0.25, 0.5, 0.75)
    """[-] Parts of the largest command, and pressure, from which on a further slope is tried. Chosen."""
    lags: tuple[float, ...] = (0.5, 1.0, 2.0)
    """[rad] Earlier commands, times omega_n. Chosen."""
    stribeck: float = 0.2
    """[-] Part of the largest speed at which a friction that falls with speed has fallen to 37 %. Chosen:
    four times `sharp`."""
    unlisted_wave: float = 2.7
    """[-] Half waves over the travel, of a force that is added to see whether it is shown. Chosen: none of
    the `waves`."""
    unlisted_limit: float = 0.4
    """[-] Part of the largest command at which it is likewise cut off. Chosen: none of the `hinges`."""
    added: tuple[float, ...] = (1.0 / 64.0, 1.0 / 16.0, 0.25, 1.0)
    """[-] Mean squares of systematic parts that are added to see whether they are shown, over that of what is
    left. Chosen."""
    noises: int = 32
    """[noises] Of the colour of what is left, foretold to see what chance shows. Chosen."""
    mostly: float = 0.75
    """[-] Of the parts added, with either sign, that have to be shown. Chosen."""


BLACK_BOX: Final = BlackBox()


@dataclass(frozen=True, slots=True)
class WithMovement:
    """Whether what is left is larger where the load moves more."""

    fewest: int = 16
    """[periods] That are compared, at least. Chosen."""
    resting: float = 0.25
    """[-] Part of the periods, those with the least movement, whose error is taken for noise. Chosen."""


WITH_MOVEMENT: Final = WithMovement()


@dataclass(frozen=True, slots=True)
class Grade:
    """What a model is good for."""

    design_error: float = 0.05
    """[-] Held-out NRMSE up to which a controller can be designed by a model. Chosen: as a loop gain off
    by 5 %."""
    design_systematic: float = 0.02
    """[-] Of it systematic, at most: what a controller would meet each time. Chosen."""
    untold: float = 0.05
    """[-] NRMSE of what is left up to which it may be called noise where nothing would have been shown.
    Chosen: as `design_error`. Measured: of 377 records none that was right has more left then."""
    told: float = 0.5
    """[-] NRMSE of a systematic part that would have been shown, over all that is left, at most, for the rest
    to be called noise. Chosen: noise is then three quarters of the squared rest at least."""


GRADE: Final = Grade()


@dataclass(frozen=True, slots=True)
class Systematic:
    """Whether a residual is systematic."""

    chance: float = 0.002
    """[-] Probability with which chance alone passes for something systematic; three ways are asked.
    Chosen."""
    chance_in_loop: float = 1e-4
    """[-] Likewise for a black box where a loop is closed: commands answer to the recording's noise, not to
    noises that are drawn to know what chance shows. Chosen."""
    chance_alone: float = 0.05
    """[-] Likewise for ARX and NARX where the other ways would have shown nothing. Chosen: the usual one.
    Measured: three of 377 records are asked so, of which none is rightly `effects` or `clean`."""
    segments: int = 24
    """[segments] Of all windows whose squared errors are compared, if they are long enough. Chosen."""


SYSTEMATIC: Final = Systematic()


@dataclass(frozen=True, slots=True)
class LoadNoise:
    """How much of what does not repeat acts on the load, by its spectrum."""

    fewest_rows: int = 64
    """[rows] Of a window. Chosen."""
    same_tick: float = 0.01
    """[-] By which ticks of recordings may differ, to be taken together. Chosen."""
    first_bin: int = 1
    """[bins] Below which there is only the mean. Chosen."""
    bands: int = 12
    """[bands] In an octave, and at least in all. Chosen: a third of the peak of zeta 0.1."""
    below: float = 0.5
    """[-] Natural frequency over the highest that is sampled, at most: the fall beyond has to
    show. Chosen."""
    line: float = 20.0
    """[-] Of a band's median, above which a bin is a hum's. Chosen: of noise one in a million is."""
    gusts: tuple[float, ...] = (25.6, 12.8, 6.4, 3.2, 1.6, 0.8, 0.4, 0.2, 0.1)
    """[-] Corner frequencies of what acts on the load, over the natural one; white, too. Measured: with three
    in place of nine, intervals of speeds held 80 % of the shares, in place of 90."""
    colours: int = 24
    """[-] Corner frequencies of the sensor's noise, from a window's to the highest. Chosen."""
    slow: float = 0.1
    """[-] Of the natural frequency, up to which a sensor's offset may move smoothly. Chosen."""
    rounds: int = 30
    """[steps] Of scoring, at most. Chosen."""
    enough: float = 1e-3
    """[-] Log likelihood that a step gains, below which it is the last. Chosen."""
    shortest: float = 0.01
    """[-] Part of a step. Chosen."""
    alike: float = 1.94
    """[bins] That count as one: 35/18, of a Hann taper. Chosen."""
    surely: float = 0.95
    """[-] Of an interval. The contract's."""
    prices: tuple[float, float] = (1e-1, 1e4)
    """[-] Root of the log likelihood that all of the load's noise, or the sensor's, costs, from and
    to. Chosen."""
    halvings: int = 12
    """[-] Of that range, for an end of the interval. Chosen."""


LOAD_NOISE: Final = LoadNoise()


@dataclass(frozen=True, slots=True)
class Prediction:
    """Fits by what noise that remembers does not foretell."""

    rounds: int = 3
    """[rounds] Of noise by a fit and a fit by the noise. Measured: of three simulated relays under gusts two
    more change numbers by 0.2 standard deviations at most, one less by up to 4."""
    noise_orders: tuple[int, ...] = (8, 24, 48, 96)
    """[rows] Of readings and commands by which the next reading is foretold. Measured: of three relays under
    gusts numbers come out alike from 8 on, within 5 %."""
    rows_each: int = 10
    """[rows] For each of their weights, at least. Chosen."""
    likelier: float = 10.0
    """[-] Log likelihood that a cause saves which saved much by simulations, or it is none. Chosen. Measured:
    at most 4 under gusts, 76 of a relief valve in a loop."""
    sure_gain: float = 5.0
    """[standard deviations] K_L of a load that commands move. Chosen: hardly ever chance."""
    command_order: int = 8
    """[rows] Of commands by which the next one is foretold. Chosen: as of noise, at most."""
    lags: int = 20
    """[rows] Between a reading and a command that may answer to it. Chosen."""
    as_far: float = 1.2
    """[-] Error of its simulation where no fit has seen, over that of a fit of the simulation, at most: both
    come to the plant where noise alone is left. Measured: 1.00 to 1.05 under gusts, 1.11 and 1.10 where these
    make 14 and 45 % of the movement."""
    given_up: float = 2.5
    """[-] The same over that of the set that was chosen, at most: effects that only a loop made may go.
    Measured: 1.0 to 2.0 under gusts, over 5 where friction was real (a positioning drive whose sensor has
    next to no noise)."""


PREDICTION: Final = Prediction()


@dataclass(frozen=True, slots=True)
class Repeats:
    """What repeats from period to period."""

    most_bins: int = 512
    """[bins] Of a period. Chosen."""
    fewest_bins: int = 8
    """[bins] Likewise. Chosen."""
    fewest_windows: int = 3
    """[windows] That are compared with each other, at least. Chosen."""
    fewest_rows: int = 8
    """[rows] Of a window, for a parabola to be taken off. Chosen."""


REPEATS: Final = Repeats()


@dataclass(frozen=True, slots=True)
class Yardstick:
    """ARX and NARX beside the model."""

    orders: tuple[int, ...] = (2, 3, 4)
    """[-] Of the ARX: Eq. 1 has two or three, a lag or a delay adds one. Chosen."""
    rows_each: int = 4
    """[rows] For each of its weights, at least. Chosen."""
    rates: tuple[float, ...] = (16.0, 48.0, 144.0)
    """[rows] In a dominant period. Chosen."""
    ridges: tuple[float, ...] = (1e-6, 1e-3, 0.1)
    """[-] Penalties of the NARX that are tried, over the mean square of a column. Chosen."""
    fewest: int = 8
    """[rows] Of a window, for it to be simulated. Chosen."""
    sharp: float = 0.05
    """[-] Part of the largest change at which its sign is taken for a step. Chosen."""
    gone_beyond: float = 10.0
    """[ranges] Of the record beyond which a simulation has run away. Chosen."""
    unstable: float = 1e-6
    """[-] Size of a pole above 1 from which on an ARX is none: rounding of one that integrates. Chosen."""


YARDSTICK: Final = Yardstick()


@dataclass(frozen=True, slots=True)
class Scheduled:
    """An ARX whose weights change with the state."""

    knots: tuple[int, ...] = (2, 5)
    """[-] Values of the state between which weights run straight. Chosen."""
    rates: tuple[float, ...] = (144.0, 432.0)
    """[rows] In a dominant period. Measured: a pressure that is relieved, in windows of half a period, was
    simulated to 11 % with 144 and to 5 % with 432."""
    folds: int = 6
    """[-] Each simulated by fits of the others. Chosen."""
    fewest_rows: int = 48
    """[rows] Of a part that is simulated. Chosen: a third of a dominant period."""
    most_rows: int = 512
    """[rows] Likewise. Chosen: parts are simulated side by side, each step for all."""
    rows: int = 30_000
    """[rows] Of all windows; of more, windows are left out evenly. Chosen: a hundred for each weight."""
    begin: float = 0.2
    """[-] Of a part, in which it settles. Chosen: as of windows."""


SCHEDULED: Final = Scheduled()
