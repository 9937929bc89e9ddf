"""MAT files up to version 7, by scipy. Such a file is in memory as a whole."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import Column, Group, ReadError, Remark, Table

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from seod.data.source import Values

_MAX_COLUMNS = 64
"""Widest matrix whose columns are taken as signals."""
UNITS = "units"
"""Variable that holds the units: a struct with a text for each column."""


def open_mat(path: Path) -> Table:
    """Vectors, columns of matrices (`data[2]`), fields of structs (`run.pos`); a group for each length.

    Raises:
        ReadError: Version 7.3, or nothing but scalars in it.
    """
    content = _load(path)
    units = content.pop(UNITS, {})
    vectors: dict[int, dict[str, Values]] = {}
    remarks: list[Remark] = []
    for name, value in _leaves(content):
        vector = _vector(value)
        if vector is None:
            remarks.append(Remark("unread", f"{name}: is neither a vector of numbers nor one of texts"))
        elif len(vector) > 1:
            vectors.setdefault(len(vector), {})[name] = vector
    if not vectors:
        raise ReadError(f"{path}: has no vectors of numbers; expected t, u and y, or structs of such")
    arrays = {"" if len(vectors) == 1 else f"{n} rows": v for n, v in vectors.items()}
    groups = [
        Group(
            name,
            tuple(Column(key, _unit(units, key), vector.dtype == object) for key, vector in each.items()),
        )
        for name, each in arrays.items()
    ]
    scalars = {name: str(value) for name, value in _leaves(content) if np.ndim(value) == 0}
    return Table(path, "mat", tuple(groups), arrays, scalars, remarks)


def _load(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat  # noqa: PLC0415 - slow to import

    try:
        content: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise ReadError(
            f"{path}: is a MAT file of version 7.3 (HDF5), which is not read; in MATLAB: save(name, '-v7')"
        ) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _leaves(content: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Each value that is no struct, with its dotted name; a matrix column by column."""
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.")
        elif isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
            yield from _leaves({f"{name}[{k}]": each for k, each in enumerate(value, 1)}, prefix)
        elif np.ndim(value) == 2 and 1 < min(np.shape(value)) <= _MAX_COLUMNS:
            matrix = value if value.shape[0] >= value.shape[1] else value.T
            yield from ((f"{prefix}{name}[{k}]", column) for k, column in enumerate(matrix.T, 1))
        else:
            yield f"{prefix}{name}", value


def _vector(value: Any) -> Values | None:
    """float64 of numbers, objects of texts; of a scalar one element; None of anything else."""
    array = np.atleast_1d(np.asarray(value)).squeeze()
    array = np.atleast_1d(array)
    if array.ndim == 1 and array.dtype.kind in "fiub":
        return array.astype(np.float64)
    if array.ndim == 1 and (array.dtype.kind == "U" or all(isinstance(each, str) for each in array)):
        return np.array([str(each).strip() for each in array], object)
    return None


def _unit(units: Any, name: str) -> str:
    """The unit of a dotted name in the struct of units."""
    for part in name.split("."):
        units = units.get(part, "") if isinstance(units, dict) else ""
    return units if isinstance(units, str) else ""
