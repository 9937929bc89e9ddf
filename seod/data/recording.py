"""Any file of measured data as `t`, `u`, `y`, in SI units and increasing time."""

from __future__ import annotations

from collections import defaultdict
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.answers import Answer
from seod.data import describe
from seod.data.align import commands, held
from seod.data.clock import Clock
from seod.data.columns import TIMES, parse_pairs, resolve
from seod.data.constant_rate import with_times
from seod.data.open import open_source
from seod.data.problems import Problem, clipped, remarks, value_problems
from seod.data.progress import shown
from seod.data.source import ReadError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from seod.data.columns import Found
    from seod.data.source import Floats, Rows, Source, Table

_OPTIONAL = ("ps", "temperature", "f")
_NOWHERE: Rows = np.array([], np.int64)


@dataclass(frozen=True, repr=False)
class Recording(Answer):
    """Row k holds `y[k]` sampled at `t[k]` and `u[k]`, which left at `t_u[k]` and held until the next.

    Attributes:
        paths: Files, in the order of their rows.
        t: Strictly increasing [s], shape (n,); the zero is the file's own.
        u: Command; nan where the file has none, shape (n,).
        y: Sample; nan where none came, shape (n,).
        t_u: When `u` left [s], shape (n,); None if the file does not tell: at `t`.
        ps: Supply pressure [Pa], shape (n,), or None.
        temperature: Of the oil [K], shape (n,), or None.
        rows: Where each row stands in its file: line of a text file, else number from 1; shape (n,).
        names: Role -> column of the first file.
        units: Role -> unit of these arrays: the SI base unit; the file's own where we do not know it.
        problems: What is wrong with the files, what was left out included.
        f: Measured disturbance, such as a force on the load, shape (n,), or None.
        table: Where it is of, if that is in memory; None: of `paths`.
        read_in: Role -> unit in which the file has it, such as mm; empty where nobody tells.
    """

    paths: tuple[Path, ...]
    t: Floats
    u: Floats
    y: Floats
    t_u: Floats | None
    ps: Floats | None
    temperature: Floats | None
    rows: Rows
    names: Mapping[str, str]
    units: Mapping[str, str]
    problems: tuple[Problem, ...]
    f: Floats | None = None
    table: Table | None = None
    read_in: Mapping[str, str] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """By the median interval."""
        return 1.0 / float(np.median(np.diff(self.t)))

    @contextmanager
    def opened(self) -> Iterator[Source]:
        """Its source once more, for columns of no role.

        Raises:
            ReadError: Its file cannot be read any more.
        """
        if self.table is not None:
            yield self.table
            return
        with open_source(self.paths[0]) as source:
            yield source

    def summary(self) -> str:
        """Length, rate, ranges, and what is wrong with it."""
        return describe.as_text(self)

    def to_dict(self) -> dict[str, Any]:
        """Rows, rate, and unit and range of each column."""
        return describe.as_dict(self)

    def to_columns(self) -> dict[str, Any]:
        """Its columns, in SI units."""
        return describe.columns(self)

    def plot(self) -> Figure:
        """Command, reading and conditions over time."""
        return describe.draw(self)


def read(
    paths: Path | str | Sequence[Path | str],
    columns: str | Mapping[str, str] = "",
    units: str | Mapping[str, str] = "",
    axis: str | None = None,
    dbc: Path | None = None,
    between: tuple[float, float] | None = None,
    of_rig: bool = False,
) -> Recording:
    """Read a recording; several files are parts of one, in the order given.

    Rows whose time is missing or does not increase are left out, and `problems` says so.

    Args:
        paths: CSV (plain or gzip), Parquet, MAT, MCAP, MDF or CAN log.
        columns: `t=time,u=cmd,y=pos` where names differ; `t_u`, `ps`, `temperature` and `f` likewise.
            `t=50Hz` where rows tell no time and come at this rate.
        units: `y=deg,u=mV` where the file tells none, or wrong ones.
        axis: Of a file with several: `motor` reads `motor.t`, `motor.u`, ...
        dbc: For a CAN log.
        between: Only rows with a time from here to there [s].
        of_rig: The axis is a rig file's, and columns that name none are taken to be its.

    Raises:
        ReadError: Names file, row and column as far as there are any.
    """
    files = [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]
    if not files:
        raise ReadError("no file to read")
    mapping, given = _pairs(columns, "--columns"), _pairs(units, "--units")
    parts = []
    for path in files:
        with open_source(path, dbc) as source:
            timed, named = with_times(source, mapping)
            parts.append(_one(timed, resolve(timed, named, given, axis, of_rig), between))
    return parts[0] if len(parts) == 1 else _joined(parts)


def read_table(
    table: Table,
    columns: str | Mapping[str, str] = "",
    units: str | Mapping[str, str] = "",
    axis: str | None = None,
    between: tuple[float, float] | None = None,
    of_rig: bool = False,
) -> Recording:
    """As `read`, of data that is in memory.

    Raises:
        ReadError: Names row and column as far as there are any.
    """
    mapping, given = _pairs(columns, "columns"), _pairs(units, "units")
    timed, named = with_times(table, mapping)
    return replace(_one(timed, resolve(timed, named, given, axis, of_rig), between), table=table)


def _pairs(pairs: str | Mapping[str, str], option: str) -> Mapping[str, str]:
    if not isinstance(pairs, str):
        return pairs
    return parse_pairs(pairs, option) if pairs else {}


def _one(source: Source, found: Mapping[str, Found], between: tuple[float, float] | None) -> Recording:
    arrays, rows = _gathered(source, found, between)
    problems: list[Problem] = []
    usable: dict[str, NDArray[np.bool_]] = {}
    for role in ("t", *TIMES.values()):
        if role in found and (name := found[role].group.name) not in usable:
            clock = Clock(source.path, found[role].column.name, found[role].has_unit)
            usable[name] = clock.add(arrays[role], rows[name])
            problems += clock.problems()
    kept = {name: rows[name][keep] for name, keep in usable.items()}
    arrays = {role: x[usable[found[role].group.name]] for role, x in arrays.items()}
    if not len(arrays["t"]):
        raise ReadError(f"{source.path}: no row with a time")
    problems += _values_problems(source.path, found, arrays, kept)
    problems += _align(source.path, found, arrays)
    return _recording(source.path, found, arrays, kept, [*remarks(source), *problems])


def _values_problems(
    path: Path, found: Mapping[str, Found], arrays: Mapping[str, Floats], rows: Mapping[str, Rows]
) -> Iterator[Problem]:
    for role in ("y", "u", *_OPTIONAL):
        if role in arrays and (role not in _OPTIONAL or _told(arrays[role]) is not None):
            where = path, found[role].column.name, arrays[role], rows[found[role].group.name]
            yield from value_problems(*where)
            if role == "y":
                yield from clipped(*where)


def _align(path: Path, found: Mapping[str, Found], arrays: dict[str, Floats]) -> list[Problem]:
    """Bring what comes at times of its own to the rows of `y`, in `arrays` itself."""
    t, own = arrays["t"], found["t"].group
    problems: list[Problem] = []
    if found["u"].group is not own:
        arrays["u"], arrays["t_u"], extra = commands(t, arrays["t_u"], arrays["u"])
        if extra:
            message = f"{extra} commands were followed by another before the next sample: left out"
            problems.append(Problem("several_commands", path, found["u"].column.name, _NOWHERE, message))
    for role in _OPTIONAL:
        if role in found and found[role].group is not own:
            arrays[role] = held(t, arrays[TIMES[role]], arrays[role])
    return problems


def _recording(
    path: Path,
    found: Mapping[str, Found],
    arrays: Mapping[str, Floats],
    rows: Mapping[str, Rows],
    problems: Sequence[Problem],
) -> Recording:
    return Recording(
        paths=(path,),
        t=arrays["t"],
        u=arrays["u"],
        y=arrays["y"],
        t_u=_told(arrays.get("t_u")),
        ps=_told(arrays.get("ps")),
        temperature=_told(arrays.get("temperature")),
        f=_told(arrays.get("f")),
        rows=rows[found["t"].group.name],
        names={role: each.column.name for role, each in found.items()},
        units={role: each.unit for role, each in found.items()},
        read_in={role: each.read_in if each.has_unit else "" for role, each in found.items()},
        problems=tuple(problems),
    )


def _told(x: Floats | None) -> Floats | None:
    """None for a column that is empty throughout."""
    return None if x is None or np.isnan(x).all() else x


def _gathered(
    source: Source, found: Mapping[str, Found], between: tuple[float, float] | None
) -> tuple[dict[str, Floats], dict[str, Rows]]:
    """Whole columns in SI units by role, and their rows by group."""
    wanted: dict[str, list[str]] = defaultdict(list)
    for each in found.values():
        wanted[each.group.name].append(each.column.name)
    pieces: dict[str, list[Floats]] = {role: [np.array([])] for role in found}
    rows: dict[str, list[Rows]] = {name: [np.array([], np.int64)] for name in wanted}
    blocks = source.blocks({name: list(dict.fromkeys(names)) for name, names in wanted.items()})
    for block in shown(blocks, source.path.name):
        own = {role: e.si(block.values[e.column.name]) for role, e in found.items() if e.group == block.group}
        time = next((own[role] for role in ("t", *TIMES.values()) if role in own), None)
        keep = _inside(time, between)
        rows[block.group.name].append(block.rows[keep])
        for role, values in own.items():
            pieces[role].append(values[keep])
    whole = {role: np.concatenate(each) for role, each in pieces.items()}
    return whole, {name: np.concatenate(each) for name, each in rows.items()}


def _inside(t: Floats | None, between: tuple[float, float] | None) -> slice | Rows:
    if between is None or t is None:
        return slice(None)
    return np.flatnonzero((t >= between[0]) & (t <= between[1]))


def _joined(parts: Sequence[Recording]) -> Recording:
    """Parts of one recording.

    Raises:
        ReadError: They have other units or columns, or a part does not begin after the one before has ended.
    """
    first = parts[0]
    for before, part in pairwise(parts):
        if part.units != first.units:
            raise ReadError(f"{part.paths[0]}: has other columns or units than {first.paths[0]}")
        if part.t[0] <= before.t[-1]:
            message = f"begins at {part.t[0]:g} s, before the end of {before.paths[0]} at {before.t[-1]:g} s"
            raise ReadError(f"{part.paths[0]}: {message}; give the parts of a recording in their order")
    arrays: dict[str, Any] = {
        name: _join([getattr(part, name) for part in parts])
        for name in ("t", "u", "y", "t_u", *_OPTIONAL, "rows")
    }
    return Recording(
        paths=tuple(path for part in parts for path in part.paths),
        names=first.names,
        units=first.units,
        read_in=first.read_in,
        problems=tuple(problem for part in parts for problem in part.problems),
        **arrays,
    )


def _join(arrays: Sequence[NDArray[Any] | None]) -> NDArray[Any] | None:
    """End to end; None if one is None."""
    present = [array for array in arrays if array is not None]
    return np.concatenate(present) if len(present) == len(arrays) else None
