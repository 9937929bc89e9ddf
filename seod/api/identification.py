"""`seod.identify`: omega_n, zeta, K_L and delay from recordings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from drivers.base import UNTOLD_PERIODS
from seod.answers import Answer
from seod.api.data import How, arrays, several
from seod.api.options import delay_of, gain_of, part_of
from seod.api.progress import teller
from seod.api.rig_file import rig_of
from seod.config.gain_in_force import gain_of as gain_at
from seod.config.gain_in_force import gain_range, is_identified, needs_pressure
from seod.config.known import known_to
from seod.data.pauses import between_pauses
from seod.identify.answer import Result
from seod.identify.answer import identify as fitted
from seod.identify.live import Beforehand, answers, summary
from seod.identify.problem import NAMES, Given
from seod.identify.record import FEWEST, IdentifyError, Record, UntoldError
from seod.identify.relay_rows import relay_rows
from seod.identify.show import as_text
from seod.identify.untold_output import as_speed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from os import PathLike
    from pathlib import Path

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from seod.api.data import Data
    from seod.api.options import Number
    from seod.api.progress import Bar, Told
    from seod.api.rig_file import RigFile
    from seod.config.axis import AxisConfig
    from seod.data import Recording
    from seod.identify.drive import Hold
    from seod.identify.record import Output

Method = Literal["output_error", "wave", "exact", "peaks"]


class Value(NamedTuple):
    """A number with its standard deviation: None where it was given, or nothing tells it.

    `value` is nan where nothing was identified.
    """

    value: float
    sd: float | None
    unit: str

    def __str__(self) -> str:
        from seod.terminal.text import with_sd  # noqa: PLC0415

        return f"{with_sd(self.value, self.sd)} {self.unit}".rstrip()


@dataclass(frozen=True, repr=False)
class Identification(Answer):
    """What recordings tell of the plant of Eq. 1.

    Attributes:
        result: All that was found.
        recordings: What it is of, those that tell nothing left out.
        records: The same as they were fitted.
        names: Of all recordings.
        configured: What the rig file has for the same values.
        gain_unit: Unit of K_L.
    """

    result: Result
    recordings: tuple[Recording, ...]
    records: tuple[Record, ...]
    names: tuple[str, ...]
    configured: Mapping[str, float]
    gain_unit: str

    @property
    def omega_n(self) -> Value:
        """Undamped natural frequency [rad/s]."""
        return self._value("omega_n")

    @property
    def zeta(self) -> Value:
        """Damping ratio."""
        return self._value("zeta")

    @property
    def K_L(self) -> Value:
        """Gain from voltage to speed."""
        return self._value("K_L")

    @property
    def delay(self) -> Value:
        """From command to valve, beyond the recordings' own times [s]."""
        return self._value("delay")

    @property
    def quality(self) -> str:
        """`ok`, or why it is not to be believed."""
        return self.result.quality

    @property
    def nrmse(self) -> float:
        """Error of the simulation over the movement's standard deviation; nan where nothing is identified."""
        return math.nan if self.result.fit is None else self.result.fit.nrmse

    def _value(self, name: str) -> Value:
        told = self.to_dict()[name]
        return Value(math.nan if told["value"] is None else told["value"], told["sd"], told["unit"])

    def summary(self) -> str:
        """Values with 95 % intervals, what the recordings cannot tell, and the controller's gains."""
        return as_text(self.result, self.names, self.configured, self.gain_unit)

    def to_dict(self) -> dict[str, Any]:
        """As `seod identify --json` prints it."""
        answer = self.result.as_json()
        for name, unit in self.units.items():
            answer[name] = {**answer[name], "unit": unit}
        return answer | {"configured": dict(self.configured)} if self.configured else answer

    @property
    def units(self) -> dict[str, str]:
        """Of each value."""
        return {"K_L": self.gain_unit, "omega_n": "rad/s", "zeta": "1", "delay": "s"}

    def to_columns(self) -> dict[str, Any]:
        """A row for each value."""
        every = [self._value(name) for name in NAMES]
        return {
            "name": list(NAMES),
            "value": [each.value for each in every],
            "sd": [math.nan if each.sd is None else each.sd for each in every],
            "unit": [each.unit for each in every],
        }

    @property
    def drawable(self) -> bool:
        """Whether there is a plant to draw."""
        return self.result.fit is not None

    def plot(self) -> Figure:
        """Measurement and simulation, residual, and close views.

        Raises:
            IdentifyError: Nothing was identified.
        """
        from seod.identify.plot import draw  # noqa: PLC0415 - matplotlib

        units = [each.units["y"] for each in self.recordings]
        return draw(self.records, units, self.result, self.gain_unit)


def identify(
    data: Data = None,
    *,
    t: ArrayLike | None = None,
    u: ArrayLike | None = None,
    y: ArrayLike | None = None,
    t_u: ArrayLike | None = None,
    ps: ArrayLike | None = None,
    config: RigFile | str | PathLike[str] | None = None,
    axis: str | None = None,
    method: Method = "output_error",
    gain: Number | None = None,
    delay: Number | None = None,
    output: Output | None = None,
    offset: bool = True,
    hold: Hold = "zero",
    columns: str | Mapping[str, str] = "",
    units: str | Mapping[str, str] = "",
    between: str | tuple[float, float] | None = None,
    progress: Told | Bar | None = None,
) -> Identification:
    """Identify omega_n, zeta, K_L and delay, and say what the recordings cannot tell.

    Args:
        data: A path, a table of pandas or polars, a `Recording`, a `Simulation`, or a list of these, which
            are fitted jointly. Left out: the arrays.
        t: As of `seod.read`.
        u: Likewise.
        y: Likewise.
        t_u: Likewise.
        ps: Likewise.
        config: Rig file, whose values are shown beside.
        axis: Of recordings and rig files with several.
        method: `output_error`: simulated output to the whole; else a live estimator on a relay's recording.
        gain: K_L if it is known, in SI or as `"50 mm/s/V"`; left out: it is estimated.
        delay: Delay if it is known [s], or `"4 ms"`; left out: it is estimated.
        output: What y is; left out: by the rig file, else a position.
        offset: A velocity y may have an offset.
        hold: Whether u holds until the next row (`zero`) or runs straight on to it (`first`).
        columns: As of `seod.read`.
        units: Likewise.
        between: Likewise.
        progress: Called with the step and the part that is done, or a bar such as tqdm's.

    Raises:
        ReadError: Data cannot be read.
        IdentifyError: A recording cannot be used.
        ValueError: An option is wrong.
    """
    rig = rig_of(config)
    name = axis if rig is None else rig.axis(axis)
    section = None if rig is None or name is None else rig.axes[name]
    how = How(columns, units, axis, part_of(between), of_rig=rig is not None)
    options = _Options(method, gain_of(gain), delay_of(delay), output, offset, hold, axis)
    told = teller(progress)
    told("reading", 0.0)
    recordings, paused = between_pauses(several(data, arrays(t=t, u=u, y=y, t_u=t_u, ps=ps), how), FEWEST)
    files, silent = _files(recordings, options, section)
    told("fitting", 0.1)
    result = _result(files, silent, options, section)
    result = replace(result, cannot_tell=(*paused, *result.cannot_tell))
    told("done", 1.0)
    return Identification(
        result=result,
        recordings=tuple(file.data for file in files),
        records=tuple(file.record for file in files),
        names=tuple(dict.fromkeys(str(each.paths[0]) for each in recordings)),
        configured={} if section is None else _configured(section),
        gain_unit=_gain_unit(recordings, files, section),
    )


class _Options(NamedTuple):
    method: Method
    gain: float | None
    delay: float | None
    output: Output | None
    offset: bool
    hold: Hold
    axis: str | None


class _File(NamedTuple):
    path: Path
    data: Recording
    record: Record


def _gain_unit(recordings: Sequence[Recording], files: Sequence[_File], section: AxisConfig | None) -> str:
    """Unit of K_L: the rig file's, or of the first recording's columns."""
    if section is not None:
        return section.gain_unit
    output = files[0].record.output if files else "position"
    return gain_unit(recordings[0], output)


def gain_unit(recording: Recording, output: Output) -> str:
    """Unit of K_L by the recording's columns: `mm/s/V`."""
    y, u = recording.units.get("y", ""), recording.units.get("u") or "V"
    speed = y if y and (output == "velocity" or y.endswith("/s")) else f"{y or 'unit'}/s"
    return f"{speed}/{u}"


def _files(
    recordings: Sequence[Recording], options: _Options, section: AxisConfig | None
) -> tuple[list[_File], list[UntoldError]]:
    """Recordings that tell something, and why others do not."""
    output = options.output or ("position" if section is None else section.mode)
    files, silent = [], []
    for data in recordings:
        path = data.paths[0]
        try:
            record = Record(path, data.t, data.u, data.y, data.t_u, output, options.offset, options.hold)
        except UntoldError as error:
            silent.append(error)
        else:
            files.append(_File(path, data, record))
    return files, silent


def _result(
    files: Sequence[_File], silent: Sequence[UntoldError], options: _Options, section: AxisConfig | None
) -> Result:
    """Of the recordings that tell something; those left out are named."""
    left_out = tuple(str(error) for error in silent)
    if not files:
        return Result(None, silent[0].quality, "; ".join(left_out), method=options.method)
    records = [file.record for file in files]
    if options.method == "output_error":
        result = _told_type(fitted(records, options.gain, options.delay), records, options, section)
    else:
        result = _as_live(files, options, section)
    return replace(result, cannot_tell=(*left_out, *result.cannot_tell))


def _told_type(
    result: Result, records: Sequence[Record], options: _Options, section: AxisConfig | None
) -> Result:
    """With a sentence where nobody says what y is, and it is clearly nearer to a speed."""
    if options.output is not None or section is not None or result.fit is None or result.quality == "ok":
        return result
    said = as_speed(records, Given(options.gain, options.delay), result.fit)
    return result if said is None else replace(result, cannot_tell=(said, *result.cannot_tell))


def _as_live(files: Sequence[_File], options: _Options, section: AxisConfig | None) -> Result:
    """By the daemon's estimators, one after the other."""
    records, method = [file.record for file in files], options.method
    gain = _gain(files, options, section)
    known = _beforehand(records, options, section, gain is not None)
    found = []
    for file in files:
        rows = relay_rows(file.path, file.data, options.axis, file.record.output, gain or _unknown)
        found += answers(rows, file.record, method, known)
    return summary(records, found, method, known)


def _unknown(_ps: float) -> float:
    return math.nan


def _gain(
    files: Sequence[_File], options: _Options, section: AxisConfig | None
) -> Callable[[float], float] | None:
    """K_L by the supply pressure, of the options, else of the rig file; None where neither tells it."""
    if (given := options.gain) is not None:
        return lambda _ps: given
    if section is None or is_identified(section.K_L):
        return None
    if needs_pressure(section.K_L) and any(file.data.ps is None for file in files):
        return None
    return gain_at(section.K_L)


def _beforehand(
    records: Sequence[Record], options: _Options, section: AxisConfig | None, has_gain: bool
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
    first = fitted(records, None, options.delay).fit
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
