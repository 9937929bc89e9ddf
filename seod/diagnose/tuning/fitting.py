"""Numbers by which models are simulated and fitted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class BacklashJumps:
    """Jumps of a speed where a gap closes."""

    longest: float = 20.0
    """[rows] Of a ramp in place of a jump. Chosen."""


BACKLASH_JUMPS: Final = BacklashJumps()


@dataclass(frozen=True, slots=True)
class FreeRun:
    """The last fit, in one run over the whole recording."""

    longer: float = 4.0
    """[-] Factor from one length of windows to the next: a fit to the next begins near enough. Chosen."""
    least_gain: float = 0.05
    """[-] Part by which the error in one run has to fall, of rows that no fit saw: less is chance.
    Chosen."""
    as_near: float = 1.05
    """[-] Error of windows held out, over that of the fit to windows, that numbers for whole recordings may
    leave where those left noise alone. Chosen: as `least_gain`, the other way."""
    in_windows: float = 1.5
    """[-] Longest window of a fit, over the usual length, up to which it is one of windows, and none in
    longer runs. Chosen: between 1 and `longer`."""


FREE_RUN: Final = FreeRun()


@dataclass(frozen=True, slots=True)
class LinearGain:
    """K_L and a load bias by one linear step."""

    bias: float = 1e-2
    """[-] Load bias that is simulated, over the load pressure. Chosen: small, it acts in proportion."""


LINEAR_GAIN: Final = LinearGain()


@dataclass(frozen=True, slots=True)
class LoadDrift:
    """A load that grows with time, in one run of each recording."""

    least_gain: float = 0.2
    """[-] Mean log squared error that it must save where it is fitted. Chosen: as an effect of whole
    recordings."""
    surely: float = 0.975
    """[-] Probability that its size, each third left out in turn, lies on its side of none. Chosen: an
    interval of 95 %."""


LOAD_DRIFT: Final = LoadDrift()


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of windows held out."""

    adequate: float = 1.15
    """[-] Held-out squared error over the noise's, up to which nothing remains: the noise is known to
    some percent, and initial states fitted to a fifth of a window add theirs. Chosen."""
    diverged: float = 10.0
    """[ranges] Of the recording, beyond which a simulation has run away. Chosen."""
    rows_to_settle: float = 0.25
    """[-] Part of a recording's rows, not held out, above which the initial state of one run is fitted to
    them. Chosen."""


HELD_OUT: Final = HeldOut()


@dataclass(frozen=True, slots=True)
class NoiseColour:
    """A residual's memory."""

    orders: tuple[int, ...] = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 24, 32, 48, 64, 96, 128)
    """[rows] That are tried. Chosen."""
    longest: tuple[int, ...] = (8, 32, 128)
    """[rows] Order, at most: the next one where noise takes more than half of the one before. Measured: a
    load's noise below a sensor's own remembers for a period and more. With 8, four of five recordings under
    gusts were given a spring or a line; with 64, one; with 128, none."""
    given_up: float = 0.1
    """[-] Part of rows that a memory of more than the first `longest` may leave without a past. Chosen."""
    at_once: int = 16384
    """[rows] Of which the QR factors are taken. Chosen: some MB."""
    enough: float = 2.0
    """[-] Log likelihood by which a longer memory has to be better. Chosen."""
    decays: float = 20.0
    """[-] Time constants of the slowest part, after which nothing is left. Chosen."""
    most_rows: int = 1_000_000
    """[rows] Of it, at most. Chosen."""
    rows_each: int = 20
    """[rows] For each coefficient, at least. Chosen."""


NOISE_COLOUR: Final = NoiseColour()


@dataclass(frozen=True, slots=True)
class InitialStates:
    """States with which windows begin."""

    alike_windows: float = 4.0
    """[-] Squared error of a window, over the least of all, up to which another window may take its
    states. Chosen."""
    sign_lost: float = 0.5
    """[-] Part of a sensor's rectifying from which on readings below 0 are shown above it. Chosen."""
    places_in_gap: tuple[float, ...] = (0.5, 0.0, 1.0)
    """[-] In a gap where the load may have been at rest, over it: the middle and both flanks. Chosen."""
    settling_steps: int = 2
    """[steps] Of the initial states that a fit begins with. Chosen."""
    rings: float = 1.0
    """[time constants] In a window, below which a plant's own oscillation is not over with it. Chosen."""


INITIAL_STATES: Final = InitialStates()


@dataclass(frozen=True, slots=True)
class Fit:
    """Steps of a fit."""

    most_steps: int = 15
    """[steps] Of a fit. Chosen: a delay takes 13 to 19, and is fitted more than once."""
    derivative_step: float = 1e-3
    """[-] Change of a searched number by which derivatives are taken. Chosen."""
    largest_log_step: float = 1.0
    """[-] Change of a logarithm in one step, at most. Chosen."""
    largest_linear_step: float = 30.0
    """[-] Change of another searched number in one step, at most, in units of its scale. Chosen."""
    noise_alone: float = 1.03
    """[-] Squared error over the noise's, up to which nothing else remains: the noise is known to some
    percent. Chosen."""
    least_improvement: float = 1e-4
    """[-] Of the mean log squared error, below which a fit has ended. Chosen."""
    promised_part: float = 0.3
    """[-] Of that: a step that promises less, were the errors straight lines, is not tried. Measured: in
    fits of four recordings (3516 steps) no such step gained more than half of it."""
    state_step: float = 1e-3
    """[-] Change of a state by which derivatives are taken, over its size in the recordings. Chosen."""
    state_step_part: float = 0.05
    """[-] Change of a state by which derivatives are taken, over its range, at most. Chosen."""
    state_part: float = 0.3
    """[-] Of a step of a window's initial state, where all of it is too far. Chosen."""
    settling_steps: int = 1
    """[steps] Of the initial states alone, where a step of the numbers is too far. Measured: of 227 steps
    that two such made an improvement, the first had made one of 216."""
    states_steps: int = 6
    """[steps] Of the initial states alone, the numbers given, where nothing else is said. Chosen."""
    first_damping: float = 1e-2
    """[-] Levenberg's and Marquardt's, with which a fit begins. Chosen."""
    damping_factor: float = 6.0
    """[-] By which it grows where a step does not improve, and falls after one that does. Chosen."""
    least_damping: float = 1e-9
    """[-] Down to which it falls. Chosen: as good as none."""
    dampings_tried: int = 4
    """[-] Of one step, until it improves. Chosen."""
    dampings_tried_softened: int = 8
    """[-] Likewise where jumps of a reading are fitted as ramps. Chosen: twice as many."""
    hardly_shows: float = 1e-8
    """[-] Square of what a step of the pressure changes over that of the position, of a load that sticks at
    first, below which the pressure is kept. Chosen: a ten-thousandth. Measured: of a long run, of which the
    pressure tells how it began, it is 6e-7."""
    negligible: float = 1e-3
    """[-] Error of a window over the noise that makes no difference. Chosen."""
    negligible_coarse: float = 0.5
    """[-] The same of a coarse sensor's: beyond its step there may be no error at all. Chosen."""
    ahead: float = 0.1
    """[-] Part of a step at which the second derivative along it is taken. Chosen."""
    bend: float = 0.5
    """[-] Largest correction by it, over the step. Chosen."""


FIT: Final = Fit()


@dataclass(frozen=True, slots=True)
class Substeps:
    """How finely a model is simulated."""

    search_accuracy: float = 0.3
    """[-] Substep times the fastest rate in a search. Measured: readings then differ by some 1e-4 of the
    movement at most."""
    shortest: float = 0.03
    """[-] Substeps that an orifice asks for, over the longest: a search need not come nearer to its
    limit. Chosen."""
    quick_pole: float = 1.0
    """[-] Pole over the sampling rate above which it decays within a tick and need not be followed.
    Chosen."""
    stable: float = 1.5
    """[-] Substep times such a pole: as far as the method is stable. Chosen."""


SUBSTEPS: Final = Substeps()


@dataclass(frozen=True, slots=True)
class Simulation:
    """Limits of a simulated reading."""

    gone_beyond: float = 1e3
    """[-] Largest reading of a recording, times which a simulation has run away. Chosen."""


SIMULATION: Final = Simulation()


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Intervals and p-values."""

    fewest_compared: int = 3
    """[segments] Without which nothing is said of a gain. Chosen."""
    fewest_segments: int = 24
    """[segments] Of the held-out windows that are compared. Chosen."""
    pulling_parts: tuple[int, ...] = (48, 16)
    """[parts] Of all rows, whose pulls on a number are compared. Chosen: what bends a record slowly, as an
    offset that moves, shows in long ones alone."""
    fewest_pulling: int = 8
    """[parts] More than one, without which nothing is said of how they pull. Chosen."""
    upper_end: float = 0.975
    """[-] Of an interval's probability. The contract's."""
    near_null: float = 1e-6
    """[-] Part of a searched number's range at whose end it does nothing, if that is there. Chosen."""
    near_limit: float = 1e-4
    """[-] Part of an end's own size, or of the range if that is smaller, by which a number counts as being
    there, where it does something: it is told to be at its limit. Chosen: fits stop at up to 1e-5 from it."""
    derivative_step: float = 1e-4
    """[-] Change of a searched number by which its interval's derivatives are taken. Chosen."""


UNCERTAINTY: Final = Uncertainty()


@dataclass(frozen=True, slots=True)
class SlowOffset:
    """An offset of the sensor that moves slowly."""

    most: int = 4
    """[half-waves] Of it over a recording. Chosen: two periods; what is quicker, windows show."""
    part: float = 1.0
    """[-] Of the noise's deviation that each half-wave may have. Chosen."""
    largest: float = 2.0
    """[sd] Of what is left, at most, of each half-wave that stands for a cause. Chosen: where a constant load
    moved an integrating plant they save a third of what it does, at most, and of an offset all."""
    astray: float = 0.1
    """[-] Squared change of a simulation that is not in proportion to a step, over what is left, beyond which
    the step is not taken. Chosen."""


SLOW_OFFSET: Final = SlowOffset()


@dataclass(frozen=True, slots=True)
class Work:
    """What simulating costs, in time of a usual machine."""

    step_ns: int = 65
    """[ns] A Runge-Kutta step of the kernel. Measured: 62 in eight diagnoses on an idle machine. One with a
    spool takes a fifth more, with a Stribeck curve half as much more."""
    orifice_step_ns: int = 165
    """[ns] One with the square root of an orifice. Measured: 135 to 165 in two diagnoses. Counted as others,
    records that look like orifices took 120 s of processor time and more."""
    row_ns: int = 35
    """[ns] A row's residual, and its part of derivatives and normal equations. Measured: as `step_ns`,
    33."""
    simulation_ns: int = 100_000
    """[ns] A simulation's beginning and end, and Python around it. Measured: by least squares, with other
    numbers of the two above. All three give 0.6 to 0.85 of processor times (`bench/diagnose.py`)."""


WORK: Final = Work()
