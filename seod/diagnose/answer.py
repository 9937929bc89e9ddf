"""What a diagnosis says: the contract of `seod diagnose --json`, and the arrays that a report draws.

NRMSE is sqrt(sum e^2 / sum (y - mean)^2), sums pooled over windows, mean per window, of simulations whose
initial state was fitted on the window's first fifth, which is not scored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Mapping

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Output = Literal["position", "velocity"]
Verdict = Literal["clean", "effects", "unexplained"]
Effects = dict[str, dict[str, float]]
"""Values by effect and parameter, as `sim.parameters.parameters` takes them."""


class DiagnoseError(Exception):
    """A recording tells nothing; the message says why and what would be right."""


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

    def as_json(self) -> dict[str, Any]:
        """As in the contract, and the interval."""
        return {
            "K_L": told(self.K_L),
            "omega_n": told(self.omega_n),
            "zeta": told(self.zeta),
            "holdout_nrmse": told(self.holdout_nrmse),
            "holdout_ci95": [told(end) for end in self.holdout_ci95],
            "whole_nrmse": told(self.whole_nrmse),
            "diverged": self.diverged,
        }


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an effect, in the unit of the table of effects, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {"value": told(self.value), "unit": self.unit, "ci95": [told(end) for end in self.ci95]}


@dataclass(frozen=True, slots=True)
class Gain:
    """Held-out NRMSE of all effects but this one, refitted, and with it."""

    nrmse_without: float
    nrmse_with: float

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {"nrmse_without": told(self.nrmse_without), "nrmse_with": told(self.nrmse_with)}


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """A cause that the recordings show.

    Attributes:
        name: Of `sim.effects.EFFECTS`.
        parameters: By name.
        gain: What it is good for.
        p_value: Of no gain at all, over pieces of the held-out windows.
        indistinguishable_from: Causes that explain the recordings as well in its place.
    """

    name: str
    parameters: Mapping[str, Parameter]
    gain: Gain
    p_value: float
    indistinguishable_from: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {
            "name": self.name,
            "parameters": {name: each.as_json() for name, each in self.parameters.items()},
            "gain": self.gain.as_json(),
            "p_value": told(self.p_value),
            "indistinguishable_from": list(self.indistinguishable_from),
        }


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What the extended model leaves above the noise.

    Attributes:
        fraction: Of the baseline's held-out squared error above the noise floor; 0 where nothing is left.
        correlates_with: What the rest depends on, the strongest first.
        shares: How much of the rest a smooth function of each tells [0 to 1].
    """

    fraction: float
    correlates_with: tuple[str, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {"fraction": told(self.fraction), "correlates_with": list(self.correlates_with)}


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
        file: Index into the recordings, those kept aside (`--holdout`) last.
        rows: First row in the recording and the one after the last.
        t: [s].
        u: Command [V].
        y: Measured; nan where no sample is, or none to believe.
        ps: Supply pressure [Pa], or None.
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
    """A cause that was tried alone: the held-out NRMSE with it, `nan` where only a first step was tried."""

    name: str
    gain: float
    nrmse_with: float
    chosen: bool


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All that is found.

    Attributes:
        verdict: `clean`: Eq. 1 tells all; `effects`: causes are named; `unexplained`: most of it has none.
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

    @property
    def extends(self) -> bool:
        """Whether what was found changes the simulation: defects of a record do not."""
        return any(not np.array_equal(w.y_baseline, w.y_extended) for w in self.windows)

    def share(self, effect: FoundEffect) -> float:
        """Part of the baseline's held-out squared error above the noise that comes back without an effect."""
        above = self.baseline.holdout_nrmse**2 - self.noise_floor_nrmse**2
        gained = effect.gain.nrmse_without**2 - effect.gain.nrmse_with**2
        return min(1.0, max(0.0, gained / above)) if above > 0.0 else 0.0

    def as_json(self) -> dict[str, Any]:
        """The contract's answer, and shares of the effects: what is undefined is None, never nan."""
        return {
            "verdict": self.verdict,
            "baseline": self.baseline.as_json(),
            "effects": [each.as_json() | {"share": told(self.share(each))} for each in self.effects],
            "extended": self.extended.as_json(),
            "noise_floor_nrmse": told(self.noise_floor_nrmse),
            "unexplained": self.unexplained.as_json(),
            "next_experiment": None if self.next_experiment is None else self.next_experiment.as_json(),
            "remarks": list(self.remarks),
        }


def told(value: float) -> float | None:
    """The number, None where there is none."""
    return float(value) if math.isfinite(value) else None
