"""Numbers by which recordings are read: noise, steps, windows, and defects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Blocks:
    """Blocks of a long recording in which causes are searched."""

    searched_rows: int = 64_000
    """[rows] Of all recordings, in which causes are searched: a minute at 1 kHz. Measured: of 240 s, searched
    in 120 000, the work was used up before friction and a deadband, or a delay, were tried together."""


BLOCKS: Final = Blocks()


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """Eq. 1 in closed form, which tells a position from a speed."""

    clearly: float = 0.6
    """[-] NRMSE of the other type over that of the usual one, below which the other is likelier. Chosen."""
    good: float = 0.02
    """[-] NRMSE that the likelier type leaves held out, with causes, up to which it is not doubted. Chosen:
    as much as counts if nobody says otherwise. Measured: a position with friction and a spring left 4 % as
    a speed behind a lag, 0.3 % as what it is."""
    nearer: float = 0.8
    """[-] Of the other type over that of the likelier one, below which y is the other. Measured: crane 0.10,
    a hoop 0.06, drives 0.08 to 0.41, flutter 0.69."""
    samples: int = 6000
    """[rows] Of a recording, to which it is fitted. Chosen: quick, and more than any plant's answer
    needs."""


CLOSED_FORM: Final = ClosedForm()


@dataclass(frozen=True, slots=True)
class CoarseSensor:
    """A sensor whose step is seen."""

    white_above: float = 0.2
    """[steps] Noise, from which on rounding is as good as white noise. Chosen."""
    as_rounding: float = 0.9
    """[-] Deviation from sample to sample over rounding's, from which on it likewise is. Measured: behind 22
    converters of 12 bits 1.0 to 7, of 9 sensors whose steps hide the noise 0.0."""
    passed_between: float = 0.5
    """[steps] From one reading to the next in the mean, from which on it likewise is, where readings are
    held. Chosen."""
    least_noise: float = 0.02
    """[steps] Noise with which a fit reckons, at least. Chosen."""
    most_noise: float = 0.1
    """[steps] Noise that may be: a residual as large is not called unexplained. Chosen."""
    noise_margin: float = 1.3
    """[-] Over the noise that changes of readings show: of a fast movement they show too little. Chosen."""
    there_and_back: float = 0.1
    """[-] Of the mean time between two steps: a change and its contrary within it are noise, no movement.
    Chosen."""
    there_and_back_rows: float = 2.0
    """[rows] The same, at least. Chosen."""


COARSE: Final = CoarseSensor()


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns that look like mistakes."""

    slowest_hz: float = 5.0
    """[Hz] Rate below which times are more likely milliseconds than seconds. Chosen: no rig is sampled
    slower."""
    slowest_plant: float = 0.5
    """[rad/s] omega_n below which times without a unit are more likely milliseconds than seconds. Chosen: the
    slowest rigs that are known, and in ms the fastest ones."""
    same_signal: float = 0.99999
    """[-] Correlation of two columns that are one signal. Chosen."""
    unit_tolerance: float = 0.15
    """[-] Logarithm by which a ratio may miss the unit's. Chosen."""
    fewest_samples: int = 50
    """[rows] With u and y, without which columns are not looked at. Chosen."""
    few_values: int = 20
    """[-] Values of a column that takes few, fewer than that. Chosen."""
    large_step: float = 0.3
    """[-] Largest change of such a one from row to row, over its range, above which it steps. Chosen."""


COLUMNS: Final = Columns()


@dataclass(frozen=True, slots=True)
class CommandPeriod:
    """The period with which a command repeats."""

    repeats_alike: float = 0.9
    """[-] Correlation of the command with itself a period later. Chosen."""
    near_best: float = 0.97
    """[-] The same over the largest of all, from which on the first one is the period. Chosen."""
    unlike: float = 0.5
    """[-] Correlation below which a later command is another one: periods are looked for after it. Chosen."""
    fewest_periods: int = 3
    """[periods] Of a command that repeats, at least. Chosen."""
    same_peak: float = 0.25
    """[-] Part of the first period that comes near, within which the best one is taken. Chosen."""
    compared_part: float = 0.75
    """[-] Part of a recording up to which later periods are compared with the first. Chosen."""
    lowest: float = 0.5
    """[-] Order of a harmonic, at least. Chosen."""
    lowest_of_relay: float = 1.5
    """[-] The same under a relay: it may have locked to a disturbance of its own frequency. Chosen."""
    harmonics: int = 6
    """[-] Of the command, with which a disturbance can be in step; above it is hardly an answer. Chosen."""
    shortest_s: float = 1.0
    """[s] Period that is searched for: a faster limit cycle wanders, and does not look like a slow
    disturbance. Chosen."""
    irregular: float = 0.05
    """[-] How far a relay's periods are from their median, where it has a frequency. Chosen."""
    mostly_regular: float = 0.9
    """[-] Part of them that are as near. Chosen."""
    regular_cycles: int = 10
    """[periods] Without which a relay has no frequency. Chosen."""
    grid_rows: int = 1 << 14
    """[rows] Even rows on which the command is compared with itself. Chosen: a power of two."""
    compared_rows: int = 4
    """[rows] Either way of where a later period ends by what is known, in which the command is compared with
    itself. Chosen: an end is known to half a row, so `growth` times as many periods later to two; twice
    that."""
    growth: int = 4
    """[-] How many times as many periods later the next comparison is. Chosen: each makes the period so many
    times finer, and `compared_rows` hold the next end."""


PERIOD: Final = CommandPeriod()


@dataclass(frozen=True, slots=True)
class CommandTiming:
    """Commands that were recorded late, or seldom."""

    leads: int = 3
    """[-] Times that are tried first, from `latest_lead` to `earliest_lead`. Chosen: of 1.5 rows 0.375 are
    left at most, of one row a quarter; the time that fits best follows."""
    latest_lead: float = -0.5
    """[rows] By which the latest of them is earlier than straight on; 0 where each row has a look of its own.
    Chosen: half a row later, on average, are steps from row to row."""
    earliest_lead: float = 1.0
    """[rows] The same of the earliest. Chosen: a row is how late a look at each row is at most."""
    fewest: int = 50
    """[changes] Of the command, without which nothing is asked. Chosen."""
    mostly: float = 0.5
    """[-] Of the looks after which the command has to be another one. Chosen: not of steps and relays."""
    most_rows: int = 8
    """[rows] From one look to the next, at most. Chosen."""
    fit_steps: int = 20
    """[steps] Of a fit with other commands. Chosen."""
    halfway: float = 0.5
    """[-] Of what a cause saves of the mean log squared error, up to which other times have to save as much
    for it to be asked whether they save all of it. Chosen: what is left of a row then loses a part of it."""
    most_promised: float = 0.9
    """[-] Of the squared error that other times may save to first order, at most. Chosen."""
    middle: float = 0.5
    """[looks] By which what runs straight on to the next look is earlier, on average, than what holds.
    Chosen: by what it is."""
    unsure: float = 0.5
    """[looks] Standard deviation of when commands were given, where nobody tells. Chosen: what runs on and
    is noted late is half a look to one and a half earlier than recorded, what is noted when it is given is
    not."""
    most: float = 1.5
    """[looks] Earlier than recorded, at most: what runs on, and is noted a look late. Chosen."""
    least: float = 0.025
    """[looks] Earlier, below which they stay as recorded. Measured: 0.023 where a gap's contacts are
    seen at rows."""
    nearly: float = 0.002
    """[looks] By which they are moved once more. Chosen."""
    change: float = 0.1
    """[-] Of that deviation, by which its derivative is taken. Chosen."""
    mentioned: float = 0.25
    """[-] Of that deviation, from which on the answer says so. Chosen."""
    rounds: int = 4
    """[-] Of when commands were given, and numbers fitted with that. Chosen: mostly two are enough."""


COMMAND_TIMING: Final = CommandTiming()


@dataclass(frozen=True, slots=True)
class SwitchTimes:
    """Switches of a relay that were given between two rows."""

    fewest: int = 20
    """[switches] Without which nothing is asked. Chosen: fewer hardly tell looks from rows."""
    apart: float = 4.0
    """[looks] Median from one switch to the next, at least. Chosen: nearer ones are no relay's."""
    most_in_window: int = 100
    """[switches] Each takes a simulation. Chosen."""
    unsure: float = 0.5
    """[looks] Mean and standard deviation of how much earlier than recorded a switch was given. Chosen: up
    to a look, and a look more where commands are noted late."""
    latest: float = -0.5
    """[-] Lead over that deviation, at least. Chosen: a quarter of a look later than recorded is an error
    of the set."""
    earliest: float = 4.0
    """[-] At most. Chosen: two looks."""
    change: float = 0.1
    """[rows] By which its derivative is taken. Chosen."""
    fit_steps: int = 12
    """[steps] Of a fit with other times. Chosen."""
    parts: tuple[float, ...] = (1.0, 0.5, 0.25)
    """[-] Of a step, tried one after the other. Chosen."""
    rounds: int = 10
    """[-] Of times, and numbers fitted with these. Measured: five or six for a damping four times off."""
    enough: float = 0.003
    """[-] Of the mean log squared error, saved by a round that is not the last. Chosen."""
    alike: float = 0.02
    """[-] Of the mean log squared error, by which a set with fewer effects may err more. Chosen: a percent
    of the error."""
    one_way: float = 4.0
    """[sd] Of the difference of how early switches up and down are, at most. Chosen: one in ten thousand by
    chance. Measured: 0.1 to 0.8 with the plant as it is, 14.7 without its constant load."""
    tail: float = 0.1
    """[-] Part of the switches at either end that may be told wrongly. Chosen: the first of a window, for
    which its initial state stands, is every sixth or so."""
    widest: float = 1.0
    """[looks] From the latest of the others to the earliest. Chosen: 0.8 of them, and errors. Measured: 1.5
    where the set lacks a spring."""
    likelier: float = 10.0
    """[-] Log of how much likelier times of their own have to make the recordings. Chosen: as many say
    nothing by chance."""


SWITCH_TIMES: Final = SwitchTimes()


@dataclass(frozen=True, slots=True)
class DaemonPart:
    """A part of a daemon's recording in one mode."""

    least_s: float = 3.0
    """[s] Of a part that is diagnosed alone. Chosen."""


DAEMON_PART: Final = DaemonPart()


@dataclass(frozen=True, slots=True)
class Defects:
    """Defects of the record that samples show."""

    fewest_samples: int = 50
    """[rows] Without which nothing is looked for. Chosen."""
    unmentioned_gaps: float = 5e-4
    """[-] Part of the samples that may be missing without a word. Chosen."""
    mostly_noise: float = 0.5
    """[-] Part of y's deviation from which on its samples' errors are all there is. Chosen."""
    absurd: float = 1e9
    """[-] Times the spread of nearly all readings beyond which one is none: its square may not be a
    number. Chosen."""
    remains: float = 0.5
    """[-] Part of a defect that must be in what a model leaves, too: else the model moves like that. Chosen:
    half."""
    clipped_readings: int = 4
    """[rows] In a row that stand at the end of the range. Chosen."""
    clipped_step: float = 3.0
    """[-] Change with which they come there, over the least change of y. Chosen: slower ones are a turn."""
    nearly_all: float = 0.99
    """[-] Part of the readings whose spread is that of `absurd`. Chosen."""
    most_rows: int = 100
    """[-] Rows that there would be without pauses, over those that there are, from which on the pauses count
    as no missing samples. Chosen."""


DEFECTS: Final = Defects()


@dataclass(frozen=True, slots=True)
class FourthDifferences:
    """Differences of five samples in a row."""

    too_wide: float = 6.0
    """[intervals] That five samples without a gap span at most (4 of them). Chosen."""
    slope_reach: int = 3
    """[rows] On either side, through which a cubic tells the slope. Chosen."""


FOURTH_DIFFERENCES: Final = FourthDifferences()


@dataclass(frozen=True, slots=True)
class HeldReadings:
    """A sensor's own clock, slower than the rows."""

    fewest_readings: int = 40
    """[readings] New ones without which no clock is looked for. Chosen."""
    least_held: float = 1.2
    """[rows] For each reading, at least, in the median or the mean: with fewer nothing is lost. Chosen."""
    on_clock: float = 0.95
    """[-] Part of the new readings that come in the first row after a tick of the clock, at least.
    Chosen."""
    lone_readings: float = 0.5
    """[-] Part of the clock's ticks that bring a new reading, at least: a load at rest has none. Chosen."""
    single_counts: float = 0.9
    """[-] Part of the changes that are of one size, from which on they are a coarse sensor's counts.
    Chosen."""
    same_row: float = 1e-6
    """[rows] By which a reading may seem to come too early: rounding of times. Chosen."""
    first_rows: int = 1 << 16
    """[rows] To which the clock is fitted first, by their spectrum. Chosen."""
    finer: int = 8
    """[-] Lines of the spectrum to one that rows can tell. Chosen: ticks are off by a sixteenth at most."""
    slowest: float = 0.5
    """[-] Clock that is looked for, over one tick in the median of steps between new readings. Chosen."""
    fastest: float = 1.5
    """[-] Likewise: less than the clock's first overtone. Chosen."""
    growth: int = 4
    """[-] Times as many readings in each further fit. Chosen."""
    off_clock: float = 0.02
    """[rows] By which a reading may miss the first row after a tick. Chosen: the clock is fitted."""
    same_size: float = 1e-3
    """[-] Part of a change by which one of the same size may differ. Chosen."""


HELD_READINGS: Final = HeldReadings()


@dataclass(frozen=True, slots=True)
class Noise:
    """The noise that differences of readings show."""

    as_low_as_least: float = 1.03
    """[-] Orders of differences whose estimates are within this factor of the least are equally good.
    Chosen."""
    event_beyond: float = 5.0
    """[sd] Beyond which a difference is an event, not noise. Chosen."""
    uneven: float = 0.5
    """[intervals] By which one may be longer or shorter for its samples to count. Chosen."""
    fewest: int = 50
    """[differences] Without which an order tells nothing. Chosen."""


NOISE: Final = Noise()


@dataclass(frozen=True, slots=True)
class Outliers:
    """Single samples far off."""

    beyond: float = 9.0
    """[sd] Of the noise, from which on a sample is none of the rest; its estimate has 1.4 of them itself.
    Chosen."""
    likeness: float = 0.9
    """[-] Part of five neighbouring differences' squares that the pattern explains; a corner of the
    signal has less. Chosen."""
    most: float = 0.1
    """[-] Part of the samples; where more seem to be, it is the signal. Chosen."""
    reach: int = 4
    """[rows] On either side of a sample, where the signal is a cubic. Chosen: five more than its numbers."""
    at_once: int = 4096
    """[rows] Whose neighbours are looked at together. Chosen: some 10 MB."""
    fewest: int = 3
    """[rows] That are called outliers: fewer are chance. Chosen."""
    rest_by_noise: float = 15.0
    """[-] Squares of five neighbouring differences that noise may leave beside the pattern, over the mean of
    one by noise. Chosen: three for each."""
    log_sizes: tuple[float, float] = (-3.0, 0.1)
    """[-] Logarithm of the outliers' deviation over the rms of those that are seen, from and to. Chosen: of
    a small deviation only the largest are seen."""
    log_step: float = 0.05
    """[-] Change of it by which its second derivative is taken. Chosen."""
    least_bend: float = 0.1
    """[-] That derivative of the log likelihood, at least. Chosen: the interval stays finite."""


OUTLIERS: Final = Outliers()


@dataclass(frozen=True, slots=True)
class SensorStep:
    """The step of a coarse sensor."""

    fewest_levels: int = 3
    """[levels] Of readings without which there is no step to look for. Chosen."""
    few_levels: float = 0.3
    """[-] Levels over readings, at most, of a sensor that reads whole counts. Chosen."""
    same_level: float = 1e-9
    """[-] Part of the range by which one level may be told in two ways: rounding. Chosen."""
    off_multiple: float = 0.05
    """[steps] By which a distance of two levels may miss whole counts. Chosen."""
    exact_above: float = 0.5
    """[sd] Of the noise, above which a step of whole counts is one. Chosen."""
    histogram_bins: int = 1 << 17
    """[bins] Of the histogram whose spectrum tells the circular mean for all steps at once. Chosen: a
    power of two."""
    pad: int = 4
    """[-] Points of that spectrum over those of an unpadded one. Chosen: steps between are nearly as near."""
    finest_part: float = 0.2
    """[-] Points of the spectrum that are searched, over the histogram's bins. Chosen: a step is 20 bins
    wide at least."""
    fewest_steps: int = 8
    """[steps] Over the range, at least. Chosen: more than `near_steps`."""
    near_steps: int = 6
    """[steps] More or fewer over the range, up to which a step is of nearly the same size. Chosen."""
    own_steps: float = 1.5
    """[steps] Up to which it is the same one. Chosen."""
    gathered: float = 0.5
    """[-] Circular mean of readings that lie on a lattice. Measured: noise of a fifth of a step leaves
    0.45."""
    contrast: float = 0.35
    """[-] By which it stands out among steps of nearly the same size: readings at rest gather for all of
    them. Chosen."""
    rounds: int = 4
    """[-] Of fitting the step to whole counts. Chosen."""
    exact: float = 1e-3
    """[steps] By which readings of whole counts may be off. Chosen."""
    most_scatter: float = 1.5
    """[sd] Of the noise, of readings about whole counts, at most; its estimate is right to some percent.
    Chosen."""
    one_speed: float = 0.7
    """[-] Part of the rows that go on by the same number of steps, not none, above which these are what a
    movement of one speed passes from row to row. Chosen; 0.95 of a position under a square wave."""
    within_noise: float = 1.5
    """[sd] Steps of fewer say nothing that could be seen. Chosen."""


STEP: Final = SensorStep()


@dataclass(frozen=True, slots=True)
class Relay:
    """By what commands of a relay are known."""

    levels: int = 4
    """[levels] Of them, at most: two, with another bias four. Chosen."""
    fewest_periods: int = 8
    """[periods] By which it is asked. Chosen: fewer of binary noise are alike by chance."""
    changes: float = 0.26
    """[-] Logarithm of a period's length over that of the one before, at most, in most periods. Measured: at
    most 0.24 of 113 relays, some of which wait a quarter period in every other phase. Binary noise whose
    movement is otherwise a relay's: 0.288 (four clocks after three) and more."""
    part: float = 0.25
    """[-] Part of the periods whose switches are as near as that. Chosen: in half of its phases a relay may
    wait."""
    apart: float = 0.45
    """[-] Distance of the places of both switches, over the range of places, at most. Measured: 0.16 and less
    of 113 relays, 0.33 and less where the whole movement is a coarse sensor's step or two; 0.6 and more of
    430 square waves, with a spring or without, one of which has the plant's own frequency."""


RELAY: Final = Relay()


@dataclass(frozen=True, slots=True)
class Series:
    """Rows of a recording as they are simulated."""

    steps_between: int = 4
    """[steps] That stand for a straight line between two commands. Measured: of ten commands a wave 0.2 %
    are wrong."""
    window_periods: int = 10
    """[periods] Dominant ones of a window. The contract's."""
    shortest_window_s: float = 1.0
    """[s] Of a window. The contract's."""
    segment_s: float = 2.0
    """[s] Longest segment of a window to fit; each begins from a state of its own. Chosen: in shorter ones
    initial states make up for friction and load."""
    segment_periods: float = 3.0
    """[periods] Likewise, of a slow rig. Measured: of 15 slow records missed with one period four are right
    with three, and the same with five."""
    fewest_windows: int = 4
    """[windows] Of a recording: two to fit, two held out. Chosen."""
    least_samples: int = 200
    """[rows] Of a recording. Chosen."""
    most_paused: float = 100.0
    """[-] Length over that of its rows, at most. Chosen: simulated through it takes so many times as long."""
    drifting_rows: int = 30_000
    """[rows] Of a position, from which on its slow drift is not its period. Measured: in 48 s at 1 kHz one
    made windows of 12 s, and of three rigs causes were not found that 12 s name."""
    line_above_noise: float = 5.0
    """[-] A line over the root mean square of the noise's spectrum, at least. Chosen: of white noise one line
    in 10^11 is."""
    most_spectrum_rows: int = 1 << 18
    """[rows] Of the spectrum that shows the dominant period. Chosen: a power of two."""
    least_noise: float = 1e-9
    """[-] Noise over the deviation of y, at least. Chosen: readings without any are weighed, too."""
    least_supply: float = 0.01
    """[-] Supply pressure over the nominal one, at least. Chosen: it is divided by."""


SERIES: Final = Series()


@dataclass(frozen=True, slots=True)
class Sweep:
    """A command whose frequency or size goes one way with time."""

    parts: int = 8
    """[-] Of a recording, that are compared. Chosen."""
    alike: float = 0.9
    """[-] Rank correlation with time from which on a command sweeps. Chosen: of 8 parts by chance one in
    300."""
    at_rest: float = 0.1
    """[-] Part of the largest size up to which the command rests. Chosen."""
    rests: int = 2
    """[parts] That may rest: before and after. Chosen."""
    changes: float = 2.0
    """[-] Largest frequency or size over the least, at least. Chosen."""


SWEEP: Final = Sweep()


@dataclass(frozen=True, slots=True)
class TimingJitter:
    """Times of samples that are wrong."""

    significant: float = 6.0
    """[sd] By which the error must grow with the slope. Chosen."""
    most: float = 0.5
    """[intervals] Of their deviation: beyond it samples would often change places. Chosen. Measured: 0.62 of
    a ball in a hoop."""
    least_share: float = 0.3
    """[-] Of the samples' mean squared error that must come from it: less is nobody's trouble. Chosen."""
    fewest_differences: int = 200
    """[differences] Without which nothing is looked for. Chosen."""
    median_growth: float = 0.6
    """[-] Part of the growth that the medians must show too. Chosen."""
    alternating: float = -0.65
    """[-] Correlation of neighbouring differences, at most. Chosen."""
    events: float = 25.0
    """[-] Squared differences over the expected ones beyond which they are corners of the signal. Chosen."""
    rounds: int = 8
    """[-] Of weighing squares by what was found. Chosen."""
    least_expected: float = 1e-3
    """[-] Square that is expected, over the larger of level and growth, at least. Chosen."""


TIMING_JITTER: Final = TimingJitter()


@dataclass(frozen=True, slots=True)
class Windows:
    """Windows that are fitted or held out, and segments of them."""

    settling_part: float = 0.2
    """[-] Of a held-out window, to which its initial state is fitted. The contract's."""
    least_samples: int = 50
    """[rows] Of a window. Chosen."""
    least_segment_rows: int = 10
    """[rows] Of a segment: where a recording pauses, few rows last long. Chosen."""
    skipped_s: float = 0.1
    """[s] Of a recording's start: the commands before it, which delay and lag still show, are unknown.
    Chosen."""
    skipped_part: float = 0.05
    """[-] Of its length, the same at most. Chosen."""
    rounding: float = 1e-6
    """[windows] By which a recording may miss a whole number of them: its times are rounded. Chosen."""
    segment_longer: float = 0.05
    """[-] By which a segment may be longer than said before it is divided once more: part of its length,
    for all of a window. Chosen."""
    settling_rows: int = 20
    """[rows] In the first fifth of a window, without which its initial state is that of one run of the whole
    recording: up to seven numbers are fitted to them. Chosen."""
    at_edge: float = 1e-3
    """[intervals] A row so near before an edge is at it, however its time was rounded. Chosen."""
    moving_above_noise: float = 3.0
    """[-] Deviation over the noise from which on a window shows a movement; the others show nothing of
    the plant. Chosen."""
    samples_a_period: int = 50
    """[rows] Of a limit cycle by which it is tried what it may come from. Chosen: more where these do not
    distinguish causes."""
    mostly: float = 0.9
    """[-] Part of the samples that others have to predict. Chosen."""
    between: float = 3.0
    """[-] Error with which they do, over the noise: both have some. Chosen."""
    fewest_of_curve: int = 4
    """[rows] Through which a cubic goes that predicts others. Chosen: a cubic has four numbers."""


WINDOWS: Final = Windows()
