"""Messages of an MCAP file on their way to rows of a group."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import Block, Column, Group, ReadError, place
from seod.processes.ring import AXIS_FIELDS, FLAG_FRESH, AxisState
from seod.record.layout import UNITS, decode

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from seod.data.source import Values

ROWS_GROUP = "rows"
LOG_TIME = "log_time"
MORE = "more"
_MOST_FIELDS = 1000
"""Fields of a channel that become columns; further ones go to `MORE`."""
_OF_AXIS = (*AXIS_FIELDS, "age", "state", "flags")
_STATES = {int(state): state.name.lower() for state in AxisState}


def rows_group(axes: Sequence[str], units: Mapping[str, Mapping[str, str]]) -> Group:
    """The ticks of a seod recording, with the columns of its CSV form; `units` by axis and field."""
    columns = [
        Column(
            column_name(axes, axis, field), units.get(axis, {}).get(field) or _unit(field), field == "state"
        )
        for axis in axes
        for field in _OF_AXIS
    ]
    return Group(ROWS_GROUP, (*columns, Column("tick"), Column("t_tick", "s")))


def column_name(axes: Sequence[str], axis: str, field: str) -> str:
    """`y`, or with several axes `motor.y`."""
    return f"{axis}.{field}" if len(axes) > 1 else field


def _unit(field: str) -> str:
    unit = UNITS.get(field, "").partition(",")[0]
    return "s" if field == "age" else unit if unit in ("s", "V", "Pa", "K") else ""


class TickRows:
    """Binary rows of all axes (`seod.record.layout`), joined by tick.

    As in the CSV form a tick without a new sample has no `y`, and as `t` when it would have been taken.
    """

    def __init__(self, group: Group, names: Sequence[str], path: Path, axes: Sequence[str]) -> None:
        self._group, self._names, self._path, self._axes = group, names, path, axes
        self._waiting: dict[str, list[bytes]] = {axis: [] for axis in axes}
        self._kept: dict[str, NDArray[np.void]] = {}
        self._last = dict.fromkeys(axes, (np.nan, np.nan))
        self._before = 0

    def __len__(self) -> int:
        """Messages that wait, of the axis that has the most."""
        return max(map(len, self._waiting.values()))

    def add(self, axis: str, data: bytes) -> None:
        """One message."""
        self._waiting[axis].append(data)

    def block(self, done: float, last: bool = False) -> Block:
        """All ticks that are complete; in the end all."""
        try:
            tables = {axis: decode(messages) for axis, messages in self._waiting.items()}
        except ValueError as error:
            raise ReadError(f"{place(self._path, self._before + 1)}: {error}") from error
        for axis in self._axes:
            self._waiting[axis] = []
            if axis in self._kept:
                tables[axis] = np.concatenate([self._kept.pop(axis), tables[axis]])
        if not last:
            complete = min(table["tick"][-1] if len(table) else -1 for table in tables.values())
            for axis, table in tables.items():
                self._kept[axis] = table[table["tick"] > complete]
                tables[axis] = table[table["tick"] <= complete]
        return self._joined(tables, done)

    def _joined(self, tables: Mapping[str, NDArray[np.void]], done: float) -> Block:
        ticks = np.unique(np.concatenate([table["tick"] for table in tables.values()]))
        rows = np.arange(self._before + 1, self._before + 1 + len(ticks))
        self._before += len(ticks)
        values: dict[str, Values] = {"tick": ticks.astype(np.float64), "t_tick": np.full(len(ticks), np.nan)}
        for axis, table in tables.items():
            at = np.searchsorted(ticks, table["tick"])
            values["t_tick"][at] = table["t_tick"]
            for field, own in self._of_axis(axis, table).items():
                whole = np.full(len(ticks), "" if own.dtype == object else np.nan, own.dtype)
                whole[at] = own
                values[column_name(self._axes, axis, field)] = whole
        return Block(self._group, {name: values[name] for name in self._names}, rows, done)

    def _of_axis(self, axis: str, table: NDArray[np.void]) -> dict[str, Values]:
        values: dict[str, Values] = {name: table[name].astype(np.float64) for name in _OF_AXIS}
        values["state"] = np.array(
            [_STATES.get(state, str(state)) for state in table["state"].tolist()], object
        )
        fresh = (table["flags"] & FLAG_FRESH) > 0
        t, tick = (
            np.concatenate(([old], x))
            for old, x in zip(self._last[axis], (table["t"], table["t_tick"]), strict=True)
        )
        newest = np.maximum.accumulate(np.where(fresh, np.arange(1, len(table) + 1), 0))
        values["t"] = np.where(fresh, table["t"], _made_up(fresh, newest, t, tick))
        values["y"] = np.where(fresh, table["y"], np.nan)
        if len(table):
            self._last[axis] = (float(t[newest[-1]]), float(tick[newest[-1]]))
        return values


def _made_up(
    fresh: NDArray[np.bool_], newest: NDArray[np.intp], t: NDArray[np.float64], tick: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The time of a row without a sample [s]: its tick's, after the newest and before the next sample."""
    rows = np.arange(1, len(fresh) + 1)
    following = np.minimum.accumulate(np.where(fresh, rows, len(rows) + 1)[::-1])[::-1]
    room = np.append(t, np.inf)[following] - t[newest]
    fits = tick[following - 1] - tick[newest] < room
    share = np.where(fits, 0.0, room) * (rows - newest) / np.maximum(following - newest, 1)
    return np.where(fits, t[newest] + tick[1:] - tick[newest], t[newest] + share)


class Fields:
    """What the JSON messages of one channel are made of, as far as they were seen."""

    def __init__(self) -> None:
        self._text: dict[str, bool] = {}

    def see(self, content: Mapping[str, Any]) -> None:
        """One message."""
        for name, value in content.items():
            if name in self._text or len(self._text) < _MOST_FIELDS:
                self._text[name] = isinstance(value, str) or self._text.get(name, False)

    def columns(self, told: Sequence[Column]) -> list[Column]:
        """The columns that a schema tells, and those that were seen besides."""
        known = {column.name for column in told}
        seen = [Column(name, "", text) for name, text in self._text.items() if name not in known]
        return [*told, *(column for column in seen if column.name not in (LOG_TIME, MORE))]


class JsonRows:
    """JSON messages of one channel; what has no column is JSON in the column `MORE`."""

    def __init__(self, group: Group, names: Sequence[str]) -> None:
        self._group, self._names = group, names
        self._text = {column.name: column.text for column in group.columns}
        self._waiting: list[dict[str, Any]] = []
        self._before = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, content: dict[str, Any]) -> None:
        """One message."""
        more = {name: value for name, value in content.items() if not self._has_place(name, value)}
        self._waiting.append({**content, MORE: json.dumps(more) if more else ""})

    def block(self, done: float) -> Block:
        """All of them, and begin anew."""
        rows = np.arange(self._before + 1, self._before + 1 + len(self._waiting))
        values = {name: self._values(name) for name in self._names}
        self._before += len(self._waiting)
        self._waiting = []
        return Block(self._group, values, rows, done)

    def _has_place(self, name: str, value: Any) -> bool:
        return value is None or (name in self._text and (self._text[name] or isinstance(value, float | int)))

    def _values(self, name: str) -> Values:
        found = [each.get(name) for each in self._waiting]
        if self._text[name]:
            return np.array(["" if value is None else str(value) for value in found], object)
        # None becomes nan
        return np.array([_number(value) for value in found], np.float64)


def _number(value: Any) -> float | None:
    try:
        return float(value) if isinstance(value, float | int) else None
    except OverflowError:  # JSON's whole numbers have no end
        return None


def flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested objects as dotted names; lists as JSON."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            found |= flat(value, f"{prefix}{key}.")
        else:
            found[prefix + key] = json.dumps(value) if isinstance(value, list) else value
    return found


def schema_columns(schema: bytes) -> list[Column]:
    """Columns by a JSON schema; none if it names no fields."""
    try:
        content = json.loads(schema)
    except ValueError:
        return []
    properties = content.get("properties") if isinstance(content, dict) else None
    return list(_fields(properties)) if isinstance(properties, dict) else []


def _fields(properties: Mapping[str, Any], prefix: str = "") -> Iterator[Column]:
    for key, value in properties.items():
        each = value if isinstance(value, dict) else {}
        if isinstance(each.get("properties"), dict):
            yield from _fields(each["properties"], f"{prefix}{key}.")
        else:
            yield Column(prefix + key, str(each.get("unit", "")), _is_text(each.get("type", "string")))


def _is_text(types: Any) -> bool:
    """Whether such a field may hold something else than numbers."""
    return not set(types if isinstance(types, list) else [types]) <= {"number", "integer", "boolean", "null"}
