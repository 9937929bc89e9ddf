"""What to drive for a calibration, and in which order. Each drive ends well within the travel.

The rig is a `Rig`: the client over TCP, or a test bench. Nothing here waits, reads a clock or knows a socket.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from seod.calibrate.delay import fit_response
from seod.calibrate.static import characteristic, steady_speed
from seod.calibrate.value import mean

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.calibrate.delay import Response
    from seod.calibrate.recording import Recording
    from seod.calibrate.static import Point, Static
    from seod.calibrate.value import Value

ROOM = 0.6
"""Share of the way to a limit of travel that a drive may use."""
PULSES = 6
REMAINDER = 1.0 / 1000.0
"""A speed is steady once no more than this of the transient is left."""
LEVELS = (1.0, 0.5, 0.75, 0.35)
"""Voltages beyond the deadband, as shares of the largest."""
REPEATS = 2
MOVES_SD = 6.0
"""Standard deviations of a speed that count as movement."""


class CalibrationError(Exception):
    """The calibration cannot go on; the message says why and what would help."""


class Rig(Protocol):
    """What the procedure needs of one axis."""

    def drive(self, volts: float, duration: float, stay: bool = False) -> Recording:
        """Put out `volts` [V], the bias added, for `duration` [s]; returns once the axis is idle again.

        It goes back to where it began, unless it is to `stay`.
        """

    def position(self) -> float:
        """Newest reading of the sensor [axis unit]."""

    def set_bias(self, volts: float) -> None:
        """Change the axis' bias [V]."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is known beforehand.

    Attributes:
        K_L: About the gain [axis unit/s/V]; within a factor of two.
        travel: Limits of the sensor's reading [axis unit].
        output: Limit of the voltage [V].
        pulse: Largest step of the first pulses [V].
        bias: The bias in force [V].
        measures_speed: The sensor measures the speed.
        unit: Of the voltages, for messages.
    """

    K_L: float
    travel: tuple[float, float]
    output: float
    pulse: float
    bias: float = 0.0
    measures_speed: bool = False
    unit: str = "V"


@dataclass(frozen=True, slots=True)
class Edge:
    """Edge of the deadband in one direction [V]: still at `still`, moving at `moves`."""

    still: float
    moves: float


@dataclass(frozen=True, slots=True)
class Result:
    """Everything that was measured on one axis; `response` is the last pulse's."""

    static: Static
    up: Edge
    down: Edge
    delay: Value
    response: Response


class Procedure:
    """Calibrates one axis.

    Args:
        rig: The axis, idle.
        plan: What is known of it.
        say: Takes a sentence on what is done now, and the share that is done.
    """

    def __init__(self, rig: Rig, plan: Plan, say: Callable[[str, float], None]) -> None:
        self.rig = rig
        self.plan = plan
        self.say = say
        self.bias = plan.bias
        self.start = rig.position()
        low, high = plan.travel
        self.room = ROOM * min(high - self.start, self.start - low)
        if self.room <= 0.0:
            raise CalibrationError(
                f"it stands at {self.start:.4g}: limits.travel leaves no room to both sides"
            )

    def run(self) -> Result:
        """All of it; the actuator ends where it stood.

        Raises:
            CalibrationError: Something does not fit; says what.
        """
        self.say("polarity and drift", 0.0)
        self.level()
        self.say("loop delay", 0.1)
        responses = self.pulses()
        settling = max(response.settling(REMAINDER) for response in responses)
        self.say("deadband", 0.3)
        up, down = self.edge(1.0, settling), self.edge(-1.0, settling)
        static = self.speeds(settling, up, down)
        self.back()
        delay = mean([response.delay for response in responses])
        return Result(static, up, down, delay, responses[-1])

    def level(self) -> None:
        """Let the guard check the polarity, then take the drift away with the bias."""
        self.rig.drive(0.0, 0.1)
        drift = self._speed(0.0, 0.2, 0.1)
        if abs(drift.speed) > MOVES_SD * drift.sd and not self.plan.measures_speed:
            self.bias -= drift.speed / self.plan.K_L
            if abs(self.bias) > 0.5 * self.plan.output:
                what = f"it drifts by {drift.speed:.4g}/s at {drift.volts:.4g} {self.plan.unit}"
                raise CalibrationError(f"{what}: the null is too far off; adjust the valve first")
            self.rig.set_bias(self.bias)

    def pulses(self) -> list[Response]:
        """Pulses up and down; the first two only tell how long the others must be."""
        length = 0.15
        first = [self._pulse(sign, length) for sign in (1.0, -1.0)]
        slowest = min(response.omega_n for response in first)
        length = min(2.0, max(0.08, 12.0 / slowest))
        return [self._pulse(1.0 - 2.0 * (k % 2), length) for k in range(PULSES)]

    def _pulse(self, sign: float, length: float) -> Response:
        volts = min(self.plan.pulse, self._most(length))
        drive = self._drive(sign * volts, length)
        try:
            return fit_response(drive, self.plan.K_L, self.plan.measures_speed)
        except ValueError as error:
            raise CalibrationError(f"pulse of {sign * volts:.3g} {self.plan.unit}: {error}") from error

    def edge(self, sign: float, settling: float) -> Edge:
        """Edge of the deadband: a slow staircase until it moves, then halving."""
        length = settling + 0.3
        still, moves = 0.0, self._most(length) / 32.0
        while not self._moves(sign * moves, length):
            still, moves = moves, 2.0 * moves
            if moves + abs(self.bias) > self.plan.output:
                raise CalibrationError(
                    f"it does not move at {sign * still:+.3g} {self.plan.unit}: is the pressure on?"
                )
        for _ in range(3):
            middle = 0.5 * (still + moves)
            if self._moves(sign * middle, length):
                moves = middle
            else:
                still = middle
        return Edge(self.bias + sign * still, self.bias + sign * moves)

    def _moves(self, volts: float, length: float) -> bool:
        point = self._speed(volts, length, 0.5 * length)
        speed = point.speed if volts > 0.0 else -point.speed
        return speed > max(MOVES_SD * point.sd, 0.2 * self.plan.K_L * self._most(length) / 32.0)

    def speeds(self, settling: float, up: Edge, down: Edge) -> Static:
        """Static characteristic outside the deadband, up and down alternating."""
        points = []
        most = self._most(settling + 0.25)
        steps = [(repeat, level) for repeat in range(REPEATS) for level in LEVELS]
        for k, (_, level) in enumerate(steps):
            self.say("static gain", 0.5 + 0.5 * k / len(steps))
            length = min(settling + 0.6, self.room / (self.plan.K_L * level * most))
            for sign, edge in ((1.0, up), (-1.0, down)):
                beyond = 0.0 if abs(edge.moves - self.bias) < 0.1 * most else edge.moves - self.bias
                points.append(self._speed(beyond + sign * level * most, length, settling))
        try:
            return characteristic(points, self.bias)
        except ValueError as error:
            raise CalibrationError(str(error)) from error

    def back(self) -> None:
        """Return to where the axis stood at first."""
        if self.plan.measures_speed:
            return
        off = self.rig.position() - self.start
        length = 0.5
        if abs(off) > 0.02 * self.room:
            self.rig.drive(-off / (length * self.plan.K_L), length, stay=True)

    def _most(self, length: float) -> float:
        """Largest voltage that leaves room for a drive of `length` [s], from the deadband's edge on [V]."""
        reach = self.room if self.plan.measures_speed else self.room / length
        return min(reach / self.plan.K_L, 0.5 * self.plan.output)

    def _speed(self, volts: float, length: float, after: float) -> Point:
        try:
            return steady_speed(self._drive(volts, length), after, self.plan.measures_speed)
        except ValueError as error:
            raise CalibrationError(str(error)) from error

    def _drive(self, volts: float, length: float) -> Recording:
        if not self.plan.measures_speed and abs(self.rig.position() - self.start) > 0.2 * self.room:
            self.back()
        return self.rig.drive(volts, length)
