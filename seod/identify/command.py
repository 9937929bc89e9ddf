"""`seod identify`: recordings in, a table, JSON or a plot out."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from seod.data import read
from seod.gain import gain_of, gain_range, is_identified, needs_pressure
from seod.identify.answer import Result, identify
from seod.identify.live import Beforehand, answers, summary
from seod.identify.record import IdentifyError, Record, UntoldError
from seod.identify.relay_rows import relay_rows
from seod.identify.show import as_text, plot

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from seod.config.model import AxisConfig, RigConfig
    from seod.data import Recording
    from seod.identify.drive import Hold
    from seod.identify.record import Output


Method = Literal["output_error", "wave", "exact", "peaks"]


class Wishes(NamedTuple):
    """Options of the command; None: as the rig file says, else the first."""

    method: Method
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
    files, told = _files(paths, wishes, section)
    result = _result(files, told, wishes, section)
    if wishes.plot is not None:
        plot([file.record for file in files], result, wishes.plot)
    truth = {} if section is None else _configured(section)
    if wishes.as_json:
        answer: dict[str, Any] = result.as_json()
        return json.dumps(answer | {"configured": truth} if truth else answer, allow_nan=False)
    return as_text(result, [str(path) for path in paths], truth)


class _File(NamedTuple):
    path: Path
    data: Recording
    record: Record


def _files(
    paths: Sequence[Path], wishes: Wishes, section: AxisConfig | None
) -> tuple[list[_File], list[UntoldError]]:
    """Recordings that tell something, and why others do not."""
    output = wishes.output or ("position" if section is None else section.mode)
    files, told = [], []
    for path in paths:
        data = read(path, columns=wishes.columns, units=wishes.units, axis=wishes.axis)
        try:
            record = Record(path, data.t, data.u, data.y, data.t_u, output, wishes.offset, wishes.hold)
        except UntoldError as error:
            told.append(error)
        else:
            files.append(_File(path, data, record))
    return files, told


def _result(
    files: Sequence[_File], told: Sequence[UntoldError], wishes: Wishes, section: AxisConfig | None
) -> Result:
    """Of the recordings that tell something; those left out are named."""
    left_out = tuple(str(error) for error in told)
    if not files:
        return Result(None, told[0].quality, "; ".join(left_out), method=wishes.method)
    records = [file.record for file in files]
    if wishes.method == "output_error":
        result = identify(records, wishes.gain, wishes.delay)
    else:
        result = _as_live(files, wishes, section)
    return replace(result, cannot_tell=(*left_out, *result.cannot_tell))


def _as_live(files: Sequence[_File], wishes: Wishes, section: AxisConfig | None) -> Result:
    """By the daemon's estimators, one after the other."""
    records, method = [file.record for file in files], wishes.method
    gain = _gain(files, wishes, section)
    known = _beforehand(records, wishes, section, gain is not None)
    told = []
    for file in files:
        rows = relay_rows(file.path, file.data, wishes.axis, file.record.output, gain or _unknown)
        told += answers(rows, file.record, method, known)
    return summary(records, told, method, known)


def _unknown(_ps: float) -> float:
    return math.nan


def _gain(
    files: Sequence[_File], wishes: Wishes, section: AxisConfig | None
) -> Callable[[float], float] | None:
    """K_L by the supply pressure, of the options, else of the rig file; None where neither tells it."""
    if (given := wishes.gain) is not None:
        return lambda _ps: given
    if section is None or is_identified(section.K_L):
        return None
    if needs_pressure(section.K_L) and any(file.data.ps is None for file in files):
        return None
    return gain_of(section.K_L)


def _beforehand(
    records: Sequence[Record], wishes: Wishes, section: AxisConfig | None, has_gain: bool
) -> Beforehand:
    """What the options say, else the rig file; where neither, `wave` begins with a fit of the whole."""
    known = Beforehand(1.0, math.inf, 0.0, math.inf) if section is None else _of_rig_file(section)
    if wishes.delay is not None:
        known = known._replace(delay=wishes.delay, delay_sd=0.0)
    if has_gain:
        return known if wishes.gain is None else known._replace(K_L=wishes.gain, K_L_sd=0.0)
    if wishes.method != "wave":
        raise IdentifyError(
            f"{wishes.method} needs K_L: give it by --gain or by a rig file (--config), where it follows the "
            f"supply pressure with recordings that have `ps`"
        )
    first = identify(records, None, wishes.delay).fit
    if first is None:
        return known
    guess = known._replace(K_L=abs(first.value["K_L"]), K_L_sd=math.inf)
    is_told = section is not None or wishes.delay is not None
    return guess if is_told else guess._replace(delay=max(first.value["delay"], 0.0))


def _of_rig_file(section: AxisConfig) -> Beforehand:
    estimator = section.estimator
    return Beforehand(
        K_L=sum(gain_range(section.K_L)) / 2.0,
        K_L_sd=_deviation(estimator.K_L_sd),
        delay=estimator.delay,
        delay_sd=_deviation(estimator.delay_sd),
        hysteresis=section.relay.hysteresis,
        cycles=estimator.cycles,
    )


def _deviation(told: float | str | None) -> float:
    """Of a value in the rig file: certain where it tells none, inf where it calls it unknown."""
    return math.inf if isinstance(told, str) else told or 0.0


def _configured(section: AxisConfig) -> dict[str, float]:
    """What the rig file has for the same values, to compare."""
    delay = {"delay": section.estimator.delay}
    return delay | ({"K_L": section.K_L} if isinstance(section.K_L, float | int) else {})
