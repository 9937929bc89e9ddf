"""Shape of a rig file's `guard`: what stops the rig."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from seod.config.section import (
    FINITE,
    Seconds,
    Section,
)


class EstopConfig(Section):
    """An input channel that must have a value for anything to move."""

    channel: str
    """Input channel of the driver."""
    run: Annotated[float, FINITE] = 1.0
    """Number [the channel's unit] that allows movement; any other, or silence, is an e-stop."""


EstopLines = Annotated[
    Annotated[EstopConfig, Tag("one")] | Annotated[list[EstopConfig], Tag("many"), Field(min_length=1)],
    Discriminator(lambda value: "many" if isinstance(value, list) else "one"),
]


class OverrunConfig(Section):
    """A burst of late ticks."""

    count: Annotated[int, Field(ge=1)] = 10
    """So many late ticks"""
    window: Seconds = 0.1
    """within this time are a fault."""


class GuardConfig(Section):
    """What stops the rig."""

    fault_policy: Literal["rig", "axis"] = "rig"
    """What a fault of one axis (travel, speed, sensor, polarity ...) stops: all axes, or that one alone.

    E-stop, link, late ticks, a dead process and the dead man always stop all.
    """
    stale: Seconds = 0.01
    """Oldest sample that may be acted on."""
    frozen: Seconds = 0.25
    """A sensor that repeats one value for this long while the relay is on is frozen."""
    no_switch: Seconds = 2.0
    """A relay on a position that stays on one side for this long does not see its axis: another axis' sensor.

    Once its limit cycle is known, four times the longest half of it is the limit, and `frozen` at least.
    Longer than half a period of the slowest limit cycle that is expected.
    """
    rig_watchdog: Seconds | None = None
    """The amplifier's own watchdog: it goes to neutral when commands stop for this long.

    The last line of defence, when the whole computer dies. The daemon cannot see it: measure it on the rig.
    """
    overruns: OverrunConfig = OverrunConfig()
    estop: EstopLines | None = None
    """One channel or a list; any of them stops the rig."""
    foreign_command: Literal["fault", "warn"] = "fault"
    """When somebody else commands our actuators: a fault, or a warning and estimates of quality `fault`."""
    dead_man: Seconds | None = None
    """A client must call `keepalive` at least this often while a rig is excited, and stay connected."""
    gateway_lost: Literal["stop", "hold"] = "stop"
    """When the gateway process dies or hangs: `stop` is a fault, `hold` ends the excitation as `stop` does.

    With `hold` an axis goes back to where it stood at start, for loads that sink at neutral.
    """
    gateway_timeout: Seconds = 1.0
    """The gateway hangs if it has not turned for this long; it is killed then, and started again."""

    @property
    def estops(self) -> list[EstopConfig]:
        """All e-stop lines."""
        lines = self.estop
        return [] if lines is None else lines if isinstance(lines, list) else [lines]
