"""`seod identify`: recordings in, a table, JSON or a plot out."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

from seod.data import read
from seod.identify.answer import identify
from seod.identify.record import Record
from seod.identify.show import as_text, plot

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.identify.record import Output


class Wishes(NamedTuple):
    """Options of the command."""

    gain: float | None
    delay: float | None
    output: Output
    offset: bool
    columns: str
    units: str
    axis: str | None
    as_json: bool
    plot: Path | None


def run(paths: Sequence[Path], config: RigConfig | None, wishes: Wishes) -> str:
    """The answer as it is printed.

    Raises:
        ReadError: A file cannot be read.
        IdentifyError: A recording tells nothing.
    """
    axis = wishes.axis
    records = []
    for path in paths:
        data = read(path, columns=wishes.columns, units=wishes.units, axis=axis)
        records.append(Record(path, data.t, data.u, data.y, data.t_u, wishes.output, wishes.offset))
    result = identify(records, wishes.gain, wishes.delay)
    if wishes.plot is not None:
        plot(records, result, wishes.plot)
    truth = _configured(config, axis)
    if wishes.as_json:
        answer: dict[str, Any] = result.as_json()
        return json.dumps(answer | {"configured": truth} if truth else answer)
    return as_text(result, [record.name for record in records], truth)


def _configured(config: RigConfig | None, axis: str | None) -> dict[str, float]:
    """What the rig file has for the same values, to compare."""
    if config is None:
        return {}
    section = config.axes[axis if axis is not None else next(iter(config.axes))]
    delay = {"delay": section.estimator.delay}
    return delay | ({"K_L": section.K_L} if isinstance(section.K_L, float | int) else {})
