"""Which column of a file is `t`, `u`, `y`, and what brings it to SI units."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from seod.config.errors import suggest
from seod.data.source import ReadError, Remark, place
from seod.data.units import KNOWN, spelled, to_base
from seod.record.layout import PROFILE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from seod.data.source import Column, Floats, Group, Source

ROLES: Final = {
    "t": ("s", ("time",)),
    "u": ("V", ()),
    "y": ("", ()),
    "t_u": ("s", ("time",)),
    "ps": ("Pa", ("pressure",)),
    "temperature": ("K", ("temperature",)),
    "f": ("", ()),
}
"""What a recording is made of: unit where the file tells none, and dimensions it may have (any, if none)."""

TIMES: Final = {"u": "t_u", "ps": "t_ps", "temperature": "t_temperature", "f": "t_f"}
"""What comes at times of its own where its group is not that of `y`, and what these times are called."""

NAMED: Final = {
    "t": ("time",),
    "u": ("voltage", "current"),
    "y": ("angle", "length", "angular speed", "speed"),
    "t_u": ("time",),
    "ps": ("pressure",),
    "temperature": ("temperature",),
    "f": ("force", "pressure"),
}
"""Dimensions of units that a name may end with, `y_mm`. Not all of a role's: `u_min` is no time."""

_NO_INCH: Final = "in"
"""At the end of a name a direction: `y_in`."""

_UNIT_IN_NAME: Final = re.compile(
    r"(?:.*[_ .-])?(?:(?P<ms>ms|msecs?|millis|milliseconds?)|(?P<us>us|µs|μs|usecs?|micros|microseconds?)"
    r"|(?P<ns>ns|nsecs?|nanos|nanoseconds?)|(?P<s>secs?|seconds?))|.*[_ .-](?P<of_s>s)",
    re.IGNORECASE,
)
"""Names of times that tell their unit: `t_ms`, `Time-usec`, `millis`; a mere `s` has something before it."""


@dataclass(frozen=True, slots=True)
class Found:
    """A column in its role.

    Attributes:
        group: Where it stands.
        column: The column as it is in the file.
        unit: Of the values that `si` makes: the SI base unit, or the file's own where that is not known.
        has_unit: The file, or the user, tells the unit; else it is the default.
        read_in: The unit in which the values are read; as `unit` where it is none that we know.
    """

    group: Group
    column: Column
    factor: float
    zero: float
    unit: str
    has_unit: bool = True
    read_in: str = ""

    def si(self, values: Floats) -> Floats:
        """Values of the file in `unit`; bit for bit as they are where nothing is to be changed."""
        return values if (self.factor, self.zero) == (1.0, 0.0) else values * self.factor + self.zero


def parse_pairs(text: str, option: str) -> dict[str, str]:
    """`t=time,u=cmd` to a dictionary.

    Raises:
        ReadError: Something else, or a key that is no role.
    """
    pairs: dict[str, str] = {}
    for part in text.split(","):
        role, equals, value = (word.strip() for word in part.partition("="))
        if not (equals and role and value):
            raise ReadError(f"{option}: {part!r} is not NAME=COLUMN, such as y=pos")
        if role not in ROLES:
            raise ReadError(f"{option}: no {role!r} in a recording; {suggest(role, ROLES, 'names')}")
        if role in pairs:
            raise ReadError(f"{option}: {role} is given twice")
        pairs[role] = value
    return pairs


def resolve(
    source: Source,
    columns: Mapping[str, str],
    units: Mapping[str, str],
    axis: str | None = None,
    of_rig: bool = False,
) -> dict[str, Found]:
    """Find the columns of a recording: at least `t`, `u` and `y`.

    Args:
        source: The file.
        columns: Role -> name in the file, `GROUP.NAME` where several groups have it; else the role's name.
        units: Role -> unit, where the file tells none or a wrong one.
        axis: Of a file with several axes, whose columns are called `AXIS.y`.
        of_rig: The axis is a rig file's, and columns that name none are taken to be its.

    Raises:
        ReadError: A column is missing or ambiguous; says which there are.
    """
    prefix = _axis_prefix(source, columns, axis, of_rig)
    found: dict[str, tuple[Group, Column]] = {}
    for role in ("y", "u", "t_u", "ps", "temperature", "f"):
        each = _look_up(source, columns.get(role) or _called(source, prefix, role), role in columns)
        if each is not None:
            found[role] = each
    for role in ("y", "u"):
        if role not in found:
            raise ReadError(_missing(source, role, role))
    found["t"] = _time(source, columns.get("t"), prefix, found["y"][0])
    for role, time in TIMES.items():
        if role in found and time not in found and found[role][0] is not found["t"][0]:
            found[time] = _time(source, None, prefix, found[role][0])
    if "t_u" in found and found["t_u"][0] is not found["u"][0]:
        raise ReadError(
            f"{source.path}: t_u is in group {found['t_u'][0].name!r}, u in {found['u'][0].name!r}"
        )
    told = {role: _unit(source, role, column, units) for role, (_, column) in found.items()}
    return {role: _in_si(source.path, role, *each, told[role]) for role, each in found.items()}


def _axis_prefix(source: Source, columns: Mapping[str, str], axis: str | None, of_rig: bool) -> str:
    """`motor.` where columns are called `motor.y`, else nothing."""
    names = {column.name for group in source.groups if group.main for column in group.columns}
    axes = sorted(
        name.removesuffix(".y") for name in names if name.endswith(".y") and f"{name[:-1]}u" in names
    )
    if axis is not None:
        known = axes or _recorded_axes(source)
        if axis not in known and (known or not of_rig):
            why = suggest(axis, known, "axes") if known else "its columns name no axis: leave it out"
            raise ReadError(f"{source.path}: no axis {axis!r}; {why}")
        return f"{axis}." if axis in axes else ""
    if "y" in names or {"y", "u"} <= columns.keys() or not axes:
        return ""
    if len(axes) > 1:
        choose = ",".join(f"{role}={axes[0]}.{role}" for role in ("t", "u", "y"))
        raise ReadError(f"{source.path}: has the axes {', '.join(axes)}: choose one, `--columns {choose}`")
    return f"{axes[0]}."


def _recorded_axes(source: Source) -> list[str]:
    """The axes of a recording of this program; its columns carry their names only where there are several."""
    try:
        axes = json.loads(source.notes.get(f"{PROFILE}.axes", "[]"))
    except ValueError:  # a damaged file; its reader tells
        return []
    return axes if isinstance(axes, list) else []


def _look_up(source: Source, name: str, must: bool) -> tuple[Group, Column] | None:
    """The column of this name, in one of the main groups if it was not asked for expressly."""
    hits = []
    for group in source.groups:
        own = name.removeprefix(f"{group.name}.") if group.name else name
        column = group.column(name) or group.column(own)
        if column is not None and (must or group.main):
            hits.append((group, column))
    if len(hits) > 1:
        named = ", ".join(f"{group.name}.{column.name}" for group, column in hits)
        raise ReadError(f"{source.path}: several columns are called {name!r}: {named}; name one of them so")
    if not hits and must:
        raise ReadError(_missing(source, name, None))
    return hits[0] if hits else None


def _called(source: Source, prefix: str, role: str, only: Group | None = None) -> str:
    """`y`, or where no column is called so the one that tells its unit as well: `y_mm`."""
    own = prefix + role
    groups = [group for group in source.groups if group.main] if only is None else [only]
    names = [column.name for group in groups for column in group.columns]
    if own in names:
        return own
    longer = sorted({name for name in names if name.startswith(prefix) and unit_of_role(role, name)})
    if len(longer) > 1:
        choose = f"`--columns {role}={longer[0]}`"
        raise ReadError(f"{source.path}: {', '.join(longer)} may each be {role}: choose one, {choose}")
    return longer[0] if longer else own


def unit_of_role(role: str, name: str) -> str:
    """The unit in the name of a role's column, `mm` of `y_mm`; "" of others."""
    before, _, unit = name.rpartition(".")[-1].partition(f"{role}_")
    known = KNOWN.get(spelled(unit)) if unit != _NO_INCH else None
    return spelled(unit) if not before and known is not None and known[0] in NAMED[role] else ""


def _time(source: Source, name: str | None, prefix: str, group: Group) -> tuple[Group, Column]:
    """Time of the group: what was asked for, else its `t`, else what the format says."""
    if name is not None:
        own = group.column(name) or group.column(name.removeprefix(f"{group.name}."))
        if own is not None:
            return group, own
        other = _look_up(source, name, must=True)
        raise ReadError(
            f"{source.path}: column {name!r} is in group {other[0].name!r}, y in {group.name!r}"
            if other
            else _missing(source, name, "t")
        )
    column = group.column(_called(source, prefix, "t", group)) or group.column(group.time or "")
    if column is None:
        raise ReadError(_missing(source, f"{prefix}t", "t"))
    return group, column


def _missing(source: Source, name: str, role: str | None) -> str:
    several = len(source.groups) > 1
    names = [f"{g.name}.{c.name}" if several else c.name for g in source.groups for c in g.columns]
    hint = f"; `--columns {role}=NAME` says which it is" if role else ""
    hint += ", `t=50Hz` that rows come at this rate" if role == "t" else ""
    return f"{source.path}: no column {name!r}; {suggest(name, names, 'columns')}{hint}"


def unit_in_name(name: str) -> str:
    """`ms`, `us`, `ns` or `s` of times that are called so; "" of others."""
    named = _UNIT_IN_NAME.fullmatch(name)
    return "" if named is None or named.lastgroup is None else named.lastgroup.removeprefix("of_")


def _unit(source: Source, role: str, column: Column, units: Mapping[str, str]) -> str | None:
    """The unit that was given; else, where the file gives none, that in the column's name, remarked."""
    if role in units or column.unit:
        return units.get(role)
    unit = unit_of_role(role, column.name) or (unit_in_name(column.name) if role in ("t", "t_u") else "")
    if not unit or unit == ROLES[role][0]:
        return unit or None
    usual = to_base(unit)[2]
    message = f"column {column.name!r} is taken as {unit} by its name; `--units {role}={usual}` if it is not"
    source.remarks.append(Remark("unit", message))
    return unit


def _in_si(path: Path, role: str, group: Group, column: Column, given: str | None) -> Found:
    where = place(path, column=column.name)
    if column.text:
        raise ReadError(f"{where}: holds text; {role} must be numbers")
    default, dimensions = ROLES["t" if role in TIMES.values() else role]
    unit = spelled(given if given is not None else column.unit) or default
    if unit not in KNOWN:
        if given is not None or dimensions:
            raise ReadError(
                f"{where}: unit {unit!r} is not known; {suggest(unit, _right(dimensions), 'units')}"
            )
        return Found(group, column, 1.0, 0.0, unit, read_in=unit)
    if dimensions and KNOWN[unit][0] not in dimensions:
        raise ReadError(f"{where}: {role} cannot be in {unit}; {suggest(unit, _right(dimensions), 'units')}")
    return Found(group, column, *to_base(unit), has_unit=bool(given or column.unit), read_in=unit)


def _right(dimensions: Sequence[str]) -> list[str]:
    return [
        unit for unit, (dimension, _) in KNOWN.items() if unit and (not dimensions or dimension in dimensions)
    ]
