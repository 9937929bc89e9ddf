"""The guard alone decides what reaches an actuator. Pure: time and values in, verdicts out.

Inputs are inspected before the controllers run, commands after them. A verdict is a `Trip`: it drives the
rig, or under `guard.fault_policy: axis` the axis, to neutral in the same tick and latches. Limits of output
and slew clip instead.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from seod.loop.motion import SpeedMeter, SwingMeter, SwitchMeter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.base import Sample
    from seod.config.axis import LimitsConfig
    from seod.config.guard import EstopConfig, GuardConfig
    from seod.loop.sensor import Sensor
    from seod.loop.validity import Gate

SUPERVISOR_SILENT_S = 0.18
"""A supervisor without a turn for this long stands still, or for `loop.hang_timeout` if that is longer.

Told within 200 ms; a virtual machine whose processor was taken from it for 100 ms has time enough.
"""

JUMP_OF_TRAVEL = 0.1
"""A step between two samples of more than this part of the travel is told as a jump. Chosen."""
FLIP_LIKENESS = 0.1
"""Readings whose sum is at most this part of their difference have one size and opposite signs. Chosen."""

LONGER = 4.0
"""A relay that stays on one side for so many times its longest stay of late no longer sees its axis. Chosen:
a plant whose omega_n falls to half doubles a stay, and so does a second phase.
"""


@dataclass(frozen=True, slots=True)
class Trip:
    """Why the guard stopped the rig: a code for programs, a sentence for people, the numbers behind it."""

    code: str
    why: str
    numbers: dict[str, float] = field(default_factory=dict)


class AxisGuard:
    """Limits of one axis.

    Args:
        name: The axis, for messages.
        limits: Its limits, in SI units.
        guard: The rig's guard settings.
        quantity: What the sensor measures, for messages.
    """

    SPEED_WINDOW_S = 5e-3

    def __init__(
        self, name: str, limits: LimitsConfig, guard: GuardConfig, quantity: str = "position"
    ) -> None:
        self.name = name
        self.quantity = quantity
        self.limits = limits
        self.guard = guard
        self.speed = SpeedMeter(self.SPEED_WINDOW_S)
        self.swing: SwingMeter | None = None
        self.switches: SwitchMeter | None = None
        self.amplitude = 0.0
        """Half the peak-to-peak movement over about the last second [unit of the position]."""
        self.sensor: Sensor | None = None
        """What the axis measures with, where it can be in trouble."""
        self.gates: Sequence[Gate] = ()
        """What may keep its samples from it."""
        self.moved_at = -math.inf
        self.last_y = math.nan
        self.last_u = 0.0
        self.last_t = -math.inf

    def ready(self, t: float, sample: Sample, y: float) -> Trip | None:
        """Why this axis could not be moved now: silent, unsound or non-finite sensor, outside its travel."""
        low, high = self.limits.travel
        sound = self.sensor is None or not self.sensor.trouble
        if sound and low <= y <= high and t - sample.t <= self.guard.stale:
            return None  # at nearly every tick; which of them it is takes longer to tell
        return self._stale(t, sample) or self._unsound() or self._finite(y) or self._travel(y)

    def begin(self) -> None:
        """The axis is about to move: what it did while nobody looked says nothing about its speed."""
        self.speed.points.clear()
        self.last_y = math.nan

    def settings_changed(self) -> None:
        """The limit cycle may be another one: how long its halves lasted before says nothing any more."""
        self.switches = None

    def inspect(
        self,
        t: float,
        sample: Sample,
        y: float,
        swing: float | None,
        exciting: bool,
        growth_counts: bool,
        side: float = 0.0,
    ) -> Trip | None:
        """Judge the newest sample of a moving axis.

        Args:
            t: Tick time [s].
            sample: Raw sample, for its time.
            y: Measurement in SI units.
            swing: What swings in the limit cycle [unit of the position]; None while nothing should.
            exciting: The relay is on: the sensor must move.
            growth_counts: The relay has been at its amplitude long enough for growth to mean something.
            side: Of the relay, 1 or -1; 0 while it is off or comes to its amplitude.
        """
        trip = self.ready(t, sample, y) or self._speed(sample, y)
        if trip is not None:
            return self._with_jump(trip, y)
        return (
            self._amplitude(t, swing, growth_counts)
            or self._frozen(t, y, exciting)
            or self._no_switch(t, side)
        )

    def pass_command(self, t: float, u: float) -> float:
        """Clip a command to output and slew limits [V]; `u` must be finite."""
        limit = self.limits.output
        out = u if -limit <= u <= limit else math.copysign(limit, u)
        if self.limits.slew is not None:
            step = self.limits.slew * min(t - self.last_t, 1.0)
            out = max(self.last_u - step, min(self.last_u + step, out))
        self.last_u, self.last_t = out, t
        return out

    def neutral(self, t: float) -> None:
        """Note that the output went to neutral, past the slew limit."""
        self.last_u, self.last_t = 0.0, t

    def _stale(self, t: float, sample: Sample) -> Trip | None:
        age = t - sample.t
        if age <= self.guard.stale:
            return None
        invalid = [gate.why for gate in self.gates if gate.why]
        heard = f"{age * 1e3:.1f} ms old" if math.isfinite(age) else "never heard of"
        newest = "newest valid sample" if invalid else "newest sample"
        limit = f"guard.stale is {self.guard.stale * 1e3:.1f} ms"
        return Trip(
            "stale_sample",
            "; ".join([f"{self.name}: the sensor's {newest} is {heard}", *invalid, limit]),
            {"age_s": age if math.isfinite(age) else -1.0, "limit_s": self.guard.stale},
        )

    def _unsound(self) -> Trip | None:
        if self.sensor is None or not self.sensor.trouble:
            return None
        return Trip("sensor_range", f"{self.name}: {self.sensor.trouble}")

    def _finite(self, y: float) -> Trip | None:
        if math.isfinite(y):
            return None
        return Trip("non_finite", f"{self.name}: the sensor reads {y}")

    def _travel(self, y: float) -> Trip:
        """Of a sample that is fresh, sound and finite, and in trouble all the same."""
        low, high = self.limits.travel
        return Trip(
            "travel",
            f"{self.name}: {self.quantity} {y:.6g} is outside limits.travel [{low:.6g}, {high:.6g}]",
            {self.quantity: y, "low": low, "high": high},
        )

    def _speed(self, sample: Sample, y: float) -> Trip | None:
        most = self.limits.speed
        if most is None or sample.t <= (self.speed.points[-1][0] if self.speed.points else -math.inf):
            return None
        speed = self.speed.update(sample.t, y)
        if abs(speed) <= most:
            return None
        return Trip(
            "speed",
            f"{self.name}: speed {speed:.4g} is over limits.speed {most:.4g}",
            {"speed": speed, "limit": most},
        )

    def _with_jump(self, trip: Trip, y: float) -> Trip:
        """A trip, with what a step from the sample before looks like where no actuator moves so."""
        last, (low, high) = self.last_y, self.limits.travel
        jumped = abs(y - last) > JUMP_OF_TRAVEL * (high - low)
        if not jumped or trip.code not in ("travel", "speed"):
            return trip
        flipped = abs(y + last) <= FLIP_LIKENESS * abs(y - last)
        guess = "its sign may have flipped" if flipped else "the sensor may be at fault"
        went = f"the reading went from {last:.3g} to {y:.3g} between two samples"
        return replace(trip, why=f"{trip.why}: {went}; {guess}")

    def _amplitude(self, t: float, y: float | None, growth_counts: bool) -> Trip | None:
        if y is None:
            self.swing, self.amplitude = None, 0.0
            return None
        if self.swing is None:
            self.swing = SwingMeter(t)
        if growth_counts and not self.swing.watched:
            self.swing.watch_growth()
        swing = self.amplitude = self.swing.update(t, y)
        if swing > self.limits.amplitude:
            return Trip(
                "amplitude",
                f"{self.name}: amplitude {swing:.4g} is over limits.amplitude {self.limits.amplitude:.4g}",
                {"amplitude": swing, "limit": self.limits.amplitude},
            )
        growth = self.swing.growth
        if self.swing.watched and growth > self.limits.growth and swing > 0.1 * self.limits.amplitude:
            return Trip(
                "amplitude_growth",
                f"{self.name}: the oscillation grew {growth:.3g} times within a few periods; "
                f"limits.growth is {self.limits.growth:.3g}",
                {"growth": growth, "limit": self.limits.growth, "amplitude": swing},
            )
        return None

    def _frozen(self, t: float, y: float, exciting: bool) -> Trip | None:
        if y != self.last_y or not exciting:
            self.last_y, self.moved_at = y, t
            return None
        still = t - self.moved_at
        if still <= self.guard.frozen:
            return None
        return Trip(
            "frozen_sensor",
            f"{self.name}: the sensor has read {y:.6g} for {still * 1e3:.0f} ms while the relay is on; "
            f"guard.frozen is {self.guard.frozen * 1e3:.0f} ms",
            {self.quantity: y, "still_s": still, "limit_s": self.guard.frozen},
        )

    def _no_switch(self, t: float, side: float) -> Trip | None:
        if side == 0.0:
            self.switches = None
            return None
        if self.switches is None:
            self.switches = SwitchMeter(t, side)
        stay, usual = self.switches.update(t, side), self.switches.usual
        limit = self.guard.no_switch
        if usual is not None:
            limit = min(limit, max(self.guard.frozen, LONGER * usual))
        if stay <= limit:
            return None
        before = "" if usual is None else f"; it was {usual * 1e3:.0f} ms at most before"
        return Trip(
            "no_switch",
            f"{self.name}: the relay has been on one side for {stay * 1e3:.0f} ms, at most "
            f"{limit * 1e3:.0f} ms is allowed (guard.no_switch){before}: "
            "the sensor does not show this axis, or the axis does not move",
            {"stay_s": stay, "limit_s": limit},
        )


class OverrunGuard:
    """Trips on a burst of late ticks."""

    def __init__(self, count: int, window: float) -> None:
        self.count, self.window = count, window
        self.late: deque[float] = deque(maxlen=count)

    def inspect(self, t: float, lateness: float, period: float) -> Trip | None:
        """Note a tick that began `lateness` [s] late; a trip if that was one too many."""
        if lateness <= period:
            return None
        self.late.append(t)
        if len(self.late) < self.count or t - self.late[0] > self.window:
            return None
        return Trip(
            "overruns",
            f"{self.count} ticks within {self.window * 1e3:.0f} ms were more than a period late, the last by "
            f"{lateness * 1e3:.2f} ms",
            {"count": float(self.count), "lateness_s": lateness, "period_s": period},
        )


class SupervisorGuard:
    """Trips when the supervisor stands still: nobody would put the rig to neutral if the loop died now.

    Its silence is counted in ticks and not on the clock: a machine that was paused has paused both.

    Args:
        period: Of a tick [s]; inf where ticks follow no clock, and nothing is watched.
        hang_timeout: Silence of the loop that counts as a hang [s]: so much the supervisor may have too.
    """

    def __init__(self, period: float, hang_timeout: float = 0.0) -> None:
        self.period = period
        self.limit_s = max(SUPERVISOR_SILENT_S, hang_timeout)
        self.limit = math.ceil(self.limit_s / period) if period < math.inf else math.inf
        self.beats = self.silent = 0

    def inspect(self, beats: int) -> Trip | None:
        """Note the supervisor's count of turns (0: there is none); a trip while it has not moved for long."""
        if beats != self.beats or beats == 0:
            self.beats, self.silent = beats, 0
            return None
        self.silent += 1
        if self.silent < self.limit:
            return None
        still = self.silent * self.period
        return Trip(
            "supervisor",
            f"the supervisor process has stood still for {still * 1e3:.0f} ms (stopped, or held up): "
            "nothing would stop the rig if the loop died; have it run again, then reset",
            {"still_s": still, "limit_s": self.limit_s},
        )


def hung(lateness: float, limit: float) -> Trip | None:
    """A loop that slept through `limit` [s] (stopped and woken) must not act on the old world."""
    if lateness <= limit:
        return None
    return Trip(
        "hang",
        f"the loop stood still for {lateness * 1e3:.0f} ms; loop.hang_timeout is {limit * 1e3:.0f} ms",
        {"lateness_s": lateness, "limit_s": limit},
    )


def estop_open(lines: Sequence[tuple[EstopConfig, Sample]], t: float, stale: float) -> Trip | None:
    """Every e-stop line must be heard of and must allow movement; those that do not are named.

    Args:
        lines: Each with its newest sample.
        t: Tick time [s].
        stale: Oldest sample that counts [s].
    """
    stopping = [(line, s) for line, s in lines if s.value != line.run or not t - s.t <= stale]  # a nan stops
    if not stopping:
        return None
    line, sample = stopping[0]
    return Trip(
        "estop",
        "e-stop: "
        + "; ".join(_estop_text(line, t - sample.t, sample.value, stale) for line, sample in stopping),
        {
            "value": sample.value if math.isfinite(sample.value) else -1.0,
            "run": line.run,
            "age_s": t - sample.t if math.isfinite(sample.t) else -1.0,
            "limit_s": stale,
        },
    )


def _estop_text(line: EstopConfig, age: float, value: float, stale: float) -> str:
    if not math.isfinite(age):
        return f"the channel {line.channel} was never heard of"
    if age > stale:
        silent = f"the channel {line.channel} has been silent for {age * 1e3:.1f} ms"
        return f"{silent} (guard.stale is {stale * 1e3:.1f} ms)"
    return f"{line.channel} reads {value:g}, movement is allowed at {line.run:g}"


def silent(samples: Sequence[Sample], t: float, stale: float) -> Trip | None:
    """Nothing at all has come from the rig: it is no channel's own silence, least of all an e-stop's.

    Args:
        samples: The newest of each channel.
        t: Tick time [s].
        stale: Oldest sample that counts [s].
    """
    age = t - max([sample.t for sample in samples])
    if age <= stale:
        return None
    heard = f"for {age * 1e3:.1f} ms" if math.isfinite(age) else "since the start"
    return Trip(
        "silent",
        f"nothing has come from the rig {heard} (guard.stale is {stale * 1e3:.1f} ms): "
        "is it switched on, and does the line hold?",
        {"age_s": age if math.isfinite(age) else -1.0, "limit_s": stale},
    )


def dead_man(limit: float | None, t: float, last_keepalive: float) -> Trip | None:
    """A client must be heard of while the rig moves."""
    if limit is None or t - last_keepalive <= limit:
        return None
    return Trip(
        "dead_man",
        f"no client called keepalive for {t - last_keepalive:.2f} s; guard.dead_man is {limit:.2f} s",
        {"silent_s": t - last_keepalive, "limit_s": limit},
    )
