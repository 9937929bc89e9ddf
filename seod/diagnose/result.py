"""What a diagnosis says: the contract of `seod diagnose --json`, and the arrays that a report draws.

NRMSE is sqrt(sum e^2 / sum (y - mean)^2), sums pooled over windows, mean per window, of simulations whose
initial state was fitted on the window's first fifth, which is not scored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Mapping

SD_OF_95: Final = 1.96
"""Standard deviations from the middle to the ends of an interval of 95 %, of what is normal."""
SD_OF_MEDIAN: Final = 1.4826
"""Standard deviation over the median of the deviations' sizes, of what is normal."""
RELEVANCE: Final = 0.02
"""Systematic rest over the movement's standard deviation that matters, if the user does not say: a hundredth
of its range, about what gains and calibrations of sensors are off by themselves."""
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.int64]
Output = Literal["position", "velocity"]
Hold = Literal["zero", "first"]
"""A command that holds until the next, or one that runs straight on to it."""
Verdict = Literal["clean", "effects", "unexplained"]
Grade = Literal["useless", "partly", "good_for_design", "down_to_noise"]
Evidence = Literal["nothing", "repetition", "black box", "movement", "yardstick"]
"""How a systematic part is known."""
Effects = dict[str, dict[str, float]]
"""Values by effect and parameter, as `sim.parameters.parameters` takes them."""


class DiagnoseError(Exception):
    """A recording tells nothing; the message says why and what would be right."""


@dataclass(frozen=True, slots=True)
class Common:
    """Eq. 1 with what every user would give it: a constant offset and a delay.

    Attributes:
        K_L: Gain [unit/s/V].
        omega_n: Undamped natural frequency [rad/s].
        zeta: Damping ratio.
        offset: Added to u [V]; of a speed y an offset of K_L times that is the same.
        delay: From the command to the valve [s].
        holdout_nrmse: Over the held-out windows.
    """

    K_L: float
    omega_n: float
    zeta: float
    offset: float
    delay: float
    holdout_nrmse: float

    def as_json(self) -> dict[str, Any]:
        """All of it."""
        return {name: finite_or_none(getattr(self, name)) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class FreeRun:
    """Errors of one simulation of a whole recording, root mean square [unit of y].

    Attributes:
        from_measured: From the first sample, at rest.
        from_fitted: From an initial state fitted to the first fifth of a window.
        unseen: No fit has seen the recording.
        nrmse: `from_fitted` over the recording's own standard deviation.
    """

    from_measured: float
    from_fitted: float
    unseen: bool = False
    nrmse: float = math.nan

    def as_json(self) -> dict[str, Any]:
        """By these names."""
        return {
            "rms_from_measured": finite_or_none(self.from_measured),
            "rms_from_fitted": finite_or_none(self.from_fitted),
            "nrmse_from_fitted": finite_or_none(self.nrmse),
            "holdout": self.unseen,
        }


@dataclass(frozen=True, slots=True)
class Score:
    """A fitted model and how well it simulates what it was not fitted to.

    Attributes:
        K_L: Gain [unit/s/V].
        omega_n: Undamped natural frequency [rad/s].
        zeta: Damping ratio.
        holdout_nrmse: Over the held-out windows.
        whole_nrmse: Of one simulation of each whole recording.
        diverged: That simulation left the recording by more than ten times its range.
        effects: What is switched on beside Eq. 1.
        sd: Standard deviations of K_L, omega_n and zeta.
        holdout_ci95: Interval of `holdout_nrmse`, by a block bootstrap; nan where nobody asked for it.
        common: Of the baseline, what it is with an offset and a delay; None: nobody asked.
        free_runs: Of each recording, those of `--holdout` last.
    """

    K_L: float
    omega_n: float
    zeta: float
    holdout_nrmse: float
    whole_nrmse: float
    diverged: bool
    effects: Effects = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    holdout_ci95: tuple[float, float] = (math.nan, math.nan)
    common: Common | None = None
    free_runs: tuple[FreeRun, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """As in the contract, the interval, errors of whole runs, the baseline with an offset and a delay."""
        more = {} if self.common is None else {"with_offset_and_delay": self.common.as_json()}
        return more | {
            "K_L": finite_or_none(self.K_L),
            "omega_n": finite_or_none(self.omega_n),
            "zeta": finite_or_none(self.zeta),
            "holdout_nrmse": finite_or_none(self.holdout_nrmse),
            "holdout_ci95": [finite_or_none(end) for end in self.holdout_ci95],
            "whole_nrmse": finite_or_none(self.whole_nrmse),
            "diverged": self.diverged,
            "free_runs": [each.as_json() for each in self.free_runs],
        }


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an effect, in the unit of the table of effects, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {
            "value": finite_or_none(self.value),
            "unit": self.unit,
            "ci95": [finite_or_none(end) for end in self.ci95],
        }


@dataclass(frozen=True, slots=True)
class Gain:
    """Held-out NRMSE of all effects but this one, refitted, and with it."""

    nrmse_without: float
    nrmse_with: float

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {
            "nrmse_without": finite_or_none(self.nrmse_without),
            "nrmse_with": finite_or_none(self.nrmse_with),
        }


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """A cause that the recordings show.

    Attributes:
        name: Of `sim.effects.EFFECTS`.
        parameters: By name.
        gain: What it is good for.
        p_value: Of no gain at all, over segments of the held-out windows.
        indistinguishable_from: Causes that explain the recordings as well in its place.
        holdout: Its parameters, all numbers fitted anew to each recording of `--holdout`; empty where too
            little of one counts.
    """

    name: str
    parameters: Mapping[str, Parameter]
    gain: Gain
    p_value: float
    indistinguishable_from: tuple[str, ...] = ()
    holdout: tuple[Mapping[str, Parameter], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """As in the contract, and with `--holdout` the parameters by each of its recordings."""
        again = [{name: each.as_json() for name, each in one.items()} for one in self.holdout]
        return ({"holdout": again} if again else {}) | {
            "name": self.name,
            "parameters": {name: each.as_json() for name, each in self.parameters.items()},
            "gain": self.gain.as_json(),
            "p_value": finite_or_none(self.p_value),
            "indistinguishable_from": list(self.indistinguishable_from),
        }


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What the extended model leaves that is systematic, and relevant.

    Attributes:
        fraction: Of the baseline's held-out squared error above the noise; 0 where nothing relevant is left.
        correlates_with: What the rest depends on, the strongest first.
        shares: How much of the rest a smooth function of each tells [0 to 1].
    """

    fraction: float
    correlates_with: tuple[str, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {"fraction": finite_or_none(self.fraction), "correlates_with": list(self.correlates_with)}


class OnLoad(NamedTuple):
    """Part of the squared error that does not repeat, by noise that acts on the load.

    Attributes:
        share: Of it [0 to 1]; the rest is the sensor's.
        least: Lower end of the 95 % interval.
        most: Upper end.
    """

    share: float
    least: float
    most: float

    def as_json(self) -> dict[str, Any]:
        """Share and interval."""
        return {"share": self.share, "ci95": [self.least, self.most]}


@dataclass(frozen=True, slots=True)
class Account:
    """The baseline's held-out squared error in parts; the three shares add up to 1.

    Attributes:
        explained: Share that the named causes take away.
        systematic: Share that is left and is no noise, at least: it repeats, or can be foretold.
        not_repeatable: The rest: noise of any colour, and disturbances.
        systematic_nrmse: The systematic part as an NRMSE, over the movement's standard deviation.
        shown_by: How the systematic part is known.
        noise_order: Of the autoregression that the rest is; 0 of white noise.
        noise_correlation_s: Its correlation time [s].
        asked: The recording could have shown a systematic part; windows of a sweep are too unlike each other,
            and a plant that rings through them may stand for anything.
        detectable_nrmse: NRMSE from which on a systematic part would have been shown with these rows;
            infinite where none would.
        on_load: How much of what does not repeat acts on the load; None where its spectrum does not tell.
    """

    explained: float
    systematic: float
    not_repeatable: float
    systematic_nrmse: float
    shown_by: Evidence = "nothing"
    noise_order: int = 0
    noise_correlation_s: float = math.nan
    asked: bool = True
    detectable_nrmse: float = math.inf
    on_load: OnLoad | None = None

    def as_json(self) -> dict[str, Any]:
        """The three shares, and how they are known."""
        return {
            "explained": finite_or_none(self.explained),
            "systematic": finite_or_none(self.systematic),
            "not_repeatable": finite_or_none(self.not_repeatable),
            "systematic_nrmse": finite_or_none(self.systematic_nrmse),
            "shown_by": self.shown_by,
            "asked": self.asked,
            "detectable_nrmse": finite_or_none(self.detectable_nrmse),
            "noise": {
                "order": self.noise_order,
                "correlation_s": finite_or_none(self.noise_correlation_s),
                "on_load": None if self.on_load is None else self.on_load.as_json(),
            },
        }


@dataclass(frozen=True, slots=True)
class Yardstick:
    """Models without physics, simulated freely over the same windows.

    Attributes:
        arx: Held-out NRMSE of a linear one.
        narx: Of a nonlinear one.
        changes_with: The state that the latter's weights change with; None where its terms are bent.
    """

    arx: float
    narx: float
    changes_with: str | None = None

    @property
    def best(self) -> float:
        """The better one."""
        return min(self.arx, self.narx)

    def as_json(self) -> dict[str, Any]:
        """By name."""
        return {
            "arx": finite_or_none(self.arx),
            "narx": finite_or_none(self.narx),
            "changes_with": self.changes_with,
        }


@dataclass(frozen=True, slots=True)
class NextExperiment:
    """An experiment that would tell apart what these recordings cannot.

    Attributes:
        input: Excitation in words, with its numbers.
        reason: Why it separates.
        separates: Causes.
        command: How to run it; "" where no command does.
    """

    input: str
    reason: str
    separates: tuple[str, ...]
    command: str = ""

    def as_json(self) -> dict[str, Any]:
        """As in the contract, and the command."""
        plain = {"input": self.input, "reason": self.reason, "separates": list(self.separates)}
        return plain | ({"command": self.command} if self.command else {})


@dataclass(frozen=True, slots=True)
class Window:
    """One window of a recording, simulated; arrays of shape (n,).

    Attributes:
        file: Index into the recordings, those held out (`--holdout`) last.
        rows: First row in the recording and the one after the last.
        t: [s].
        u: Command [V].
        y: Measured; nan where no sample is, or none to believe.
        ps: Supply pressure over nominal, or None.
        f: Measured disturbance, or None.
        y_baseline: Simulated.
        y_extended: Simulated; of the baseline where nothing was found.
        velocity: Of the load, by the extended model [unit/s].
        position: Likewise [unit].
        pressure: Load pressure as the acceleration of the free load, likewise [unit/s^2].
        scored: False on the first fifth.
        held_out: No fit has seen it.
    """

    file: int
    rows: tuple[int, int]
    t: Array
    u: Array
    y: Array
    ps: Array | None
    f: Array | None
    y_baseline: Array
    y_extended: Array
    velocity: Array
    position: Array
    pressure: Array
    scored: Mask
    held_out: bool


@dataclass(frozen=True, slots=True)
class Whole:
    """One simulation of a whole recording; arrays of shape (n,)."""

    t: Array
    y: Array
    y_baseline: Array
    y_extended: Array


@dataclass(frozen=True, slots=True)
class Candidate:
    """A cause that was tried alone, and what it saved of the mean log squared error of windows fitted."""

    name: str
    gain: float
    chosen: bool


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All that is found.

    Attributes:
        verdict: `clean`: Eq. 1 tells all; `effects`: causes are named; `unexplained`: what is left is
            systematic, and larger than what is relevant.
        baseline: Eq. 1, or the rig's model.
        effects: In order of gain.
        extended: With them.
        noise_floor_nrmse: That of a perfect model.
        unexplained: What is left; its fraction is 0 where it is noise.
        next_experiment: Where causes cannot be told apart.
        output: What `y` is.
        noise_sd: Of each recording's samples [unit of y].
        adequacy: Extended model's held-out mean squared error over the noise's.
        windows: All of them, in order.
        whole: Of each recording.
        candidates: In order of gain.
        remarks: What a reader should know, in sentences.
        grade: What the extended model is good for.
        account: What of the movement is explained, systematic, and not repeatable.
        yardstick: What ARX and NARX reach; None where the windows are too short for them.
        relevance: Systematic rest, over the movement's standard deviation, from which on it is `unexplained`.
    """

    verdict: Verdict
    baseline: Score
    effects: tuple[FoundEffect, ...]
    extended: Score
    noise_floor_nrmse: float
    unexplained: Unexplained
    next_experiment: NextExperiment | None
    output: Output
    noise_sd: tuple[float, ...] = ()
    adequacy: float = math.nan
    windows: tuple[Window, ...] = ()
    whole: tuple[Whole, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    remarks: tuple[str, ...] = ()
    grade: Grade = "partly"
    account: Account | None = None
    yardstick: Yardstick | None = None
    relevance: float = RELEVANCE

    @property
    def extends(self) -> bool:
        """Whether what was found changes the simulation: defects of a record do not."""
        return any(not np.array_equal(w.y_baseline, w.y_extended) for w in self.windows)

    @property
    def models(self) -> tuple[tuple[str, Score], ...]:
        """By name: the baseline and, where it simulates something else, the extended model."""
        return (("baseline", self.baseline), ("extended", self.extended))[: 2 if self.extends else 1]

    def share(self, effect: FoundEffect) -> float:
        """Part of the baseline's held-out squared error above the noise that comes back without an effect.

        Where the baseline errs by more than the movement it is of the movement.
        """
        above = min(self.baseline.holdout_nrmse, 1.0) ** 2 - self.noise_floor_nrmse**2
        gained = effect.gain.nrmse_without**2 - effect.gain.nrmse_with**2
        return min(1.0, max(0.0, gained / above)) if above > 0.0 else 0.0

    def as_json(self) -> dict[str, Any]:
        """The contract's answer, and shares of the effects: what is undefined is None, never nan."""
        return {
            "verdict": self.verdict,
            "output": self.output,
            "grade": self.grade,
            "baseline": self.baseline.as_json(),
            "effects": [
                each.as_json() | {"share": finite_or_none(self.share(each))} for each in self.effects
            ],
            "extended": self.extended.as_json(),
            "noise_floor_nrmse": finite_or_none(self.noise_floor_nrmse),
            "unexplained": self.unexplained.as_json(),
            "relevance": finite_or_none(self.relevance),
            "account": None if self.account is None else self.account.as_json(),
            "yardstick": None if self.yardstick is None else self.yardstick.as_json(),
            "next_experiment": None if self.next_experiment is None else self.next_experiment.as_json(),
            "remarks": list(self.remarks),
        }


def finite_or_none(value: float) -> float | None:
    """The number, None where there is none."""
    return float(value) if math.isfinite(value) else None
