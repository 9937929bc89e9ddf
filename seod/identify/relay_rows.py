"""A recording as the rows that the daemon's estimators are fed with."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.estimate.base import Row
from seod.identify.record import IdentifyError
from seod.processes.ring import FLAG_EXCITING, FLAG_SATURATED, FLAG_SECOND_PHASE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from seod.data import Recording
    from seod.estimate.arrays import Array
    from seod.identify.record import Output

_TOLD: Final = ("reference", "e_a", "bias", "signal", "flags")
"""Columns of the daemon's own recordings."""
_OFF: Final = 0.02
"""Part of e_a by which a relay's voltage may be off its two levels."""
_MOST_OFF: Final = 0.05
"""Part of the samples that may lie elsewhere: an entry, an end."""


def relay_rows(
    path: Path, data: Recording, axis: str | None, output: Output, gain: Callable[[float], float]
) -> list[Row]:
    """Rows of a relay's limit cycle; what the file does not tell of the relay is read off its voltage.

    Args:
        path: The file.
        data: What was read of it.
        axis: Of a file with several.
        output: What its y is.
        gain: K_L [unit/s/V] by the supply pressure [Pa]; nan where it tells none.

    Raises:
        IdentifyError: The voltage is no relay's.
        ReadError: The file cannot be read.
    """
    told = _told(data, axis)
    t_u = data.t if data.t_u is None else data.t_u
    ps = np.full(len(data.t), np.nan) if data.ps is None else data.ps
    columns: dict[str, NDArray[Any]] = {
        "t": data.t,
        "u": data.u,
        "t_u": np.where(np.isnan(t_u), data.t, t_u),
        "K_L": np.array([gain(each) for each in ps.tolist()]),
        "y": data.y if output == "position" else _integral(data, told),
    }
    speed = {"speed": data.y} if output == "velocity" else {}
    return list(_rows({**columns, **speed, **_of_the_relay(path, data, told, output)}))


def _rows(columns: Mapping[str, NDArray[Any]]) -> Iterator[Row]:
    names = list(columns)
    for values in zip(*(column.tolist() for column in columns.values()), strict=True):
        row = dict(zip(names, values, strict=True))
        yield Row(**row, fresh=row["y"] == row["y"])


def _of_the_relay(
    path: Path, data: Recording, told: Mapping[str, Array], output: Output
) -> Mapping[str, NDArray[Any]]:
    """Columns that describe the relay."""
    n = len(data.t)
    if told.keys() >= {"e_a", "bias", "flags", "reference"}:
        flags = np.nan_to_num(told["flags"]).astype(np.int64)
        relay: dict[str, NDArray[Any]] = {
            "e_a": told["e_a"],
            "bias": told["bias"],
            "reference": told["reference"] if output == "position" else np.zeros(n),
            "exciting": (flags & FLAG_EXCITING) > 0,
            "saturated": (flags & FLAG_SATURATED) > 0,
            "second": (flags & FLAG_SECOND_PHASE) > 0,
        }
        return relay
    e_a, bias = _levels(path, data.u)
    off = np.abs(np.abs(data.u - bias) - e_a)
    middle = float(np.nanmedian(data.y)) if output == "position" else 0.0
    return {
        "e_a": np.full(n, e_a),
        "bias": np.full(n, bias),
        "reference": np.full(n, middle),
        "exciting": off < _OFF * e_a,
    }


def _levels(path: Path, u: Array) -> tuple[float, float]:
    """Amplitude and bias [V] of a voltage that has but two levels."""
    low, high = np.nanpercentile(u, [10.0, 90.0]).tolist()
    e_a, bias = 0.5 * (high - low), 0.5 * (high + low)
    off = np.abs(np.abs(u - bias) - e_a)
    if not e_a > 0.0 or np.nanmean(off > _OFF * e_a) > _MOST_OFF:
        raise IdentifyError(
            f"{path}: u is no relay's, which has two levels; the estimators of a limit cycle need one: "
            f"leave out --method"
        )
    return e_a, bias


def _integral(data: Recording, told: Mapping[str, Array]) -> Array:
    """What the relay of a speed switches by: the integral of the speed about its mean."""
    if "signal" in told:
        return np.where(np.isnan(data.y), np.nan, -told["signal"])
    held = np.where(np.isnan(data.y), 0.0, data.y - np.nanmean(data.y))
    return np.concatenate(([0.0], np.cumsum(0.5 * (held[1:] + held[:-1]) * np.diff(data.t))))


def _told(data: Recording, axis: str | None) -> dict[str, Array]:
    """Columns of `_TOLD` that the file has, for the rows of `data`."""
    prefix = data.names["y"].removesuffix("y") if axis is None else f"{axis}."
    found: dict[str, list[Array]] = defaultdict(list)
    rows: list[Array] = []
    with data.opened() as source:
        for group in source.groups:
            there = {name: name.removeprefix(prefix) for name in (c.name for c in group.columns)}
            wanted = [name for name, role in there.items() if role in _TOLD and group.main]
            if not wanted:
                continue
            for block in source.blocks({group.name: wanted}):
                rows.append(block.rows.astype(np.float64))
                for name in wanted:
                    found[there[name]].append(np.asarray(block.values[name], np.float64))
            break
    if not found:
        return {}
    at = np.searchsorted(np.concatenate(rows), data.rows)
    return {role: np.concatenate(parts)[at] for role, parts in found.items()}
