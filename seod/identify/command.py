"""`seod identify`: recordings in, a table, JSON or a plot out."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from seod.data import read
from seod.identify.answer import Result, identify
from seod.identify.record import Record, UntoldError
from seod.identify.show import as_text, plot

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.config.model import AxisConfig, RigConfig
    from seod.identify.drive import Hold
    from seod.identify.record import Output


class Wishes(NamedTuple):
    """Options of the command; None: as the rig file says, else the first."""

    gain: float | None
    delay: float | None
    output: Output | None
    offset: bool
    hold: Hold
    columns: str
    units: str
    axis: str | None
    as_json: bool
    plot: Path | None


def run(paths: Sequence[Path], config: RigConfig | None, wishes: Wishes) -> str:
    """The answer as it is printed.

    Raises:
        ReadError: A file cannot be read.
        IdentifyError: A recording cannot be used.
    """
    section = None if config is None else config.axes[wishes.axis or next(iter(config.axes))]
    output = wishes.output or ("position" if section is None else section.mode)
    records, told = [], []
    for path in paths:
        try:
            records.append(_record(path, output, wishes))
        except UntoldError as error:
            told.append(error)
    result = _result(records, told, wishes)
    if wishes.plot is not None:
        plot(records, result, wishes.plot)
    truth = {} if section is None else _configured(section)
    if wishes.as_json:
        answer: dict[str, Any] = result.as_json()
        return json.dumps(answer | {"configured": truth} if truth else answer, allow_nan=False)
    return as_text(result, [str(path) for path in paths], truth)


def _record(path: Path, output: Output, wishes: Wishes) -> Record:
    data = read(path, columns=wishes.columns, units=wishes.units, axis=wishes.axis)
    return Record(path, data.t, data.u, data.y, data.t_u, output, wishes.offset, wishes.hold)


def _result(records: Sequence[Record], told: Sequence[UntoldError], wishes: Wishes) -> Result:
    """Of the recordings that tell something; those left out are named."""
    left_out = tuple(str(error) for error in told)
    if not records:
        return Result(None, told[0].quality, "; ".join(left_out))
    result = identify(records, wishes.gain, wishes.delay)
    return replace(result, cannot_tell=(*left_out, *result.cannot_tell))


def _configured(section: AxisConfig) -> dict[str, float]:
    """What the rig file has for the same values, to compare."""
    delay = {"delay": section.estimator.delay}
    return delay | ({"K_L": section.K_L} if isinstance(section.K_L, float | int) else {})
