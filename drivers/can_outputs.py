"""The way out: commands, bounded in flight, and neutral first whenever the bus was in trouble."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from drivers import can_counters as count

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import can

    from drivers.can_commands import CommandFrame
    from drivers.can_config import CanOptions
    from drivers.can_fixed import FixedFrames
    from drivers.can_link import CanLink

PROBE_S = 0.01
"""Time between attempts to send neutral over an interface that is down."""
CYCLE_S = 0.1
"""Least time between two whole cycles of neutral: one of 16 frames takes 2 ms of a bus of 1 Mbit/s."""
TAKEOVER_S = 1.0
"""For so long after the start, neutral that is not ours is the supervisor's, who held the rig before us."""


class CanOutputs:
    """Sends the command frames of one bus.

    Attributes:
        trouble: Why commands cannot leave ("" while they can).
        blocked: Nothing but neutral may leave until one neutral frame has.
        foreign: Command frames that somebody else sent.

    Args:
        options: Of the driver.
        link: The bus.
        commands: The output messages.
        neutral: Neutral value of each output.
        fixed: The frames that never change; the opening ones are sent again when the bus returns.
        counts: The driver's health counters.
        clock: The loop's clock [s].
    """

    def __init__(
        self,
        options: CanOptions,
        link: CanLink,
        commands: Sequence[CommandFrame],
        neutral: Sequence[float],
        fixed: FixedFrames,
        counts: list[int],
        clock: Callable[[], float],
    ) -> None:
        self.trouble = ""
        self.blocked = False
        self.foreign = 0
        self._newest_foreign: tuple[CommandFrame, bytes, bool] | None = None
        self._counters_unsure = False
        """Whether the rig may expect another sequence counter than our next one."""
        self._cycle_due = -math.inf
        self._takeover: tuple[float, frozenset[bytes]] = (-math.inf, frozenset())
        self._room = options.max_in_flight
        self._timeout = options.confirm_timeout_s
        self._link = link
        self._commands = commands
        self._by_id = {(c.message.arbitration_id, c.message.is_extended_id): c for c in commands}
        self._neutral = neutral
        self._left = [math.nan] * len(neutral)
        self._fixed = fixed
        self._counts = counts
        self._clock = clock
        self._stuck = False
        self._failures = link.failures
        self._next_probe = -math.inf

    def write(self, t: float, values: Sequence[float]) -> float:
        """Send each command that has room, remember the others; when the last left [s], nan if none did."""
        if self.blocked:
            return self._recover(t)
        return self._send_all(values, self._room)

    def neutral(self, t: float) -> float:
        """As `write`, with one reserved place, and instead of anything remembered."""
        if self.blocked:
            return self._recover(t)
        if self._counters_unsure and t >= self._cycle_due:
            self._cycle_due = t + CYCLE_S
            return self._send_cycle()
        return self._send_all(self._neutral, self._room + 1)

    def _send_cycle(self) -> float:
        """Neutral with every value of the sequence counters: the rig may go on from a foreign command's."""
        self._counters_unsure = False
        left = math.nan
        for command in self._commands:
            for _ in range(max(1, command.period)):
                left = self._send(command, self._neutral)
                if math.isnan(left):
                    break
        return left

    def _send_all(self, values: Sequence[float], room: float) -> float:
        left = math.nan
        for command in self._commands:
            if command.in_flight < room:
                left = self._send(command, values)
            else:
                self._counts[count.DEFERRED] += 1
                command.waiting = values
        return left

    def _send(self, command: CommandFrame, values: Sequence[float]) -> float:
        if self._link.send(command.load(values)):
            t = self._clock()
            command.mark_sent(t)
            return t
        command.waiting = values
        self.judge(self._clock())
        return math.nan

    def _recover(self, t: float) -> float:
        """After trouble: neutral now and then until it leaves; only then commands again."""
        if self.trouble and t < self._next_probe:
            return math.nan
        in_flight = max((command.in_flight for command in self._commands), default=0)
        self._next_probe = t + (self._timeout * (1 + in_flight) if self._stuck else PROBE_S)
        self._link.reopen(t)
        if self._link.bus_off:  # what is queued now would leave late, after the restart
            return math.nan
        left = self._send_all(self._neutral, math.inf)
        self.judge(self._clock())
        if not self.trouble and not self.neutral_waits:
            self.blocked = False
            self._fixed.send_start()
        return left

    def judge(self, t: float) -> None:
        """Find out whether commands leave, at time `t` [s]."""
        link = self._link
        failed, self._failures = link.failures != self._failures, link.failures
        if failed or link.down or link.bus_off:
            for command in self._commands:
                command.forget()
        stuck = any(command.overdue(t, self._timeout) for command in self._commands)
        self._counts[count.UNCONFIRMED] += stuck and not self._stuck
        self._stuck = stuck
        self.trouble = link.down or link.bus_off or (self._stuck_text() if stuck else "")
        if failed or self.trouble:
            self.blocked = True

    def _stuck_text(self) -> str:
        return (
            f"commands do not leave the bus: none confirmed for {self._timeout:g} s "
            "(no other node acknowledges them, or the bus is overloaded)"
        )

    def confirm(self, message: can.Message, t: float) -> bool:
        """A frame that was on the bus at `t` [s]; True if it has the identifier of one of our commands."""
        command = self._by_id.get((message.arbitration_id, message.is_extended_id))
        if command is None:
            return False
        if not command.confirm(message, t) and not self._is_takeover(message.data, t):
            self.foreign += 1
            self._counts[count.FOREIGN_COMMANDS] = self.foreign
            self._counters_unsure = True
            self._newest_foreign = command, bytes(message.data), self._link.here
        return True

    def begin(self, t: float) -> None:
        """Commands leave from `t` [s] on; until now somebody may have held the rig at neutral for us."""
        neutral = (bytes.fromhex(frame["data"]) for frames in self.neutral_cycle() for frame in frames)
        self._takeover = t + TAKEOVER_S, frozenset(neutral)

    def _is_takeover(self, data: bytearray, t: float) -> bool:
        until, neutral = self._takeover
        return t < until and bytes(data) in neutral

    def tell_foreign(self) -> str:
        """The newest command of somebody else, for people; "" if there was none."""
        if self._newest_foreign is None:
            return ""
        command, data, here = self._newest_foreign
        who = "another program on this computer" if here else "another node, or another program,"
        return f"{who} sends our command {command.tell(data)}"

    def send_waiting(self) -> None:
        """Send what was remembered, as far as there is room now."""
        for command in self._commands:
            waiting = command.waiting
            if waiting is not None and not self.blocked and command.in_flight < self._room:
                self._send(command, waiting)

    @property
    def neutral_waits(self) -> bool:
        """Whether a neutral command found no room."""
        return any(command.waiting is self._neutral for command in self._commands)

    def left(self) -> Sequence[float]:
        """When the last command of each output was on the bus [s], once it is confirmed; nan before."""
        left = self._left
        for command in self._commands:
            at = math.nan if command.in_flight else command.confirmed_at
            for place in command.places:
                left[place] = at
        return left

    def sent(self) -> int:
        """Frames sent of the message that has had most."""
        return max((command.sent for command in self._commands), default=0)

    def neutral_cycle(self) -> list[list[dict[str, Any]]]:
        """The neutral frame of each message, for every value of the sequence counters."""
        period = max([1, *(command.period for command in self._commands)])
        return [[self._plain(command, n) for command in self._commands] for n in range(period)]

    def _plain(self, command: CommandFrame, counter: int) -> dict[str, Any]:
        message = command.message
        return {
            "id": message.arbitration_id,
            "extended": message.is_extended_id,
            "fd": message.is_fd,
            "bit_rate_switch": message.bitrate_switch,
            "data": command.encode(self._neutral, counter).hex(),
        }
