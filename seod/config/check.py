"""What `seod check` tells about a valid rig file: the bus load, and what a careful person would ask about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from seod.config.busload import Bus, bits
from seod.config.truth import truth
from seod.gain import gain_range, is_identified

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.lineload import Line
    from seod.config.model import RigConfig

WARN_LOAD = 0.8
"""From here on a bus is called full: with worst-case stuffing, and one sender's jitter delays all others.

One axis with 8-byte frames both ways and a SYNC at 2 kHz takes 65 % of 1 Mbit/s and stays below.
"""

REFUSE_LOAD = 1.0
"""From here on the frames do not fit, and queues grow until something is lost."""


@dataclass(frozen=True, slots=True)
class Report:
    """The verdict on a valid rig file; `str` is for people.

    Attributes:
        summary: The rig in one line.
        bus: Its bus with all frames; None where there is none.
        line: Its serial line; likewise.
        refusals: Why it cannot work.
        warnings: What should be looked at.
    """

    summary: str
    bus: Bus | None
    line: Line | None
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
        lines += _bus_lines(self.bus) if self.bus else []
        lines += self.line.lines() if self.line else []
        lines += [f"refused: {text}" for text in self.refusals] + [
            f"warning: {text}" for text in self.warnings
        ]
        return "\n".join([*lines, "verdict: " + self._verdict()])

    def _verdict(self) -> str:
        if self.refusals:
            return "this rig file cannot work"
        return "ok, with warnings" if self.warnings else "ok"


def check(config: RigConfig) -> Report:
    """Judge a rig file that `load_rig` has accepted."""
    bus, line, refusals, warnings = None, None, list[str](), list[str]()
    if config.driver["kind"] == "can":
        from seod.config.traffic import can_traffic  # noqa: PLC0415 - cantools takes long to import

        bus, unknown = can_traffic(config)
        refusals += [*_overfull(bus), *_without_fd(config, bus), *_too_slow(config, bus)]
        warnings += [*_full(bus), *_uncounted(unknown)]
    if config.driver["kind"] == "serial":
        from seod.config.lineload import line_refusals, line_warnings, serial_line  # noqa: PLC0415

        line = serial_line(config)
        refusals += line_refusals(config, line)
        warnings += line_warnings(config, line, WARN_LOAD)
    warnings += [*_safety(config), *_simulated(config)]
    return Report(_summary(config), bus, line, tuple(refusals), tuple(warnings))


def _overfull(bus: Bus) -> Iterator[str]:
    if bus.load() >= REFUSE_LOAD:
        remedy = "lower loop.rate_hz, or use a faster bus, CAN FD or shorter frames"
        yield f"the bus {bus.name} would be {bus.load():.0%} busy with worst-case bit stuffing: {remedy}"


def _without_fd(config: RigConfig, bus: Bus) -> Iterator[str]:
    for frame in bus.frames:
        if frame.fd and not config.driver.get("fd", False):
            yield f"{frame.name} is an FD frame: set driver.fd: true, or make it classic in the DBC"


def _full(bus: Bus) -> Iterator[str]:
    if WARN_LOAD <= bus.load() < REFUSE_LOAD:
        yield f"the bus {bus.name} is {bus.load():.0%} busy with worst-case bit stuffing: frames will be late"


def _uncounted(messages: tuple[str, ...]) -> Iterator[str]:
    for name in messages:
        yield f"message {name} is not counted in the bus load: give driver.messages.{name}.rate_hz"


def _too_slow(config: RigConfig, bus: Bus) -> Iterator[str]:
    """Inputs that are stale before their next frame comes."""
    rates = {frame.name: frame.rate_hz for frame in bus.frames}
    inputs = {f"sensors.{axis.sensor}": config.sensors[axis.sensor].channel for axis in config.axes.values()}
    if config.guard.estop:
        inputs["guard.estop"] = config.guard.estop.channel
    for key, channel in inputs.items():
        period = 1.0 / rates[channel.partition(".")[0]]
        if period > config.guard.stale:
            yield f"{key} comes each {period:g} s, guard.stale is {config.guard.stale:g} s: always stale"


def _summary(config: RigConfig) -> str:
    axes = ", ".join(config.axes)
    return f"rig {config.rig}: driver {config.driver['kind']}, axes {axes}, {config.loop.rate_hz:g} ticks/s"


def _bus_lines(bus: Bus) -> Iterator[str]:
    rates = f"{bus.bitrate:,} bit/s" + (f", data {bus.data_bitrate:,} bit/s" if bus.data_bitrate else "")
    yield f"bus {bus.name}, {rates}; bits with worst-case stuffing:"
    yield f"  {'frame':<24} {'bytes':>5} {'bits':>5} {'frames/s':>9} {'share':>7}"
    for frame in bus.frames:
        share = bus.share(frame)
        yield f"  {frame.name:<24} {frame.length:>5} {sum(bits(frame)):>5} {frame.rate_hz:>9g} {share:>7.1%}"
    limits = f"warned from {WARN_LOAD:.0%}, refused from {REFUSE_LOAD:.0%}"
    yield f"  {'sum':<24} {'':>5} {'':>5} {'':>9} {bus.load():>7.1%}  ({limits})"


def _safety(config: RigConfig) -> Iterator[str]:
    """What protects a real rig and is missing; the rig inside the daemon can hurt nobody."""
    for name, axis in config.axes.items():
        if not axis.polarity.enabled:
            yield f"axes.{name}.polarity is disabled: a wrong sign would be found only by the limits"
    if config.driver["kind"] == "virtual":
        return
    if config.guard.estop is None:
        yield "guard.estop is missing: no channel tells the daemon that the emergency stop was pressed"
    if config.guard.rig_watchdog is None:
        yield (
            "guard.rig_watchdog is missing: how soon does the amplifier go to neutral by itself when this "
            "computer dies? Measure it and write it down"
        )


def _simulated(config: RigConfig) -> Iterator[str]:
    """Where the rig file believes something else than the simulated rig does."""
    simulation = config.simulation
    if simulation is None:
        return
    believed = config.guard.rig_watchdog
    if believed is not None and believed != simulation.watchdog_s:
        yield f"guard.rig_watchdog is {believed:g} s, simulation.watchdog_s is {simulation.watchdog_s:g} s"
    for name, plant in truth(config).items():
        believed_gain, gain = config.axes[name].K_L, plant["K_L"]
        low, high = gain_range(believed_gain)
        if gain is None:
            yield f"axes.{name}: the simulated plant has no K_L: its supply cannot move its load"
        elif gain < 0:
            yield f"axes.{name} is wired the wrong way round to its simulated plant (scales below 0)"
        elif not is_identified(believed_gain) and not 0.99 * low <= gain <= 1.01 * high:
            K_L = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            yield f"axes.{name}.K_L is {K_L}, the simulated plant has {gain:g}: zeta will be off"
