"""What `seod check` tells about a valid rig file: the bus load, and what a careful person would ask about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers import driver_class
from seod.config.ages import short_pulses, stale_refusal, watched_channels
from seod.config.channels import enables, fixed_values
from seod.config.demand import demand_of
from seod.config.gain_in_force import gain_range, is_identified
from seod.config.private import open_files, open_tokens
from seod.config.truth import truth

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from drivers.base import Driver
    from drivers.connection import CommandMessage, Connection
    from seod.config.model import RigConfig


@dataclass(frozen=True, slots=True)
class Report:
    """The verdict on a valid rig file; `str` is for people.

    Attributes:
        summary: The rig in one line.
        connection: Its bus or line, and what commands carry; None where nothing can be full.
        refusals: Why it cannot work.
        warnings: What should be looked at.
    """

    summary: str
    connection: Connection | None
    refusals: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Nothing forbids to run this rig."""
        return not self.refusals

    @property
    def exit_status(self) -> int:
        """Of `seod check`."""
        return 0 if self.ok else 1

    def __str__(self) -> str:
        lines = [self.summary]
        if self.connection is not None:
            lines += self.connection.traffic.lines()
            lines += [text for message in self.connection.commands for text in message.lines()]
        lines += [f"refused: {text}" for text in self.refusals] + [
            f"warning: {text}" for text in self.warnings
        ]
        return "\n".join([*lines, "verdict: " + self._verdict()])

    def _verdict(self) -> str:
        if self.refusals:
            return "this rig file cannot work"
        return "ok, with warnings" if self.warnings else "ok"


def check(config: RigConfig, path: Path | None = None) -> Report:
    """Judge a rig file that `load_rig` has accepted.

    Args:
        config: What it says.
        path: Where it is, if it is a file: who else may read it is looked at then.
    """
    driver = driver_class(config.driver["kind"])
    connection = driver.connection(driver.Options.model_validate(config.driver), demand_of(config))
    refusals, warnings = [*open_tokens(config.server)], list[str]()
    if connection is not None:
        refusals = [*connection.refusals, *_too_slow(config, connection), *refusals]
        warnings += [*connection.warnings, *_unset(connection.commands)]
    warnings += [*_safety(config, driver), *_simulated(config), *open_files(config.server, path)]
    return Report(_summary(config), connection, tuple(refusals), tuple(warnings))


def _unset(messages: Sequence[CommandMessage]) -> Iterator[str]:
    """Signals that nothing sets: an amplifier may wait for one of them."""
    for message in messages:
        if message.unset:
            yield (
                f"command {message.name}: nothing sets {', '.join(message.unset)}; what enables an amplifier "
                "belongs under outputs.<name>.enable, what never changes (mode, key) under "
                "outputs.<name>.fixed"
            )


def _too_slow(config: RigConfig, connection: Connection) -> Iterator[str]:
    """Inputs of which one late frame is a fault, or that come too rarely to show the polarity."""
    watched = watched_channels(config)
    if connection.together:  # one sentence for all
        watched = {connection.together: next(iter(watched.values()))}
    for key, channel in watched.items():
        yield from stale_refusal(config, key, 1.0 / connection.rates[channel])
    yield from short_pulses(config, connection.rates.__getitem__)


def _summary(config: RigConfig) -> str:
    axes = ", ".join(config.axes)
    return f"rig {config.rig}: driver {config.driver['kind']}, axes {axes}, {config.loop.rate_hz:g} ticks/s"


def _safety(config: RigConfig, driver: type[Driver]) -> Iterator[str]:
    """What protects a real rig and is missing; a recording or a rig inside the daemon can hurt nobody."""
    if driver.acts_on == "recording":
        return
    for name, axis in config.axes.items():
        if not axis.polarity.enabled:
            yield f"axes.{name}.polarity is disabled: a wrong sign would be found only by the limits"
    if driver.acts_on == "simulation":
        return
    if config.guard.estop is None:
        yield "guard.estop is missing: no channel tells the daemon that the emergency stop was pressed"
    if config.guard.rig_watchdog is None:
        yield (
            "guard.rig_watchdog is missing: how soon does the amplifier go to neutral by itself when this "
            "computer dies? Measure it and write it down"
        )


def _never_enabled(config: RigConfig) -> Iterator[str]:
    """Numbers that a simulated amplifier waits for and that the rig file does not send."""
    sent = fixed_values(config) | {channel: each.on for channel, each in enables(config).items()}
    for name, plant in config.simulation.plants.items() if config.simulation else ():
        for channel, wanted in plant.enabled_by.items():
            if sent.get(channel) != wanted:
                waits = f"the simulated amplifier of {name} obeys only while {channel} is {wanted:g}"
                yield f"{waits}, which no output sends: it will not move"


def _simulated(config: RigConfig) -> Iterator[str]:
    """Where the rig file believes something else than the simulated rig does."""
    simulation = config.simulation
    if simulation is None:
        return
    believed = config.guard.rig_watchdog
    if believed is not None and believed != simulation.watchdog_s:
        yield f"guard.rig_watchdog is {believed:g} s, simulation.watchdog_s is {simulation.watchdog_s:g} s"
    yield from _never_enabled(config)
    for name, plant in truth(config).items():
        believed_gain, gain = config.axes[name].K_L, plant["K_L"]
        low, high = gain_range(believed_gain)
        if gain is None:
            yield f"axes.{name}: the simulated plant has no K_L: its supply cannot move its load"
        elif gain < 0:
            yield f"axes.{name} is wired the wrong way round to its simulated plant (scales below 0)"
        elif not is_identified(believed_gain) and not 0.99 * low <= gain <= 1.01 * high:
            K_L = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            unit = config.axes[name].gain_unit
            yield f"axes.{name}.K_L is {K_L} {unit}, the simulated plant has {gain:g}: zeta will be off"
