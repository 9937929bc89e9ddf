"""Controllers of one axis: each takes the time and an error, and returns a voltage, without the bias.

The relay is a controller like the others, so that it is swapped in and out without a special case. None of
them reads a clock, and none of them decides what reaches the actuator: that is the guard's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable


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
        self.n = self.t = self.e = self.tt = self.te = self.ee = 0.0
        self.newest: tuple[float, ...] = ()
        self.bends: list[float] = []

    def add(self, t: float, e: float) -> None:
        """One error [axis unit] at `t` [s]."""
        self.n += 1.0
        self.t += t
        self.e += e
        self.tt += t * t
        self.te += t * e
        self.ee += e * e
        if len(self.newest) == 2:
            self.bends.append(abs(e - 2.0 * self.newest[1] + self.newest[0]))
        self.newest = (*self.newest[-1:], e)

    def scatter(self) -> float:
        """Root mean square of the points about the line [axis unit]; they begin near zero."""
        mean_t, mean_e = self.t / self.n, self.e / self.n
        spread, along = self.tt / self.n - mean_t * mean_t, self.te / self.n - mean_t * mean_e
        left = self.ee / self.n - mean_e * mean_e - (along * along / spread if spread > 0.0 else 0.0)
        return math.sqrt(max(left, 0.0))

    def leverage(self, t: float) -> float:
        """By how much more than about its points the line may be off at `t` [s]."""
        mean_t = self.t / self.n
        spread = self.tt / self.n - mean_t * mean_t
        return math.sqrt(1.0 + (t - mean_t) ** 2 / spread) if spread > 0.0 else 1.0

    def noise(self) -> float:
        """Standard deviation of white noise that would bend the line so from sample to sample [axis unit].

        Neither the line's slope nor a single step is noise: of the second differences the median counts.
        """
        return median(self.bends) / (0.6745 * math.sqrt(6.0)) if self.bends else 0.0

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
    that drift is clear, `CLEAR` samples in a row, or the time is over. While the drift is no straight line,
    as where the actuator still comes to rest, it goes on watching. A pulse says nothing, and is done again,
    if too few samples came in it or only its last ones were clear: ticks or samples were late.

    Args:
        start: Time of the beginning [s].
        voltage: Height [V].
        duration: Longest pulse [s]; None: as `SHORTEST_S` and `SAMPLES` say.
        movement: Movement that is clear [axis unit].
        sampled: Returns the time of the newest sample [s].
        output: Name of the axis' output, for messages.
        unit: Of the voltage, likewise.
    """

    CLEAR = 3
    """One sample may be noise; so many in a row beyond `movement`, on one side, are not."""
    ENOUGH = 5
    """Samples without which a pulse says nothing: two for the way there and back, then the clear ones."""
    SAMPLES = 10
    """A pulse whose length nobody chose has room for so many: as above, and five for the actuator to move."""
    SHORTEST_S = 0.05
    """And it has at least this length, which shows the movement of all but slow actuators; chosen."""
    STRAIGHT, NOISY = 0.15, 1.2
    """What a drift that is a straight line may be off at the end of the pulse, over the movement that is
    clear; or its scatter, over the noise that neighbouring samples show. A ring of 0.5 of the movement, a
    step of 0.4 while five samples were watched, and a load that a first pulse without a verdict had left
    moving came out as a wrong sign."""
    WATCHES = 40
    """Times that it watches a drift that is no straight line; then it pulses all the same: 2 s by default."""
    TRIES = 3
    """Pulses after which saying nothing is a fault."""

    def __init__(
        self,
        start: float,
        voltage: float,
        duration: float | None,
        movement: float,
        sampled: Callable[[], float],
        output: str = "<name>",
        unit: str = "V",
    ) -> None:
        self.voltage, self.duration, self.movement = voltage, duration, movement
        self.sampled, self.output, self.unit = sampled, output, unit
        self.result: PolarityResult | None = None
        self.tries = self.watches = 0
        self._watch(start)

    def _watch(self, t: float) -> None:
        """Begin to watch the drift at `t` [s]."""
        self.start, self.began, self.seen = t, math.inf, -math.inf
        self.longest = self.SHORTEST_S if self.duration is None else self.duration
        self.drift = DriftLine()
        self.samples = self.clear = 0
        self.moved = math.nan

    def step(self, t: float, e: float) -> float:
        """Nothing, then the pulse, then nothing for good."""
        if self.result is not None:
            return 0.0
        sampled = self.sampled()
        fresh, self.seen = sampled > self.seen, sampled
        if self.began == math.inf:
            return self._before(t, sampled, e, fresh)
        if fresh and sampled > self.began:
            self._look(self.drift.at(sampled - self.start) - e)
        if abs(self.clear) >= self.CLEAR or t - self.began >= self._longest():
            self._conclude(t)
        return self.voltage if self.began < math.inf and self.result is None else 0.0

    def _before(self, t: float, sampled: float, e: float, fresh: bool) -> float:
        """Watch the drift; the pulse begins at the end of it."""
        drift = self.drift
        if fresh and sampled >= self.start:
            drift.add(sampled - self.start, e)
        if t - self.start < self.longest or drift.n < (self.CLEAR if self.duration else self.SAMPLES):
            return 0.0
        self.watches += 1
        off, straight = drift.leverage(t - self.start + self.longest), self.STRAIGHT * self.movement
        if drift.scatter() > max(straight / off, self.NOISY * drift.noise()) and self.watches < self.WATCHES:
            self._watch(t)
            return 0.0
        if self.duration is None:
            self.longest = max(self.SHORTEST_S, self.SAMPLES * (t - self.start) / drift.n)
        self.began = t
        return self.voltage

    def _longest(self) -> float:
        """Of the pulse [s]: twice its length where that is our choice and its last samples begin to tell."""
        return 2.0 * self.longest if self.duration is None and self.clear else self.longest

    def _look(self, moved: float) -> None:
        """Take a sample of the pulse."""
        self.samples, self.moved = self.samples + 1, moved
        if abs(moved) < self.movement:
            self.clear = 0
        else:
            self.clear = max(self.clear, 0) + 1 if moved > 0.0 else min(self.clear, 0) - 1

    def _conclude(self, t: float) -> None:
        """The pulse has shown the sign, or its time is over."""
        self.tries += 1
        mute = 0 < abs(self.clear) < self.CLEAR or self.samples < self.ENOUGH
        if mute and abs(self.clear) < self.CLEAR and self.tries < self.TRIES:
            self._watch(t)
            return
        pulsed = f"{self.voltage:+.3g} {self.unit} for {(t - self.began) * 1e3:.0f} ms"
        ok, why = self._verdict(f"{pulsed} moved the sensor by {self.moved:+.3g}")
        self.result = PolarityResult(ok, self.moved, why)

    def _verdict(self, what: str) -> tuple[bool, str]:
        length = f"polarity.duration (now {self.longest:.3g} s)"
        if self.clear >= self.CLEAR:
            return True, what
        if self.clear <= -self.CLEAR:
            return False, f"wrong sign: {what}; turn the sign of the sensor's or the output's scale"
        if self.samples < self.ENOUGH:
            few = f"in {self.samples} samples, and {self.ENOUGH} are needed: ticks or samples come late"
            return False, f"no verdict: {what} {few}; a longer {length}"
        if self.clear:
            last = f"beyond polarity.movement = {self.movement:.3g} in the last {abs(self.clear)} samples"
            return False, f"no verdict: {what}, {last}, and {self.CLEAR} are needed; a longer {length}"
        enabled = f"the amplifier enabled (outputs.{self.output}.enable)?"
        advice = f"is the pressure on, the valve connected, {enabled}"
        keys = f"else a higher polarity.pulse, a longer {length} or a smaller polarity.movement"
        less = f"less than polarity.movement = {self.movement:.3g}"
        return False, f"no movement: {what}, {less}; {advice} {keys}"
