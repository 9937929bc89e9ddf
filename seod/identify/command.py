"""`seod identify`: recordings in, a table, JSON or a plot out."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from drivers.base import UNTOLD_PERIODS
from seod.config.gain_in_force import gain_of, gain_range, is_identified, needs_pressure
from seod.config.known import known_to
from seod.data import read
from seod.data.problems import tell
from seod.identify.answer import Result, identify
from seod.identify.live import Beforehand, answers, summary
from seod.identify.plot import plot
from seod.identify.record import IdentifyError, Record, UntoldError
from seod.identify.relay_rows import relay_rows
from seod.identify.show import as_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from seod.config.model import AxisConfig, RigConfig
    from seod.data import Recording
    from seod.identify.drive import Hold
    from seod.identify.record import Output


Method = Literal["output_error", "wave", "exact", "peaks"]


class Options(NamedTuple):
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


def run(paths: Sequence[Path], config: RigConfig | None, options: Options) -> str:
    """The answer as it is printed.

    Raises:
        ReadError: A file cannot be read.
        IdentifyError: A recording cannot be used.
    """
    section = None if config is None else config.axes[options.axis or next(iter(config.axes))]
    files, told = _files(paths, options, section)
    result = _result(files, told, options, section)
    if options.plot is not None:
        units = [file.data.units["y"] for file in files]
        plot([file.record for file in files], units, result, options.plot)
    truth = {} if section is None else _configured(section)
    if options.as_json:
        answer: dict[str, Any] = result.as_json()
        return json.dumps(answer | {"configured": truth} if truth else answer, allow_nan=False)
    return as_text(result, [str(path) for path in paths], truth, _gain_unit(files, section))


def _gain_unit(files: Sequence[_File], section: AxisConfig | None) -> str:
    """Unit of K_L: the rig file's, or of the first recording's columns."""
    if section is not None:
        return section.gain_unit
    units = files[0].data.units if files else {}
    y = units.get("y") or "unit"
    return f"{y if y.endswith('/s') else f'{y}/s'}/{units.get('u') or 'V'}"


class _File(NamedTuple):
    path: Path
    data: Recording
    record: Record


def _files(
    paths: Sequence[Path], options: Options, section: AxisConfig | None
) -> tuple[list[_File], list[UntoldError]]:
    """Recordings that tell something, and why others do not."""
    output = options.output or ("position" if section is None else section.mode)
    files, told = [], []
    for path in paths:
        data = read(
            path, columns=options.columns, units=options.units, axis=options.axis, of_rig=section is not None
        )
        tell(data.problems)
        try:
            record = Record(path, data.t, data.u, data.y, data.t_u, output, options.offset, options.hold)
        except UntoldError as error:
            told.append(error)
        else:
            files.append(_File(path, data, record))
    return files, told


def _result(
    files: Sequence[_File], told: Sequence[UntoldError], options: Options, section: AxisConfig | None
) -> Result:
    """Of the recordings that tell something; those left out are named."""
    left_out = tuple(str(error) for error in told)
    if not files:
        return Result(None, told[0].quality, "; ".join(left_out), method=options.method)
    records = [file.record for file in files]
    if options.method == "output_error":
        result = identify(records, options.gain, options.delay)
    else:
        result = _as_live(files, options, section)
    return replace(result, cannot_tell=(*left_out, *result.cannot_tell))


def _as_live(files: Sequence[_File], options: Options, section: AxisConfig | None) -> Result:
    """By the daemon's estimators, one after the other."""
    records, method = [file.record for file in files], options.method
    gain = _gain(files, options, section)
    known = _beforehand(records, options, section, gain is not None)
    told = []
    for file in files:
        rows = relay_rows(file.path, file.data, options.axis, file.record.output, gain or _unknown)
        told += answers(rows, file.record, method, known)
    return summary(records, told, method, known)


def _unknown(_ps: float) -> float:
    return math.nan


def _gain(
    files: Sequence[_File], options: Options, section: AxisConfig | None
) -> Callable[[float], float] | None:
    """K_L by the supply pressure, of the options, else of the rig file; None where neither tells it."""
    if (given := options.gain) is not None:
        return lambda _ps: given
    if section is None or is_identified(section.K_L):
        return None
    if needs_pressure(section.K_L) and any(file.data.ps is None for file in files):
        return None
    return gain_of(section.K_L)


def _beforehand(
    records: Sequence[Record], options: Options, section: AxisConfig | None, has_gain: bool
) -> Beforehand:
    """What the options say, else the rig file; where neither, `wave` begins with a fit of the whole."""
    known = (
        Beforehand(1.0, math.inf, 0.0, math.inf)
        if section is None
        else _of_rig_file(section, records[0].tick)
    )
    if options.delay is not None:
        known = known._replace(delay=options.delay, delay_sd=0.0)
    if has_gain:
        return known if options.gain is None else known._replace(K_L=options.gain, K_L_sd=0.0)
    if options.method != "wave":
        raise IdentifyError(
            f"{options.method} needs K_L: give it by --gain or by a rig file (--config), where it follows "
            f"the supply pressure with recordings that have `ps`"
        )
    first = identify(records, None, options.delay).fit
    if first is None:
        return known
    guess = known._replace(K_L=abs(first.value["K_L"]), K_L_sd=math.inf)
    is_told = section is not None or options.delay is not None
    return guess if is_told else guess._replace(delay=max(first.value["delay"], 0.0))


def _of_rig_file(section: AxisConfig, tick: float) -> Beforehand:
    """`tick` is the recording's [s]: a delay of which the rig file says nothing is open by its multiple."""
    estimator, delay_sd = section.estimator, known_to(section, "delay")
    return Beforehand(
        K_L=sum(gain_range(section.K_L)) / 2.0,
        K_L_sd=known_to(section, "K_L") or 0.0,
        delay=estimator.delay,
        delay_sd=UNTOLD_PERIODS * tick if delay_sd is None else delay_sd,
        hysteresis=section.relay.hysteresis,
        cycles=estimator.cycles,
    )


def _configured(section: AxisConfig) -> dict[str, float]:
    """What the rig file has for the same values, to compare."""
    delay = {"delay": section.estimator.delay}
    return delay | ({"K_L": section.K_L} if isinstance(section.K_L, float | int) else {})
