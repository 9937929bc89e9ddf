"""Controllers of one axis: each takes the time and an error, and returns a voltage, without the bias.

The relay is a controller like the others, so that it is swapped in and out without a special case. None of
them reads a clock, and none of them decides what reaches the actuator: that is the guard's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol


class Controller(Protocol):
    """One law from error to voltage."""

    def step(self, t: float, e: float) -> float:
        """Voltage [V] for the error `e` [axis unit] at time `t` [s]."""


class Relay:
    """The relay of Fig. 2 with hysteresis; its amplitude rises from 0 to e_a in the entry time.

    Args:
        start: Time at which it is switched on [s].
        entry: Length of the rise [s].
        e_a: Amplitude [V].
        hysteresis: Half-width [axis unit]: switches up at e >= hysteresis, down at e <= -hysteresis.
    """

    def __init__(self, start: float, entry: float, e_a: float, hysteresis: float) -> None:
        self.start = start
        self.entry = entry
        self.e_a = e_a
        self.hysteresis = hysteresis
        self.sign = 1.0

    @property
    def turning(self) -> bool:
        """Whether the cycle that has just ended was one between two phases; see `seod.loop.two_phase`."""
        return False

    def amplitude(self, t: float) -> float:
        """Amplitude in force at `t` [V]."""
        since = t - self.start
        return self.e_a if since >= self.entry else self.e_a * since / self.entry

    def step(self, t: float, e: float) -> float:
        """Switch where the error has crossed the hysteresis."""
        if e > self.hysteresis:
            self.sign = 1.0
        elif e < -self.hysteresis:
            self.sign = -1.0
        return self.sign * self.amplitude(t)


class PositionHold:
    """Proportional control back to the reference, with a limited output.

    Args:
        gain: [V per axis unit].
        limit: Largest control voltage [V].
    """

    def __init__(self, gain: float, limit: float) -> None:
        self.gain = gain
        self.limit = limit

    def step(self, t: float, e: float) -> float:  # noqa: ARG002 - a controller's form
        """Proportional, clipped."""
        return max(-self.limit, min(self.limit, self.gain * e))


class Coast:
    """Nothing but the bias."""

    def step(self, t: float, e: float) -> float:  # noqa: ARG002 - a controller's form
        """0 V."""
        return 0.0


class Drive:
    """A voltage for a while, whatever the sensor says; the guard still does.

    Args:
        end: Time at which it is over [s].
        voltage: Without the bias [V].
    """

    def __init__(self, end: float, voltage: float) -> None:
        self.end = end
        self.voltage = voltage

    def step(self, t: float, e: float) -> float:  # noqa: ARG002 - a controller's form
        """The voltage, then nothing."""
        return self.voltage if t < self.end else 0.0


@dataclass(frozen=True, slots=True)
class PolarityResult:
    """What the pulse showed: movement [axis unit] beyond the drift before it, and whether that is right."""

    ok: bool
    movement: float
    why: str


class DriftLine:
    """Straight line through the errors of a rig that is left alone (least squares)."""

    def __init__(self) -> None:
        self.n = self.t = self.e = self.tt = self.te = 0.0

    def add(self, t: float, e: float) -> None:
        """One error [axis unit] at `t` [s]."""
        self.n += 1.0
        self.t += t
        self.e += e
        self.tt += t * t
        self.te += t * e

    def at(self, t: float) -> float:
        """The line at `t` [s]; nan without points."""
        if self.n == 0.0:
            return math.nan
        spread = self.tt - self.t * self.t / self.n
        slope = (self.te - self.t * self.e / self.n) / spread if spread > 0.0 else 0.0
        return self.e / self.n + slope * (t - self.t / self.n)


class PolarityPulse:
    """A small pulse that shows whether a positive voltage moves the sensor up.

    First it watches the drift, for as long as the pulse may last; then it pulses until the movement beyond
    that drift is clear, `CLEAR` samples in a row, or the time is over.

    Args:
        start: Time of the beginning [s].
        voltage: Height [V].
        duration: Longest pulse [s].
        movement: Movement that is clear [axis unit].
    """

    CLEAR = 3
    """One sample may be noise; so many in a row beyond `movement`, on one side, are not."""

    def __init__(self, start: float, voltage: float, duration: float, movement: float) -> None:
        self.start = start
        self.voltage = voltage
        self.duration = duration
        self.movement = movement
        self.drift = DriftLine()
        self.clear = 0
        self.result: PolarityResult | None = None

    def step(self, t: float, e: float) -> float:
        """Nothing, then the pulse, then nothing for good."""
        since = t - self.start
        if self.result is not None:
            return 0.0
        if since < self.duration or self.drift.n < self.CLEAR:
            self.drift.add(since, e)
            return 0.0
        self.result = self._judge(since - self.duration, self.drift.at(since) - e)
        return self.voltage if self.result is None else 0.0

    def _judge(self, pulsing: float, moved: float) -> PolarityResult | None:
        what = f"{self.voltage:+.3g} V for {pulsing * 1e3:.0f} ms moved the sensor by {moved:+.3g}"
        if abs(moved) < self.movement:
            self.clear = 0
        else:
            self.clear = max(self.clear, 0) + 1 if moved > 0.0 else min(self.clear, 0) - 1
        if self.clear >= self.CLEAR:
            return PolarityResult(True, moved, what)
        if self.clear <= -self.CLEAR:
            advice = "turn the sign of the sensor's or the output's scale"
            return PolarityResult(False, moved, f"wrong sign: {what}; {advice}")
        if pulsing < self.duration:
            return None
        return PolarityResult(
            False,
            moved,
            f"no movement: {what}, less than polarity.movement = {self.movement:.3g}; is the pressure on "
            "and the valve connected, or should the pulse be higher or longer?",
        )
