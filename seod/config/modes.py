"""Rules about what an axis controls: position or speed, with dimensions, gain and limits of each."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from pydantic import TypeAdapter, ValidationError

from seod.config.axis import LimitsConfig, RelayConfig
from seod.config.errors import suggest
from seod.config.gain import Gain, GainModel
from seod.config.gain_in_force import gain_range, is_identified, needs_pressure
from seod.config.units import COMMANDS, GAINS, RATES, UNITS, dimension_of, parse_quantity, per, units_of
from seod.config.wiring import command_unit, sensor_dimension

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError, KeyPath

POSITIONS = {rate: position for position, rate in RATES.items()}
ACCELERATIONS = {"angular speed": "angular acceleration", "speed": "acceleration"}
DIMENSIONS = (*POSITIONS, *RATES, *ACCELERATIONS.values())

MEASURED_KEYS: tuple[KeyPath, ...] = (
    ("limits", "travel", 0),
    ("limits", "travel", 1),
    ("hold", "tolerance"),
    ("polarity", "movement"),
)
"""Quantities of an axis that are what its sensor measures: positions, or speeds in velocity mode."""
POSITION_KEYS: tuple[KeyPath, ...] = (("relay", "hysteresis"), ("limits", "amplitude"))
"""Quantities of the relay's input: always positions, in velocity mode the integral of the speed's error."""
COMMAND_KEYS: tuple[KeyPath, ...] = (
    ("relay", "e_a"),
    ("relay", "bias"),
    ("hold", "output"),
    ("polarity", "pulse"),
    ("limits", "output"),
)
"""Quantities of an axis that are what its amplifier is told."""
VELOCITY_KEYS = ("reference", "ramp", "trim")

_GAIN: TypeAdapter[float | GainModel] = TypeAdapter(Gain)


def check_modes(draft: Draft) -> Iterator[ConfigError]:
    """All mistakes in what the axes control."""
    for axis in draft.names("axes"):
        yield from _sensor(draft, axis)
        yield from _command(draft, axis)
        yield from _conditions(draft, axis)
        yield from _keys(draft, axis)
        yield from _identified(draft, axis)
        if is_velocity(draft, axis):
            yield from _reference(draft, axis)
        yield from _simulated(draft, axis)


def is_velocity(draft: Draft, axis: str) -> bool:
    """Whether an axis controls a speed."""
    return draft.text("axes", axis, "mode") == "velocity"


def _sensor(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """Positions for position mode, speeds for velocity mode; all quantities fit the sensor's dimension."""
    sensor, dimension = draft.text("axes", axis, "sensor"), sensor_dimension(draft, axis)
    mode = "velocity" if is_velocity(draft, axis) else "position"
    wanted = POSITIONS if mode == "velocity" else RATES
    if dimension is None:
        return
    if dimension not in wanted:
        what = "a speed" if mode == "velocity" else "a position"
        message = f"sensor {sensor!r} measures {dimension}; {mode} control needs {what}"
        yield draft.error(
            ("axes", axis, "sensor"), message, f"a sensor in one of {', '.join(units_of(*wanted))}"
        )
        return
    position = POSITIONS.get(dimension, dimension)
    right = dict.fromkeys(MEASURED_KEYS, dimension) | dict.fromkeys(POSITION_KEYS, position)
    right[("limits", "speed")] = right[("reference",)] = RATES[position]
    right[("ramp",)] = ACCELERATIONS[RATES[position]]
    for key, fits in right.items():
        written = dimension_of(draft.raw("axes", axis, *key))
        if written in DIMENSIONS and written != fits:
            message = f"sensor {sensor!r} measures {dimension}: must be in {', '.join(units_of(fits))}"
            yield draft.wrong(("axes", axis, *key), message)


def _command(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """What is written in volts or amperes is what the output takes; K_L is a speed of the sensor per that."""
    output, sensor = draft.text("axes", axis, "output") or "", sensor_dimension(draft, axis)
    unit = draft.text("outputs", output, "unit") or "V"
    command = UNITS[unit][0] if unit in UNITS else ""
    if command not in COMMANDS or sensor is None:
        return
    what = f"output {output!r} is in {unit}"
    right = dict.fromkeys(COMMAND_KEYS, command) | {("limits", "slew"): COMMANDS[command]}
    for key, fits in right.items():
        written = dimension_of(draft.raw("axes", axis, *key))
        if written in (*COMMANDS, *COMMANDS.values()) and written != fits:
            yield draft.wrong(("axes", axis, *key), f"{what}: must be in {', '.join(units_of(fits))}")
    fits = per(RATES.get(sensor, sensor), command)
    for path in gain_places(draft, axis):
        written = dimension_of(draft.raw(*path))
        if written in GAINS and written != fits:
            moves = f"{what} and the sensor measures {sensor}"
            yield draft.wrong(path, f"{moves}: must be in {', '.join(units_of(fits))}")


def gain_places(draft: Draft, axis: str) -> Iterator[KeyPath]:
    """Where gains of an axis are written."""
    here = ("axes", axis, "K_L")
    yield here
    yield (*here, "identified")
    yield ("axes", axis, "estimator", "K_L_sd")
    points = draft.raw(*here, "table", "K_L")
    yield from (
        (*here, "table", "K_L", place) for place in range(len(points) if isinstance(points, list) else 0)
    )


def _conditions(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """Sensors of pressure and temperature exist and are such; a gain that needs a pressure has one."""
    for key, dimension in (("supply_pressure", "pressure"), ("temperature", "temperature")):
        path = ("axes", axis, key)
        name = draft.text(*path)
        sensor = draft.sensor(name)
        if name is not None and name not in draft.names("sensors"):
            names = draft.names("sensors")
            yield draft.error(path, f"there is no {name!r} under sensors", suggest(name, names, "sensors"))
        elif sensor is not None and sensor.dimension != dimension:
            right = f"a sensor in one of {', '.join(units_of(dimension))}"
            yield draft.error(path, f"sensor {name!r} measures {sensor.dimension}", right)
    K_L = gain(draft, axis)
    if K_L is not None and needs_pressure(K_L) and draft.raw("axes", axis, "supply_pressure") is None:
        right = "`supply_pressure:` with the name of a sensor of pressure"
        yield draft.error(("axes", axis, "K_L"), "depends on supply pressure, which no sensor tells", right)


def _keys(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """What belongs to one mode only."""
    if not is_velocity(draft, axis):
        for key in VELOCITY_KEYS:
            if draft.raw("axes", axis, key) is not None:
                yield draft.error(
                    ("axes", axis, key), "belongs to velocity mode", "`mode: velocity`, or leave it out"
                )
        if (
            draft.section(LimitsConfig, "axes", axis, "limits")
            and draft.raw("axes", axis, "limits", "speed") is None
        ):
            yield draft.error(
                ("axes", axis, "limits", "speed"), "missing", "add `speed:` (Highest speed, either way)"
            )
        return
    if draft.raw("axes", axis, "limits", "speed") is not None:
        message = "belongs to position mode: in velocity mode limits.travel is the speed's range"
        yield draft.error(("axes", axis, "limits", "speed"), message, "leave it out")
    if draft.raw("axes", axis, "filter") is not None:
        message = "belongs to position mode: in velocity mode the integrator is the filter"
        yield draft.error(("axes", axis, "filter"), message, "leave it out")


def _identified(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """Only one estimator tells K_L."""
    K_L, path = gain(draft, axis), ("axes", axis, "estimator", "method")
    asked = draft.raw("axes", axis, "excitation", "two_phase", "enabled") is True
    if (asked or (K_L is not None and is_identified(K_L))) and draft.text(*path) not in (None, "wave"):
        what = "two-phase excitation is for" if asked else "K_L is identified by"
        yield draft.wrong(path, f"{what} the method `wave` alone", "`wave`, or leave it out")


def _reference(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """The speed, and standstill on the way there, lie within the limits; the output carries both."""
    path = ("axes", axis, "reference")
    reference, limits = _speed(draft, path), draft.section(LimitsConfig, "axes", axis, "limits")
    if draft.raw(*path) is None:
        yield draft.error(path, "missing", "add `reference:` (the speed about which it oscillates)")
    if limits is None:
        return
    low, high = limits.travel
    if low < high and not low < 0.0 < high:
        message = "must have 0 inside: it starts from standstill"
        yield draft.wrong(("axes", axis, "limits", "travel"), message)
    elif reference is not None and not low < reference < high:
        yield draft.wrong(path, f"must lie within limits.travel, {low:g} to {high:g}")
    relay, K_L = draft.section(RelayConfig, "axes", axis, "relay"), gain(draft, axis)
    if reference is None or relay is None or K_L is None:
        return
    if gain_range(K_L)[0] <= 0.0:
        message = "velocity mode opens the valve by reference / K_L before anything is identified"
        yield draft.error(("axes", axis, "K_L"), message, "a first guess: `K_L: {identified: 17}`")
        return
    volts = abs(reference) / gain_range(K_L)[0] + abs(relay.bias) + relay.e_a
    unit = command_unit(draft, axis)
    if volts > limits.output:
        message = (
            f"needs {volts:g} {unit} (|reference| / K_L + |bias| + e_a), "
            f"limits.output is {limits.output:g} {unit}"
        )
        yield draft.wrong(path, message)


def _simulated(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """The simulated plant's channel carries what the axis controls."""
    sensor = draft.sensor(draft.text("axes", axis, "sensor"))
    plants = draft.simulation.plants if draft.simulation else {}
    for name, plant in plants.items():
        if sensor is None or plant.output != sensor.channel or sensor.dimension not in (*POSITIONS, *RATES):
            continue
        wanted = "velocity" if sensor.dimension in POSITIONS else "position"
        if plant.measures_speed != (wanted == "velocity"):
            message = f"the sensor {draft.text('axes', axis, 'sensor')!r} measures {sensor.dimension}"
            place = ("simulation", "plants", name, "measures")
            yield draft.error(place, message, f"`measures: {wanted}`")


def gain(draft: Draft, axis: str) -> float | GainModel | None:
    """K_L of an axis; None if it is not valid."""
    try:
        return _GAIN.validate_json(json.dumps(draft.raw("axes", axis, "K_L")))
    except ValidationError:
        return None


def _speed(draft: Draft, path: KeyPath) -> float | None:
    try:
        return parse_quantity(draft.raw(*path), "angular speed", "speed")
    except ValueError:  # absent, or told already
        return None
