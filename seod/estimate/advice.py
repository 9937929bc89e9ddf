"""What an estimate says about the proportional position controller that the axis can have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, Final

from seod.estimate.plant.free_motion import Dynamics

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

GAIN_MARGIN: Final = 2.0
"""6 dB."""
PHASE_MARGIN: Final = math.radians(45.0)
INTERVAL: Final = 1.96
"""Standard deviations of a 95 % interval."""


@dataclass(frozen=True, slots=True)
class Advice:
    """Gains of u = K_p (reference - position), at the worst corner of the estimate's intervals.

    Attributes:
        velocity_gain_limit: Where the position loop begins to oscillate [1/s]: 2 zeta omega_n without delay.
        controller_gain_limit: The same as K_p [V/unit].
        velocity_gain: With both margins [1/s].
        controller_gain: The same as K_p [V/unit].
        gain_margin: That was asked for, a factor.
        phase_margin: That was asked for [rad].
    """

    velocity_gain_limit: float
    controller_gain_limit: float
    velocity_gain: float
    controller_gain: float
    gain_margin: float
    phase_margin: float


def advise(
    value: Mapping[str, float],
    sd: Mapping[str, float],
    gain_margin: float = GAIN_MARGIN,
    phase_margin: float = PHASE_MARGIN,
) -> Advice | None:
    """Gains that hold for every plant within the 95 % intervals.

    Args:
        value: `omega_n` [rad/s], `zeta`, `K_L` [unit/s/V], `delay` [s].
        sd: Standard deviations of the same; absent is certain.
        gain_margin: A factor, >= 1.
        phase_margin: [rad], from 0 to below pi/2.

    Returns:
        None where an interval reaches zero: then no gain is safe.
    """
    plants = list(_corners(value, sd))
    if not all(plant.omega_n > 0.0 and plant.zeta > 0.0 and gain > 0.0 for plant, gain in plants):
        return None
    limits = [(gain_limit(plant), K_L) for plant, K_L in plants]
    gains = [(gain_for(plant, gain_margin, phase_margin), K_L) for plant, K_L in plants]
    return Advice(
        velocity_gain_limit=min(limit for limit, _ in limits),
        controller_gain_limit=min(limit / K_L for limit, K_L in limits),
        velocity_gain=min(gain for gain, _ in gains),
        controller_gain=min(gain / K_L for gain, K_L in gains),
        gain_margin=gain_margin,
        phase_margin=phase_margin,
    )


def of_estimate(estimate: Mapping[str, Any] | None) -> dict[str, float] | None:
    """The advice of an estimate message's `zeta`, `omega_n`, `K_L`, `delay_s`; None where it is not valid."""
    if estimate is None or estimate["quality"] != "ok":
        return None
    values: list[Any] = [estimate.get(name) for name in ("omega_n", "zeta", "K_L")]
    if None in values:
        return None
    value = {
        "omega_n": values[0],
        "zeta": values[1],
        "K_L": abs(values[2]),
        "delay": estimate.get("delay_s") or 0.0,
    }
    sd = {name: estimate.get(f"{name}_sd") or 0.0 for name in value}
    sd["delay"] = estimate.get("delay_sd_s") or 0.0
    advice = advise(value, sd)
    return None if advice is None else as_json(advice)


def as_json(advice: Advice) -> dict[str, float]:
    """Field by field."""
    return {name: float(f"{getattr(advice, name):.6g}") for name in Advice.__slots__}


def _corners(value: Mapping[str, float], sd: Mapping[str, float]) -> Iterator[tuple[Dynamics, float]]:
    ends = [
        (value[name] - INTERVAL * sd.get(name, 0.0), value[name] + INTERVAL * sd.get(name, 0.0))
        for name in ("omega_n", "zeta", "delay", "K_L")
    ]
    for omega_n, zeta, delay, K_L in product(*ends):
        yield Dynamics(omega_n, zeta, max(delay, 0.0)), K_L


def gain_limit(plant: Dynamics) -> float:
    """Velocity gain at which a position loop oscillates [1/s]; exact, delay included."""
    return _inverse_magnitude(plant, _frequency_at(plant, math.pi))


def gain_for(plant: Dynamics, gain_margin: float, phase_margin: float) -> float:
    """Largest velocity gain with both margins [1/s]: no crossover beyond where the phase margin ends."""
    last = _frequency_at(plant, math.pi - phase_margin)
    allowed = _inverse_magnitude(plant, last)
    bend = 4.0 * plant.zeta**2 - 2.0
    if bend < -math.sqrt(3.0):  # resonance: the magnitude has a second peak
        peak = plant.omega_n * math.sqrt((-bend + math.sqrt(bend * bend - 3.0)) / 3.0)
        allowed = min(allowed, _inverse_magnitude(plant, max(peak, last)))
    return min(allowed, gain_limit(plant) / gain_margin)


def _inverse_magnitude(plant: Dynamics, frequency: float) -> float:
    """Of e^(-s delay) / (s (s^2/omega_n^2 + 2 zeta s/omega_n + 1)) at s = j frequency [rad/s]."""
    x = frequency / plant.omega_n
    return frequency * math.hypot(1.0 - x * x, 2.0 * plant.zeta * x)


def _frequency_at(plant: Dynamics, lag: float) -> float:
    """Where the open position loop lags by this [rad], from pi/2 to pi: [rad/s], by bisection."""
    low, high = 0.0, plant.omega_n
    for _ in range(80):
        middle = 0.5 * (low + high)
        x = middle / plant.omega_n
        lags = 0.5 * math.pi + math.atan2(2.0 * plant.zeta * x, 1.0 - x * x) + middle * plant.delay
        low, high = (middle, high) if lags < lag else (low, middle)
    return 0.5 * (low + high)
