"""A whole simulated rig, addressed by channel. Time is handed in.

Importing this imports numba; what only reads rig files needs `sim.config` alone.
"""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

from sim.actuator import Actuator

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim.config import SimulationConfig


class SimulatedRig:
    """All plants of a `simulation:` section, addressed by channel; knows nothing of how channels travel.

    Args:
        config: The section.
        t: The time at which it begins to exist [s]; it never goes back.
    """

    def __init__(self, config: SimulationConfig, t: float) -> None:
        self.actuators = {
            name: Actuator(plant, config.watchdog_s, Random(f"{config.seed}/{name}"), t)  # noqa: S311 - noise
            for name, plant in config.plants.items()
        }
        self.constants = dict(config.constants)
        for actuator in self.actuators.values():
            actuator.follow(t, self.constants)
        actuators = self.actuators.values()
        self._by_input = {a.config.input: a for a in actuators}
        self._enabled_by = {
            channel: [a for a in actuators if channel in a.config.enabled_by]
            for channel in config.enabling_channels
        }
        self._by_output = {a.config.output: a for a in actuators}
        self._readings = {a.config.output: a.measure for a in actuators}
        self._readings.update({a.config.index_channel: a.mark for a in actuators if a.config.index_channel})

    def amplifier(self, channel: str) -> Callable[[float, float], None]:
        """The function (t, number) that commands this channel: volts of a plant, or what enables some.

        Raises:
            KeyError: No plant has it as input or is enabled by it.
        """
        if channel in self._enabled_by:
            return lambda t, value: self._enable(t, channel, value)
        return self._by_input[channel].command

    def _enable(self, t: float, channel: str, value: float) -> None:
        for actuator in self._enabled_by[channel]:
            actuator.enable(t, channel, value)

    def sensor(self, channel: str) -> Callable[[float], float]:
        """The function of t that reads this channel.

        Raises:
            KeyError: Neither a plant's output, nor an index mark, nor a constant.
        """
        if channel in self.constants:
            return lambda _t: self.constants[channel]
        return self._readings[channel]

    def sampler(self, channel: str) -> Callable[[float], tuple[float, float]]:
        """The function of t that takes a sample of this channel with its time stamp; some never come.

        Raises:
            KeyError: As `sensor`.
        """
        if channel in self._by_output:
            return self._by_output[channel].sample
        read = self.sensor(channel)
        return lambda t: (read(t), t)

    def missing(self, channel: str) -> bool:
        """Whether the next sample of this channel never comes; to be asked once for each."""
        return channel in self._by_output and self._by_output[channel].readings.missing()

    def set_constant(self, t: float, channel: str, value: float) -> None:
        """Have a constant input at `value` from `t` [s] on; plants that follow it do.

        Raises:
            ValueError: There is no such constant, or it is a supply pressure and not above 0.
        """
        if channel not in self.constants:
            raise ValueError(f"no constant {channel!r}; there are {', '.join(self.constants) or 'none'}")
        followers = [a for a in self.actuators.values() if channel in a.config.conditions]
        if value <= 0.0 and any(a.config.supply_pressure == channel for a in followers):
            raise ValueError(f"{channel} is a supply pressure: it must be > 0, got {value:g}")
        self.constants[channel] = value
        for actuator in followers:
            actuator.follow(t, self.constants)

    def inputs(self) -> list[str]:
        """Channels that can be commanded: plants' inputs, then what enables their amplifiers."""
        return [*self._by_input, *self._enabled_by]

    def sensor_channels(self) -> list[str]:
        """Channels that can be read: plants' outputs, index marks, then constants."""
        return [*self._readings, *self.constants]

    def apply(self, t: float, values: Mapping[str, float]) -> None:
        """Take the commands that came at `t` [s]; channels that no plant has are not ours and let go."""
        for channel, value in values.items():
            actuator = self._by_input.get(channel)
            if actuator is not None:
                actuator.command(t, value)
            elif channel in self._enabled_by:
                self._enable(t, channel, value)

    def measure(self, t: float) -> dict[str, float]:
        """What every sensor says at `t` [s], constants included."""
        readings = {channel: read(t) for channel, read in self._readings.items()}
        readings.update(self.constants)
        return readings

    def watchdog_trips(self) -> int:
        """How often the amplifiers' watchdogs tripped."""
        return sum([actuator.trips for actuator in self.actuators.values()])

    def truth(self) -> dict[str, dict[str, float | None]]:
        """`Actuator.truth` of each plant, as they are now."""
        return {name: actuator.truth() for name, actuator in self.actuators.items()}

    def state(self, t: float) -> dict[str, dict[str, float | bool | None]]:
        """`Actuator.state` of each plant at `t` [s]."""
        return {name: a.state(t) for name, a in self.actuators.items()}
