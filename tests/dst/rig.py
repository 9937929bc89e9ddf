"""The rig at the other end, on simulated time: a plant, sensors, and an amplifier with a watchdog.

The plant is its own: Eq. 1, exactly stepped.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tests.dst.frames import ENCODER, SUPPLY, Valve, encoder_frame, supply_frame

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from tests.dst.bus import Bus
    from tests.dst.world import World

STOPS, BACK = 1.5, 0.8
"""Where the load cannot go on, and from where it is put back [rad]."""


class Plant:
    """Eq. 1 from volts to speed, and its integral; exact steps."""

    K_L, OMEGA, ZETA = 17.0, 20.0, 0.3

    def __init__(self, t: float) -> None:
        self.t, self.u = t, 0.0
        self.position = self.speed = self.slope = 0.0

    def advance(self, t: float) -> None:
        """To `t` [s] under the command in force."""
        dt = t - self.t
        if dt <= 0.0:
            return
        self.t = t
        w, z, final = self.OMEGA, self.ZETA, self.K_L * self.u
        damped, decay = w * math.sqrt(1.0 - z * z), math.exp(-z * w * dt)
        cos, sin = math.cos(damped * dt), math.sin(damped * dt)
        e, de = self.speed - final, self.slope
        b = (de + z * w * e) / damped
        e_new = decay * (e * cos + b * sin)
        de_new = decay * (de * cos - (w * w * e + z * w * de) / damped * sin)
        # w^2 times the integral of e is -(de' + 2 z w e) between the ends
        self.position += final * dt - ((de_new - de) + 2.0 * z * w * (e_new - e)) / (w * w)
        self.speed, self.slope = e_new + final, de_new


class Rig:
    """Sensors and amplifier on the other end.

    Attributes:
        volts: What the amplifier puts out.
        run: The emergency stop chain is closed.
        silent, frozen, corrupt: Of the encoder's frames, while a fault holds.
        loss: Part of the encoder's frames that never come; likewise `twice`, `swap`.
        delay: They come so much later [s].
        offset: Added to the encoder's angle [rad].
        nan: The angle is no number; of a board alone.
        instead: What stands in the angle's place: "" nothing, "still" another axis that stands at 0, and
            of a board alone "pressure".
        on_volts: Told when the output changes.
    """

    def __init__(self, world: World, bus: Bus, rng: Random, rate_hz: float, watchdog_s: float) -> None:
        self.world, self.bus, self.rng = world, bus, rng
        self.period, self.watchdog = 1.0 / rate_hz, watchdog_s
        self.plant = Plant(world.now)
        self.volts = 0.0
        self.run = True
        self.silent = self.frozen = self.corrupt = self.nan = False
        self.instead = ""
        self.loss = self.twice = self.swap = 0.0
        self.delay = self.offset = 0.0
        self.noise = 2e-4
        self.last: Valve | None = None
        self.heard_at = -math.inf
        self.sensor_log: Callable[[float, float, bool], None] = lambda *_: None
        self._counter = self._supply = 0
        self._held: bytes | None = None
        self._away_since = math.inf
        self._angle = 0.0
        self._next = world.now
        bus.on_arrival = self.command
        self._turn()

    def _turn(self) -> None:
        self.plant.advance(self.world.now)
        if self.volts != 0.0 and self.world.now - self.heard_at > self.watchdog:
            self._set(0.0)
        self._put_back()
        if not self.frozen:
            shown = 0.0 if self.instead == "still" else self.plant.position + self.offset
            self._angle = shown + self.rng.gauss(0.0, self.noise)
        self._publish()
        self._next += self.period
        self.world.at(self._next, self._turn)

    def _publish(self) -> None:
        data = encoder_frame(self._angle, self.run, self._counter)
        self._counter += 1
        if self._counter % 10 == 0:
            self.bus.put(SUPPLY, supply_frame(self._supply))
            self._supply += 1
        self._send(bytes([data[0] ^ 1]) + data[1:] if self.corrupt else data)

    def _put_back(self) -> None:
        """Somebody puts a load that stands out of its travel back to the middle."""
        plant = self.plant
        if not -STOPS <= plant.position <= STOPS:
            plant.position = math.copysign(STOPS, plant.position)
        if abs(plant.position) < BACK or self.volts != 0.0:
            self._away_since = self.world.now
        elif self.world.now - self._away_since > 0.5:
            plant.position = 0.0

    def _send(self, data: bytes) -> None:
        if self.silent or (self.loss and self.rng.random() < self.loss):
            return
        if self._held is not None:
            self.bus.put(ENCODER, data)
            data, self._held = self._held, None
        elif self.swap and self.rng.random() < self.swap:
            self._held = data
            return
        if self.delay:
            self.world.at(self.world.now + self.delay, lambda: self.bus.put(ENCODER, data))
        else:
            self.bus.put(ENCODER, data)
        if self.twice and self.rng.random() < self.twice:
            self.bus.put(ENCODER, data)

    def command(self, data: bytes) -> None:
        """A command arrives; one that is damaged, or whose counter does not go on, is not obeyed."""
        valve = Valve(data)
        if not valve.sound:
            return
        if self.last is not None and not 0 < (valve.counter - self.last.counter) % 16 <= 8:
            return
        self.last, self.heard_at = valve, self.world.now
        self._set(valve.volts)

    def _set(self, volts: float) -> None:
        if volts != self.volts:
            self.plant.advance(self.world.now)
            self.volts = self.plant.u = volts
