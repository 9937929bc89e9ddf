"""A whole simulated rig: plants with their amplifiers and sensors, on one time line. Time is handed in.

Numbers are those of the channels: volts in, sensor readings in the sensor's own unit out.
"""

from __future__ import annotations

import json
import math
from collections import deque
from random import Random
from typing import TYPE_CHECKING

from sim.config import PlantConfig
from sim.plant import LinearPlant, Sensor
from sim.sensors import make_sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim.config import SimulationConfig

NEUTRAL = 0.0
"""What an amplifier puts out when it is told so, or is told nothing [V]."""

HISTORY = 2000
"""Commands that are remembered."""


class Actuator:
    """A plant behind its amplifier, seen by its sensor.

    The amplifier holds each command until the next, clips it, and goes neutral at exactly `watchdog_s` after
    the last one. Times that lie before the latest one known are taken as that one.

    Attributes:
        t: How far the plant has come [s].
        voltage: What the amplifier puts out [V].
        tripped: The watchdog is why it is neutral.
        commands: How many commands came.
        last_command: When the newest of them came [s]; None before the first.
        trips: How often the watchdog tripped.
        neutral_since: Since when the voltage has been neutral [s]; None while it is not.
        commands_since_neutral: Commands after the one (or the trip) that made it neutral; 0 while it is not.
        history: The last commands as (time [s], volts asked for).
    """

    def __init__(self, config: PlantConfig, watchdog_s: float, random: Random, t: float) -> None:
        self.watchdog_s = watchdog_s
        self.plant = LinearPlant(config.K_L, config.omega_n, config.zeta, position=config.position)
        self.sensor = Sensor(config.noise, config.resolution, random)
        self.kind = make_sensor(config.sensor, config.measures == "velocity")
        self._adopt(config)
        self.t = t
        self.voltage = NEUTRAL
        self.tripped = False
        self.trips = 0
        self.commands = 0
        self.last_command: float | None = None
        self.neutral_since: float | None = t
        self.commands_since_neutral = 0
        self.history: deque[tuple[float, float]] = deque(maxlen=HISTORY)
        self._expiry = math.inf

    def _adopt(self, config: PlantConfig) -> None:
        self.config = config
        self.plant.change(config.K_L, config.omega_n, config.zeta, config.bias)
        self.plant.stops = config.stops or (-math.inf, math.inf)
        self.sensor.noise = config.noise
        self.sensor.resolution = config.resolution
        self.limit = config.saturation or math.inf

    def advance(self, t: float) -> None:
        """Bring the plant to time `t` [s]."""
        if t > self._expiry:
            self._run_to(self._expiry)
            self._trip()
        self._run_to(t)

    def _run_to(self, t: float) -> None:
        if t > self.t:
            self.plant.advance(t - self.t, self.voltage)
            self.t = t

    def _trip(self) -> None:
        self._expiry = math.inf
        self.tripped = True
        self.trips += 1
        self._put_out(NEUTRAL)

    def command(self, t: float, volts: float) -> None:
        """Take a command that came at `t` [s]; one that is not a number is taken as neutral."""
        self.advance(t)
        self._expiry = self.t + self.watchdog_s
        self.tripped = False
        self.commands += 1
        self.last_command = self.t
        self.history.append((self.t, volts))
        self.commands_since_neutral += 1
        self._put_out(max(-self.limit, min(self.limit, volts)) if math.isfinite(volts) else NEUTRAL)

    def _put_out(self, volts: float) -> None:
        self.voltage = volts
        if volts != NEUTRAL:
            self.neutral_since = None
            self.commands_since_neutral = 0
        elif self.neutral_since is None:
            self.neutral_since = self.t
            self.commands_since_neutral = 0

    def measure(self, t: float) -> float:
        """What the sensor says at `t` [s]."""
        self.advance(t)
        value = self.kind.sense(self.t, self.plant.position, self.plant.velocity)
        return self.kind.number(self.sensor.read(value))

    def mark(self, t: float) -> float:
        """1 where the encoder's index mark passed since the last reading, at `t` [s]; else 0."""
        self.advance(t)
        return self.kind.mark(self.plant.position)

    def change(self, t: float, values: Mapping[str, object]) -> None:
        """Have other parameters from `t` [s] on; `position` moves the load there at once.

        Raises:
            ValueError: An unknown parameter or an impossible value; it is named.
        """
        fixed = {"input", "output", "sensor", "measures"} & set(values)
        if fixed:
            raise ValueError(f"{', '.join(sorted(fixed))} cannot change while the rig runs")
        config = PlantConfig.model_validate_json(json.dumps({**self.config.model_dump(), **values}))
        self.advance(t)
        self._adopt(config)
        if "position" in values:
            self.plant.position = config.position

    def state(self, t: float) -> dict[str, float | bool | None]:
        """What is going on in there at `t` [s]."""
        self.advance(t)
        return {
            "t": self.t,
            "position": self.plant.position,
            "velocity": self.plant.velocity,
            "acceleration": self.plant.acceleration,
            "voltage": self.voltage,
            "watchdog_tripped": self.tripped,
            "watchdog_trips": self.trips,
            "commands": self.commands,
            "last_command_age": None if self.last_command is None else self.t - self.last_command,
            "neutral_since": self.neutral_since,
            "commands_since_neutral": self.commands_since_neutral,
        }


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
        self._by_input = {a.config.input: a for a in self.actuators.values()}
        actuators = self.actuators.values()
        self._readings = {a.config.output: a.measure for a in actuators}
        self._readings.update({a.config.index_channel: a.mark for a in actuators if a.config.index_channel})

    def amplifier(self, channel: str) -> Callable[[float, float], None]:
        """The function (t, volts) that commands this channel.

        Raises:
            KeyError: No plant has it as input.
        """
        return self._by_input[channel].command

    def sensor(self, channel: str) -> Callable[[float], float]:
        """The function of t that reads this channel.

        Raises:
            KeyError: Neither a plant's output, nor an index mark, nor a constant.
        """
        if channel in self.constants:
            return lambda _t: self.constants[channel]
        return self._readings[channel]

    def sensor_channels(self) -> list[str]:
        """Channels that can be read: plants' outputs, index marks, then constants."""
        return [*self._readings, *self.constants]

    def apply(self, t: float, volts: Mapping[str, float]) -> None:
        """Take the commands that came at `t` [s]; channels that no plant has are not ours and let go."""
        for channel, value in volts.items():
            actuator = self._by_input.get(channel)
            if actuator is not None:
                actuator.command(t, value)

    def measure(self, t: float) -> dict[str, float]:
        """What every sensor says at `t` [s], constants included."""
        readings = {channel: read(t) for channel, read in self._readings.items()}
        readings.update(self.constants)
        return readings

    def watchdog_trips(self) -> int:
        """How often the amplifiers' watchdogs tripped."""
        return sum([actuator.trips for actuator in self.actuators.values()])

    def truth(self) -> dict[str, dict[str, float]]:
        """K_L [unit/s/V], omega_n [rad/s] and zeta of each plant, as they are now."""
        return {
            name: {"K_L": a.plant.K_L, "omega_n": a.plant.omega_n, "zeta": a.plant.zeta}
            for name, a in self.actuators.items()
        }

    def state(self, t: float) -> dict[str, dict[str, float | bool | None]]:
        """`Actuator.state` of each plant at `t` [s]."""
        return {name: a.state(t) for name, a in self.actuators.items()}
