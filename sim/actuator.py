"""A simulated plant behind its amplifier, seen by its sensor, on a time line that is handed in.

Numbers are those of the channels: volts in, sensor readings in the sensor's own unit out.
"""

from __future__ import annotations

import json
import math
from collections import deque
from typing import TYPE_CHECKING

from sim.config import FOLLOWING, PlantConfig
from sim.hydraulics.live import HydraulicPlant
from sim.hydraulics.record import record_of
from sim.parameters import plant_parameters
from sim.plant import Plant
from sim.readings import Readings
from sim.sensors import make_sensor
from sim.truth import conditions, plant_truth

if TYPE_CHECKING:
    from collections.abc import Mapping
    from random import Random

    import numpy as np
    from numpy.typing import NDArray

    from sim.hydraulics.parts import Hydraulic

NEUTRAL = 0.0
"""What an amplifier puts out when it is told so, or is told nothing [V]."""

HISTORY = 2000
"""Commands that are remembered."""

FIXED = frozenset(
    {"input", "output", "sensor", "measures", "supply_pressure", "temperature", "enabled_by", "plant"}
)
"""What cannot change while the rig runs."""


def _record(config: PlantConfig) -> NDArray[np.void]:
    return plant_parameters(config) if config.hydraulic is None else record_of(config)


def make_plant(config: PlantConfig, t: float) -> Plant | HydraulicPlant:
    """The plant of a rig file's section, standing still at `t` [s].

    Raises:
        ValueError: An effect does not fit it, or is out of its range.
    """
    kind = Plant if config.hydraulic is None else HydraulicPlant
    return kind(_record(config), t, config.position)


def _merged(parts: Hydraulic, changes: object) -> dict[str, object]:
    """Sections of a hydraulic plant with new values of some keys."""
    merged: dict[str, object] = dict(parts)
    for name, values in changes.items() if isinstance(changes, dict) else ():
        merged[name] = {**parts.get(name, {}), **values} if isinstance(values, dict) else values
    return merged


class Actuator:
    """A plant behind its amplifier, seen by its sensor.

    The amplifier holds each command until the next, and goes neutral at exactly `watchdog_s` after
    the last one. It obeys only while it is enabled. Times that lie before the latest one known are taken
    as that one.

    Attributes:
        t: How far the plant has come [s].
        voltage: What the amplifier puts out [V]; what the valve makes of it is the plant's affair.
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
        self.config = config
        self.plant = make_plant(config, t)
        self.readings = Readings(random, config.noise, config.effects)
        self._shown = 0.0
        self.kind = make_sensor(config.sensor, config.measures == "velocity")
        self.t = t
        self.voltage = self._asked = NEUTRAL
        self._enabling = dict.fromkeys(config.enabled_by, False)
        self._enabled = not config.enabled_by
        self.tripped = False
        self.trips = 0
        self.commands = 0
        self.last_command: float | None = None
        self.neutral_since: float | None = t
        self.commands_since_neutral = 0
        self.history: deque[tuple[float, float]] = deque(maxlen=HISTORY)
        self._expiry = math.inf
        self._sees_speed = config.measures_speed
        self._sampled = (math.nan, -math.inf)
        self._constants: Mapping[str, float] = {}

    def advance(self, t: float) -> None:
        """Bring amplifier and plant to time `t` [s]."""
        self._come_to(t)
        self.plant.advance(self.t)

    def _come_to(self, t: float) -> None:
        """Let time pass, the watchdog too; the plant follows when it is looked at."""
        if t > self._expiry:
            self.t = max(self.t, self._expiry)
            self._trip()
        if t > self.t:
            self.t = t

    def _trip(self) -> None:
        self._expiry = math.inf
        self.tripped = True
        self.trips += 1
        self._put_out(NEUTRAL)

    def command(self, t: float, volts: float) -> None:
        """Take a command that came at `t` [s]; one that is not a number is taken as neutral."""
        self._come_to(t)
        self._expiry = self.t + self.watchdog_s
        self.tripped = False
        self.commands += 1
        self.last_command = self.t
        self.history.append((self.t, volts))
        self.commands_since_neutral += 1
        self._put_out(volts if math.isfinite(volts) else NEUTRAL)

    def enable(self, t: float, channel: str, value: float) -> None:
        """Take the number of one of the channels that enable it, which came at `t` [s]."""
        self._come_to(t)
        self._enabling[channel] = value == self.config.enabled_by[channel]
        enabled = all(self._enabling.values())
        if enabled != self._enabled:
            self._enabled = enabled
            self._put_out(self._asked)

    def _put_out(self, asked: float) -> None:
        self._asked = asked
        volts = asked if self._enabled else NEUTRAL
        self.voltage = volts
        self.plant.command(self.t, volts)
        if volts != NEUTRAL:
            self.neutral_since = None
            self.commands_since_neutral = 0
        elif self.neutral_since is None:
            self.neutral_since = self.t
            self.commands_since_neutral = 0

    def measure(self, t: float) -> float:
        """What the sensor says at `t` [s]."""
        if t > self._expiry:
            self._come_to(t)
        elif t > self.t:  # likewise, without the call
            self.t = t
        seen = self.plant.measured(self.t)
        if self._sees_speed:
            value = self.kind.sense(self.t, self.plant.shaft, seen)
        else:
            value = self.kind.sense(self.t, seen, 0.0)
        if self.readings.due(self.t):
            self._shown = self.kind.number(self.readings.read(value))
        return self._shown

    def sample(self, t: float) -> tuple[float, float]:
        """The newest sample at `t` [s] and its time stamp [s]; the one before where this one never came."""
        if self.readings.punctual:
            return self.measure(t), t
        if not self.readings.missing():
            taken, stamp = self.readings.taken(t)
            self._sampled = self.measure(taken), stamp
        return self._sampled

    def mark(self, t: float) -> float:
        """1 where the encoder's index mark passed since the last reading, at `t` [s]; else 0."""
        self.advance(t)
        return self.kind.mark(self.plant.shaft)

    def change(self, t: float, values: Mapping[str, object]) -> None:
        """Have other parameters from `t` [s] on; `position` moves the load there at once.

        Of `effects` those change that are named; {} switches one off.

        Raises:
            ValueError: An unknown parameter or an impossible value; it is named.
        """
        if fixed := FIXED & set(values):
            raise ValueError(f"{', '.join(sorted(fixed))} cannot change while the rig runs")
        new, effects = {**self.config.model_dump(), **values}, values.get("effects")
        if isinstance(effects, dict):
            new["effects"] = {**self.config.effects, **effects}
        if (parts := values.get("hydraulic")) and self.config.hydraulic:
            new["hydraulic"] = _merged(self.config.hydraulic, parts)
        if self.config.hydraulic:
            new = {name: value for name, value in new.items() if name in values or name not in FOLLOWING}
        config = PlantConfig.model_validate_json(json.dumps(new))
        self.advance(t)
        self.config = config
        self.plant.change(self.t, _record(config))
        self.readings.adopt(config.noise, config.effects)
        if "position" in values:
            self.plant.place(self.t, config.position)

    def follow(self, t: float, constants: Mapping[str, float]) -> None:
        """Have the supply pressure and the temperature that these channels tell, from `t` [s] on."""
        self._constants = constants
        self.advance(t)
        self.plant.condition(self.t, *conditions(self.config, constants))

    def truth(self) -> dict[str, float | None]:
        """K_L [unit/s/V], omega_n [rad/s] and zeta as they are now; None where there is no such value."""
        return plant_truth(self.config, self._constants, self.plant.since)

    def state(self, t: float) -> dict[str, float | bool | None]:
        """What is going on in there at `t` [s], by name.

        Position and speed are in the plant's unit, volts in V, times in s; the pressure is in unit/s^2 as an
        acceleration, of a physical plant in Pa.
        """
        self.advance(t)
        return {
            "t": self.t,
            "position": self.plant.position,
            "velocity": self.plant.velocity,
            "pressure": self.plant.pressure,
            "voltage": self.voltage,
            "enabled": self._enabled,
            "spool": self.plant.spool,
            "watchdog_tripped": self.tripped,
            "watchdog_trips": self.trips,
            "commands": self.commands,
            "last_command_age": None if self.last_command is None else self.t - self.last_command,
            "neutral_since": self.neutral_since,
            "commands_since_neutral": self.commands_since_neutral,
        }
