"""Measured data from wherever it is: a file, a table of pandas or polars, arrays, or a simulation."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from seod.data.memory import is_table, table_of
from seod.data.recording import Recording, read_table
from seod.data.recording import read as read_files
from seod.data.source import ReadError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Data = Any
"""A path, several paths that are parts of one recording, a table with named columns (pandas, polars, a
mapping of arrays), a `Recording`, or a `Simulation`."""

ARRAYS = ("t", "u", "y", "t_u", "ps", "temperature", "f")


def read(
    data: Data = None,
    *,
    t: ArrayLike | None = None,
    u: ArrayLike | None = None,
    y: ArrayLike | None = None,
    t_u: ArrayLike | None = None,
    ps: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    f: ArrayLike | None = None,
    columns: str | Mapping[str, str] = "",
    units: str | Mapping[str, str] = "",
    axis: str | None = None,
    dbc: str | Path | None = None,
    between: str | tuple[float, float] | None = None,
    name: str = "data",
) -> Recording:
    """Read measured data: `t`, `u` and `y` in SI units and increasing time.

    Args:
        data: A path (CSV, Parquet, MAT, MCAP, MDF, CAN log), several that are parts of one recording, or a
            table of pandas or polars. Left out: the arrays.
        t: Times of the samples [s], shape (n,).
        u: Commands [V], shape (n,).
        y: Samples, shape (n,); nan where none came.
        t_u: When each command left [s], shape (n,); left out: at `t`.
        ps: Supply pressure [Pa], shape (n,).
        temperature: Of the oil [K], shape (n,).
        f: Measured disturbance, such as a force on the load, shape (n,).
        columns: Names that differ: `"t=time,u=cmd,y=pos"`, or a mapping. `t=50Hz` where rows tell no time.
        units: Units where the data tell none, or wrong ones: `"y=deg,u=mV"`, or a mapping.
        axis: Of data with several.
        dbc: For a log of CAN frames.
        between: Only this part [s]: `"1:5"`, or a pair.
        name: Stands for a file's name in messages about data in memory.

    Raises:
        ReadError: Says what is wrong, and where.
    """
    given = arrays(t=t, u=u, y=y, t_u=t_u, ps=ps, temperature=temperature, f=f)
    how = How(columns, units, axis, None if between is None else pair(between, "--between"), dbc, name)
    return one(data if data is not None else given, how)


class How(NamedTuple):
    """How data are read: see `read`; `of_rig`: the axis is a rig file's."""

    columns: str | Mapping[str, str] = ""
    units: str | Mapping[str, str] = ""
    axis: str | None = None
    between: tuple[float, float] | None = None
    dbc: str | Path | None = None
    name: str = "data"
    of_rig: bool = False


def arrays(**given: ArrayLike | None) -> dict[str, ArrayLike] | None:
    """Those that were given; None for none."""
    told = {name: each for name, each in given.items() if each is not None}
    return told or None


def one(data: Data, how: How) -> Recording:
    """One recording.

    Raises:
        ReadError: It cannot be read, or is nothing that can.
    """
    if data is None:
        raise ReadError("no data: give a path, a table, or the arrays t, u and y")
    recording = getattr(data, "recording", data)
    if isinstance(recording, Recording):
        if how.columns or how.units:
            raise ReadError("a Recording has its columns and units already: leave `columns` and `units` out")
        return recording if how.between is None else _part(recording, *how.between)
    if is_table(data):
        table = table_of(data, how.name)
        return read_table(table, how.columns, how.units, how.axis, how.between, how.of_rig)
    paths = _paths(data)
    dbc = None if how.dbc is None else Path(how.dbc)
    return read_files(paths, how.columns, how.units, how.axis, dbc, how.between, how.of_rig)


def several(data: Data, given: dict[str, ArrayLike] | None, how: How) -> list[Recording]:
    """Recordings that are fitted jointly: `data` may be a list of them.

    Raises:
        ReadError: One cannot be read.
    """
    return [one(each, how) for each in listed(data, given)]


def listed(data: Data, given: dict[str, ArrayLike] | None = None) -> list[Data]:
    """One by one, of one or a list.

    Raises:
        ReadError: Both data and arrays, or neither.
    """
    if data is not None and given is not None:
        raise ReadError("give either data or the arrays t, u and y, not both")
    whole = given if data is None else data
    if whole is None:
        raise ReadError("no data: give a path, a table, or the arrays t, u and y")
    return list(whole) if isinstance(whole, list | tuple) else [whole]


def _paths(data: Data) -> list[str | Path]:
    every = data if isinstance(data, Sequence) and not isinstance(data, str) else [data]
    for each in every:
        if not isinstance(each, str | os.PathLike):
            raise ReadError(
                f"{type(each).__name__} is no measured data: give a path, a table with named columns, or "
                "the arrays t, u and y by these names"
            )
    return [Path(each) for each in every]


def _part(of: Recording, start: float, end: float) -> Recording:
    """Rows from here to there [s]."""
    kept = np.flatnonzero((of.t >= start) & (of.t <= end))
    if not len(kept):
        raise ReadError(f"{of.paths[0]}: no row from {start:g} to {end:g} s")
    names = (*ARRAYS, "rows")
    columns: dict[str, Any] = {name: getattr(of, name) for name in names}
    part: dict[str, Any] = {name: None if each is None else each[kept] for name, each in columns.items()}
    return replace(of, **part)


def pair(value: str | tuple[float, float], name: str, *, positive: bool = False) -> tuple[float, float]:
    """`"0.5:60"`, or two numbers, as a rising pair.

    Args:
        value: As given.
        name: Of the option, for the message.
        positive: Both must be above 0.

    Raises:
        ValueError: It is neither.
    """
    try:
        low, high = value.split(":") if isinstance(value, str) else value
        ends = float(low), float(high)
    except (TypeError, ValueError):
        ends = 0.0, 0.0
    if not (0.0 if positive else -math.inf) < ends[0] < ends[1] < math.inf:
        above = " above 0" if positive else ""
        raise ValueError(f"{name} {value}: give two rising numbers{above}, such as 0.5:60")
    return ends
