"""Readings that another channel calls invalid: they count as not come, so that the guard finds them stale."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.base import NO_SAMPLE, Sample
from seod.config.channels import sensor_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.config.model import RigConfig
    from seod.config.sensors import ValidConfig


class Gate:
    """Lets a channel's samples through while another channel says that they are valid.

    Attributes:
        index: Of the sensor's channel among the inputs.
        why: Why the newest sample was not let through; "" where it was.

    Args:
        config: Of the channel that says it.
        index: As above.
        valid_index: Of the channel that says it.
        stale: Oldest word of it that counts [s].
    """

    def __init__(self, config: ValidConfig, index: int, valid_index: int, stale: float) -> None:
        self.index, self.valid_index, self.stale = index, valid_index, stale
        self.channel, self.right = config.channel, config.is_
        self.why = ""
        self.last = NO_SAMPLE

    def passed(self, t: float, sample: Sample, valid: Sample) -> Sample:
        """The sample if it is valid at `t` [s], else the last one that was."""
        if valid.value == self.right and t - valid.t <= self.stale:
            self.why, self.last = "", sample
        elif valid.value == self.right:
            self.why = f"the validity channel {self.channel} is silent"
        else:
            self.why = f"{self.channel} reads {valid.value:g}: readings are valid at {self.right:g}"
        return self.last


def pass_valid(gates: Sequence[Gate], t: float, samples: Sequence[Sample]) -> list[Sample]:
    """The samples of tick time `t` [s], with the last valid one in place of each that is not valid."""
    passed = list(samples)
    for gate in gates:
        passed[gate.index] = gate.passed(t, passed[gate.index], samples[gate.valid_index])
    return passed


def make_gates(config: RigConfig, channels: list[str]) -> list[Gate]:
    """A gate for each sensor in use that has `valid`; `channels` are the loop's inputs."""
    names = dict.fromkeys(name for axis in config.axes.values() for name in sensor_names(axis))
    return [
        Gate(valid, channels.index(sensor.channel), channels.index(valid.channel), config.guard.stale)
        for sensor in map(config.sensors.__getitem__, names)
        if (valid := sensor.valid) is not None
    ]
