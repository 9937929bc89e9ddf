"""The text of a new rig file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

from seod.config.units import RATES, UNITS
from seod.init.signals import InitError

if TYPE_CHECKING:
    from seod.init.signals import Candidate


@dataclass(frozen=True, slots=True)
class Limits:
    """What nobody but the user knows; text with units, as it is written into the file.

    Attributes:
        travel: Two ends of the movement, `-60 deg:60 deg`; None for a speed.
        speed: Largest speed, `60 rad/s`.
        output: Largest command, `2 V`.
        amplitude: Half the largest peak-to-peak movement, `0.4 rad`.
        e_a: The relay's amplitude, `0.5 V`.
        watchdog: The amplifier goes to neutral by itself after this long without a command, `50 ms`.
    """

    speed: str | None = None
    output: str | None = None
    amplitude: str | None = None
    e_a: str | None = None
    watchdog: str | None = None
    travel: str | None = None


QUESTIONS: Final = {
    "travel": "ends of the movement that may never be passed, such as -60 deg:60 deg",
    "speed": "largest speed that may never be passed, such as 60 rad/s",
    "output": "largest command that may ever be sent, such as 2 V",
    "amplitude": "half the largest peak-to-peak movement while the rig is excited, such as 0.4 rad",
    "e_a": "amplitude of the relay's command, such as 0.5 V: begin small",
    "watchdog": "after which time without commands the amplifier goes to neutral by itself, such as 50 ms",
}
"""What is asked for each limit, in this order."""


def missing(limits: Limits, is_speed: bool) -> list[str]:
    """Names of limits that were not given; a speed has no travel."""
    there = [each.name for each in fields(limits) if getattr(limits, each.name)]
    return [name for name in QUESTIONS if name not in there and not (is_speed and name == "travel")]


def demand(limits: Limits, is_speed: bool) -> None:
    """Ask for all limits.

    Raises:
        InitError: One was not given.
    """
    if lacking := missing(limits, is_speed):
        options = (f"--{'output-limit' if each == 'output' else each.replace('_', '-')}" for each in lacking)
        raise InitError(f"limits are never guessed: give {', '.join(options)}")


def on_line(limits: Limits, port: str) -> dict[str, object]:
    """What the shipped rig of a board on a serial line has, by its place, for a board of one's own.

    Raises:
        InitError: A limit was not given.
    """
    demand(limits, is_speed=False)
    axis = "axes.motor"
    return {
        "driver.port": port,
        f"{axis}.relay.e_a": limits.e_a,
        f"{axis}.limits.output": limits.output,
        f"{axis}.limits.travel": list(_ends(limits.travel or "")),
        f"{axis}.limits.speed": limits.speed,
        f"{axis}.limits.amplitude": limits.amplitude,
        "guard.rig_watchdog": limits.watchdog,
    }


@dataclass(frozen=True, slots=True)
class Bus:
    """Where the rig is, and how often its sensor speaks."""

    dbc: str
    interface: str
    channel: str
    rate_hz: float


def can_rig(name: str, bus: Bus, measured: Candidate, command: Candidate, limits: Limits) -> str:
    """A rig file for a sensor and an amplifier on a CAN bus.

    Raises:
        InitError: A limit was not given, or is not of the form that it must have.
    """
    is_speed = measured.dimension not in RATES
    demand(limits, is_speed)
    small = "1 mrad" if "angle" in measured.dimension or "angular" in measured.dimension else "0.1 mm"
    seen = {"1 mrad": "20 mrad", "0.1 mm": "1 mm"}[small] + ("/s" if is_speed else "")
    rate = f"{bus.rate_hz:.4g}"
    lines = [
        "# yaml-language-server: $schema=seod-rig.schema.json",
        "#",
        "# Made by `seod init`. Lines marked PROPOSED were derived from the DBC: look at each of them.",
        "# `seod check FILE` judges it, docs/safety.md tells what the rig itself must have.",
        "",
        "version: 1",
        f"rig: {name}",
        "",
        "driver:",
        "  kind: can",
        f"  interface: {bus.interface}",
        f"  channel: {bus.channel}",
        "  bitrate: 1000000                # PROPOSED: of your bus; it serves the computed load",
        f"  dbc: {bus.dbc}",
        f"  node: {command.sender or 'seod'}                    # PROPOSED: our name in the DBC",
        "  messages:",
        f"    {measured.message}:",
        f"      rate_hz: {rate}               # PROPOSED",
        "",
        "loop:",
        f"  rate_hz: {rate}                 # PROPOSED: a tick for each sample",
        "",
        "sensors:",
        "  reading:",
        f"    channel: {measured.name}      # {_said(measured)}",
        f"    unit: {measured.unit}",
        *_range(measured),
        "",
        "outputs:",
        "  valve:",
        f"    channel: {command.name}       # {_said(command)}",
        f"    unit: {command.unit}",
        "",
        "axes:",
        "  motor:",
        *(
            [
                "    mode: velocity",
                f"    reference: 0 {measured.unit}      # TYPE the speed to oscillate about",
            ]
            if is_speed
            else []
        ),
        "    sensor: reading",
        "    output: valve",
        "    K_L: identified               # the excitation finds it: docs/two-phase.md",
        "    relay:",
        f"      e_a: {limits.e_a}",
        f"      hysteresis: {small}            # PROPOSED: several times the sensor's noise",
        "    limits:",
        f"      output: {limits.output}",
        *([] if is_speed else [f"      travel: [{', '.join(_ends(limits.travel or ''))}]"]),
        f"      speed: {limits.speed}",
        f"      amplitude: {limits.amplitude}",
        "      excitation: 60 s            # PROPOSED: longest excitation from start to stop",
        "    polarity:",
        "      enabled: true               # a short pulse shows which way a positive command moves it",
        f"      movement: {seen}           # PROPOSED: clear of the noise",
        "",
        "guard:",
        f"  stale: {max(20.0, 5e3 / bus.rate_hz):.3g} ms                 # PROPOSED: oldest sample to act on",
        f"  rig_watchdog: {limits.watchdog}",
        "  # estop: {channel: MESSAGE.SIGNAL, run: 1}   # an input that must be 1 for anything to move",
        "",
        "server:",
        "  host: 127.0.0.1",
        "  port: 7600",
        "",
    ]
    return "\n".join(lines)


def _of_a_speed(measured: Candidate) -> list[str]:
    return [
        "    mode: velocity",
        f"    reference: 0 {measured.unit}      # set it: the speed to oscillate about",
    ]


def _said(of: Candidate) -> str:
    return f"PROPOSED: {of.comment.splitlines()[0] if of.comment else str(of)}"


def _range(of: Candidate) -> list[str]:
    """Beyond it the wire is broken; the DBC's own range is what the signal can carry."""
    if of.low is None or of.high is None or of.unit not in UNITS:
        return []
    return [f"    # range: [{of.low:g}, {of.high:g}]   # of the DBC: narrow it to what the sensor can show"]


def _ends(travel: str) -> tuple[str, str]:
    low, colon, high = travel.partition(":")
    if not colon or not low.strip() or not high.strip():
        raise InitError(f"--travel {travel}: give two ends, such as '-60 deg:60 deg'")
    return low.strip(), high.strip()
