"""Signals of a DBC that can be the sensor, and those that can be the command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from drivers.can_dbc import load_database
from seod.config.errors import suggest
from seod.config.units import COMMANDS, KNOWN, RATES, SPEEDS, UNITS, spelled

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_MEASURED: Final = (*RATES, *SPEEDS)


class InitError(Exception):
    """A rig file cannot be proposed; the message says what must be given."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One signal.

    Attributes:
        name: `MESSAGE.SIGNAL`.
        unit: As seod spells it; "" for none.
        dimension: Of the unit; "" where it is not known.
        low, high: Range in the DBC, in its unit; None where it tells none.
        sender: Node that sends the message.
        rate_hz: By the message's cycle time; None where the DBC tells none.
        identifier: Of the frame.
        comment: Of the DBC.
    """

    name: str
    unit: str
    dimension: str
    low: float | None
    high: float | None
    sender: str
    rate_hz: float | None
    identifier: int
    comment: str

    @property
    def message(self) -> str:
        """The message's name."""
        return self.name.partition(".")[0]

    def __str__(self) -> str:
        ends = f", {self.low:g} to {self.high:g}" if self.low is not None and self.high is not None else ""
        return f"{self.name} [{self.unit or 'no unit'}]{ends}, sent by {self.sender or 'nobody'}"


def candidates(dbc: Path) -> list[Candidate]:
    """All signals of a DBC.

    Raises:
        CodecError: It is none.
    """
    found = []
    for message in load_database(str(dbc)).messages:
        sender = message.senders[0] if message.senders else ""
        cycle = message.cycle_time
        for signal in message.signals:
            unit = spelled(signal.unit or "")
            found.append(
                Candidate(
                    name=f"{message.name}.{signal.name}",
                    unit=unit if unit in UNITS else "",
                    dimension=KNOWN[unit][0] if unit in KNOWN else "",
                    low=None if signal.minimum is None else float(signal.minimum),
                    high=None if signal.maximum is None else float(signal.maximum),
                    sender="" if sender == "Vector__XXX" else sender,
                    rate_hz=1000.0 / cycle if cycle else None,
                    identifier=message.frame_id,
                    comment=str(signal.comment or ""),
                )
            )
    return found


def sensor(found: list[Candidate], name: str | None, seen: Mapping[int, float] | None = None) -> Candidate:
    """The signal that measures the actuator: the named one, else the only one that can be.

    Args:
        found: All signals.
        name: `MESSAGE.SIGNAL`, or None.
        seen: Rate of each frame that was heard on the bus [Hz]; None: nobody listened.

    Raises:
        InitError: None can be, or several.
    """
    likely = [each for each in found if each.dimension in _MEASURED and (not seen or each.identifier in seen)]
    return _chosen(found, likely, name, "--sensor", "a position or a speed")


def output(found: list[Candidate], name: str | None, measured: Candidate) -> Candidate:
    """The signal that commands the amplifier: the named one, else the only one that can be.

    Raises:
        InitError: None can be, or several; or it is in the sensor's message.
    """
    likely = [each for each in found if each.dimension in COMMANDS and each.sender != measured.sender]
    chosen = _chosen(found, likely, name, "--output", "a voltage or a current")
    if chosen.message == measured.message:
        raise InitError(f"{chosen.name} is in the sensor's own message: it cannot be a command")
    return chosen


def _chosen(
    found: list[Candidate], likely: list[Candidate], name: str | None, option: str, what: str
) -> Candidate:
    if name is not None:
        by_name = {each.name: each for each in found}
        if name not in by_name:
            raise InitError(f"{option} {name}: no such signal; {suggest(name, list(by_name), 'signals')}")
        if not by_name[name].unit:
            raise InitError(f"{name} has no unit that seod knows: give it one in the DBC")
        return by_name[name]
    if len(likely) == 1:
        return likely[0]
    listed = "\n".join(f"  {each}" for each in (likely or found))
    count = "several signals" if likely else "no signal"
    raise InitError(f"{count} can be {what}: choose one by {option} MESSAGE.SIGNAL:\n{listed}")
