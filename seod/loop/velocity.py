"""Velocity control (Fig. 6b): a relay on the integral of the speed's error, about a constant speed.

The integrator in front of the relay takes the place of the plant's own in Fig. 2, and of a noise filter.
Behind the relay the bias reference / K_L opens the valve as far as the speed needs. What is wrong with it,
unless trimmed, shows as unequal halves of the limit cycle; where that reaches e_a the oscillation stops.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.loop.excite import Coast, Controller, Relay
from seod.loop.position import Settling

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.config.axis import AxisConfig

STUCK_S = 1.0
"""A relay that has not switched for this long, and for four half cycles, does not oscillate."""
TRIM_GAIN = 0.2
"""Part of the mean relay voltage of a cycle that is moved into the bias."""
TRIM_RATE = 1.0
"""While nothing oscillates the trim moves by this many e_a per second."""
DEADBAND = 0.02
"""Mean relay voltage, in parts of e_a, that is left: below it the halves are equal within a tick or so."""
WINDUP = 1.05
"""The integral is kept within this many limits.amplitude: the guard sees too large a swing, no more."""
STUCK_WINDUP = 0.1
"""While nothing oscillates it is kept this near the relay's threshold, in parts of limits.amplitude."""
RAMP = 2.0
"""Default ramp: the bias moves by this many e_a per second."""


class DutyMeter:
    """How long the relay stayed on each side."""

    def __init__(self, t: float) -> None:
        self.switched = t
        self.sign = 0.0
        self.up = self.down = 0.0

    def note(self, t: float, sign: float) -> float | None:
        """Take one tick; at the end of a cycle the mean of the relay's output in it, from -1 to 1."""
        if sign == self.sign:
            return None
        if sign < 0.0:
            self.up = t - self.switched
        elif self.sign < 0.0:
            self.down = t - self.switched
        self.sign, self.switched = sign, t
        whole = sign > 0.0 < self.up and self.down > 0.0
        return (self.up - self.down) / (self.up + self.down) if whole else None

    def stuck(self, t: float) -> bool:
        """Whether the relay has stayed where it is for so long that nothing oscillates."""
        return t - self.switched > max(STUCK_S, 4.0 * self.up, 4.0 * self.down)


class VelocityMode:
    """See `seod.loop.mode.Mode`.

    Args:
        config: The axis.
        settings: Its settings in force; the axis changes them.
        warn: Takes a code and a sentence for the clients.
    """

    quantity = "speed"
    approaches = True
    has_ends = False

    def __init__(
        self, config: AxisConfig, settings: dict[str, float], warn: Callable[[str, str], None]
    ) -> None:
        self.config = config
        self.settings = settings
        self.warn = warn
        self.reference = 0.0
        self.bias = settings["bias"]
        self.trim = 0.0
        self.y = math.nan
        self.integral = 0.0
        self.rest = True
        self.t = self.t_sample = self.e_sample = math.nan
        self.K_L = math.nan
        self.duty: DutyMeter | None = None
        self.warned: set[str] = set()
        self.settling = Settling(config.hold.timeout)

    @property
    def error(self) -> float:
        """Reference - speed [axis unit/s]."""
        return self.reference - self.y

    @property
    def signal(self) -> float:
        """The integral of the error since the relay is on [axis unit]."""
        return self.integral

    @property
    def swing(self) -> float | None:
        """The integral; None while nothing oscillates."""
        return None if "bias" in self.warned else self.integral

    @property
    def target(self) -> float:
        """Where the reference is going [axis unit/s]."""
        return 0.0 if self.rest else self.settings["reference"]

    def start(self, y: float) -> None:  # noqa: ARG002 - a mode's form
        """From standstill, and from an untrimmed bias."""
        self.reference = self.trim = self.integral = 0.0
        self.bias = self.settings["bias"]
        self.rest, self.duty, self.t = True, None, math.nan

    def sense(self, t: float, y: float, filtered: float) -> None:  # noqa: ARG002 - the integrator is the filter
        """Integrate the error by the trapezoidal rule, while the relay is on."""
        self.y = y
        error = self.reference - y
        if self.duty is not None:
            self._integrate(0.5 * (error + self.e_sample) * (t - self.t_sample))
        self.t_sample, self.e_sample = t, error

    def _integrate(self, step: float) -> None:
        amplitude = self.config.limits.amplitude
        most = WINDUP * amplitude
        if "bias" in self.warned:
            most = self.settings["hysteresis"] + STUCK_WINDUP * amplitude
        self.integral = max(-most, min(most, self.integral + step))

    def hold(self, t: float, rest: bool) -> Controller:
        """The bias alone: it follows the reference, which goes to the wanted speed, or to 0."""
        self.rest, self.duty, self.integral = rest, None, 0.0
        self.settling.begin(t)
        return Coast()

    def arrived(self, t: float) -> bool:
        """Whether the reference is where it should be, and the speed near it."""
        if self.reference != self.target:
            self.settling.begin(t)
            return False
        tolerance = self.config.hold.tolerance or 0.5 * self.K_L * self.settings["e_a"]
        return self.settling.done(t, abs(self.error) <= tolerance)

    def absorb(self, K_L: float) -> None:
        """What the trim has put right of a wrong gain is in the gain now."""
        more = self.reference / K_L - self.reference / self.K_L
        if self.trim * more > 0.0:
            self.trim = toward(0.0, self.trim, abs(more))

    def relay_on(self, t: float) -> None:
        """The integral begins at the relay's threshold."""
        self.integral = 0.0
        self.warned.clear()
        self.duty = DutyMeter(t)

    def advance(self, t: float, K_L: float, relay: Relay | None) -> None:
        """Ramp the reference, trim, and let the bias follow both without a jump."""
        dt = t - self.t if math.isfinite(self.t) else 0.0
        self.t, self.K_L = t, K_L
        ramp = self.config.ramp or RAMP * self.settings["e_a"] * K_L
        self.reference = toward(self.target, self.reference, ramp * dt)
        if relay is not None and self.duty is not None:
            self._watch(t, dt, relay, self.duty)
        bias = self.reference / K_L + self.settings["bias"] + self.trim
        self.bias = toward(bias, self.bias, 2.0 * ramp / K_L * dt)

    def _watch(self, t: float, dt: float, relay: Relay, duty: DutyMeter) -> None:
        """Trim by the relay's mean voltage, cycle by cycle; find out that nothing oscillates."""
        e_a = relay.amplitude(t)
        mean = duty.note(t, relay.sign)
        if mean is not None:
            self.warned.clear()
            if abs(mean) > DEADBAND and not relay.turning:
                self._trim(TRIM_GAIN * mean * e_a)
        elif duty.stuck(t):
            self._tell_stuck(relay)
            self._trim(TRIM_RATE * relay.sign * e_a * dt)

    def _trim(self, step: float) -> None:
        if self.settings["trim"]:
            most = self.settings["e_a"]
            self.trim = max(-most, min(most, self.trim + step))

    def _tell_stuck(self, relay: Relay) -> None:
        e_a, unit = relay.sign * self.settings["e_a"], self.config.command_unit
        what = (
            f"the oscillation has stopped: the relay stands at {e_a:+.3g} {unit}, the speed at {self.y:.4g}"
        )
        advice = "the bias is wrong by e_a or more: correct K_L (supply pressure) or relay.bias, or raise e_a"
        trimming = "; the trim follows" if self.settings["trim"] else ", or let it be trimmed"
        self._warn_once("bias", f"{what} of {self.reference:.4g}; {advice}{trimming}")
        if self.settings["trim"] and abs(self.trim) >= self.settings["e_a"]:
            self._warn_once(
                "trim", f"the trim has reached its bound {self.trim:+.3g} {unit}; {what}; {advice}"
            )

    def _warn_once(self, code: str, why: str) -> None:
        if code not in self.warned:
            self.warned.add(code)
            self.warn(code, why)


def toward(goal: float, value: float, step: float) -> float:
    """`value`, brought nearer to `goal` by at most `step`."""
    return goal if abs(goal - value) <= step else value + math.copysign(step, goal - value)
