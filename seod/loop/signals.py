"""What is commanded beside the axes: enable signals, and numbers that never change."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.channels import enables, fixed_values
from seod.processes.ring import AxisState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.config.model import RigConfig
    from seod.config.outputs import EnableConfig
    from seod.loop.axis import Axis


class Enable:
    """One enable signal and the axes that move by it."""

    def __init__(self, config: EnableConfig, axes: Sequence[Axis]) -> None:
        self.on, self.neutral = config.on, config.neutral
        self.courses = [axis.course for axis in axes]

    def value(self) -> float:
        """`on` while one of its axes may move and none of them is in fault."""
        moving = False
        for course in self.courses:
            if course.state is AxisState.FAULT:
                return self.neutral
            moving = moving or course.active
        return self.on if moving else self.neutral


class Signals:
    """All of a rig, in the order of `seod.config.channels.output_channels`.

    Attributes:
        present: Whether there are any: at most rigs there are none.
    """

    def __init__(self, config: RigConfig, axes: Sequence[Axis]) -> None:
        users: dict[str, list[Axis]] = {channel: [] for channel in enables(config)}
        for axis in axes:
            enable = config.outputs[axis.config.output].enable
            if enable is not None:
                users[enable.channel].append(axis)
        self.enables = [Enable(enable, users[channel]) for channel, enable in enables(config).items()]
        self.fixed = list(fixed_values(config).values())
        self.present = bool(self.enables or self.fixed)

    def values(self) -> list[float]:
        """The channels' numbers in this tick's command."""
        return [*[enable.value() for enable in self.enables], *self.fixed]
