"""`seod response`: on the rig of a rig file, or from recordings; a table, JSON or a plot out."""

from __future__ import annotations

import json
import signal
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seod.calibrate.command import daemon
from seod.calibrate.procedure import CalibrationError
from seod.client import RequestError
from seod.data import read
from seod.data.problems import tell
from seod.respond import live
from seod.respond.record import RespondError, Segment
from seod.respond.relay import recorded
from seod.respond.response import respond
from seod.respond.show import as_json, as_text, plot
from seod.terminal.progress import bar

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.respond.design import Excitation
    from seod.respond.predict import Prediction
    from seod.respond.record import Output
    from seod.respond.relay import LimitCycle
    from seod.respond.response import Response


@dataclass(frozen=True)
class Options:
    """Options of the command, those of the excitation apart.

    Attributes:
        axis: Of rig files and recordings with several; None: the only one.
        gain: K_L, if it is known [unit/s/V].
        delay: Beyond the recordings' own times, if it is known [s].
        output: Of recordings: what y is.
        columns: Names of their columns, `t=time,u=cmd`.
        units: Their units.
        between: Only rows with times from here to there [s].
        period: Of their excitation, if it is known [s].
        relay: A recording of the relay's limit cycle, to compare with.
        predict: Simulate what the rig file's plant would show.
        as_json: JSON instead of a table.
        plot: PNG file.
    """

    axis: str | None = None
    gain: float | None = None
    delay: float | None = None
    output: Output = "position"
    columns: str = ""
    units: str = ""
    between: tuple[float, float] | None = None
    period: float | None = None
    relay: Path | None = None
    predict: bool = False
    as_json: bool = False
    plot: Path | None = None


def from_recordings(paths: Sequence[Path], config: RigConfig | None, options: Options) -> str:
    """The answer as it is printed.

    Args:
        paths: Recordings; each is a segment of its own.
        config: Rig file, whose sensor's lag and delay are known then.
        options: Options.

    Raises:
        ReadError: A file cannot be read.
        RespondError: The recordings tell no response.
    """
    segments = []
    for path in paths:
        data = _read(path, options, config, options.between)
        more = {"output": options.output, "period": options.period}
        segments.append(Segment.of(str(path), data.t, data.u, data.y, data.t_u, **more))
    delay, lag = options.delay, 0.0
    if config is not None:
        section = config.axes[_axis(config, options.axis)]
        lag = config.sensors[section.sensor].lag
        delay = section.estimator.delay if delay is None and section.estimator.delay > 0.0 else delay
    found = respond(segments, options.gain, delay, lag)
    cycle = None if options.relay is None else _recorded_cycle(options.relay, options, config)
    return _told(found, ", ".join(map(str, paths)), options.output, options, cycle, None)


def _read(
    path: Path, options: Options, config: RigConfig | None, between: tuple[float, float] | None = None
) -> Recording:
    of_rig = config is not None
    data = read(path, options.columns, options.units, options.axis, between=between, of_rig=of_rig)
    tell(data.problems)
    return data


def _recorded_cycle(path: Path, options: Options, config: RigConfig | None) -> LimitCycle:
    """What the recording of a relay says.

    Raises:
        RespondError: K_L is not known, without which it says little, or it says nothing.
    """
    if options.gain is None:
        raise RespondError("--relay needs K_L, --gain K: one limit cycle does not tell it")
    data = _read(path, options, config)
    return recorded(str(path), data.t, data.u, data.y, data.t_u, options.output, options.gain, options.delay)


def on_rig(config: RigConfig, path: Path, excitation: live.Options, options: Options) -> str:
    """Excite the rig of a rig file, by its running daemon or one that is started for it.

    Raises:
        CalibrationError: The rig refuses, or the guard stopped it.
        RespondError: The options do not fit the rig, or nothing came of it.
    """
    name = _axis(config, options.axis)
    axis = config.axes[name]
    if options.predict and config.simulation is None:
        raise RespondError("--predict needs a plant: `simulation:` in the rig file")
    signal.signal(signal.SIGTERM, _interrupt)  # ends as ctrl-C does: the axis stopped and back in place
    try:
        with daemon(config, path) as client, bar() as show:
            segments, cycle, drives = live.measure(
                client,
                name,
                axis,
                excitation,
                lambda what, done: show(f"{name}: {what}", done),
            )
            K_L = client.get(name)["settings"]["K_L"] or (cycle and cycle.plant.K_L)
    except RequestError as error:
        raise CalibrationError(str(error)) from error
    lag = config.sensors[axis.sensor].lag
    found = respond(segments, options.gain, options.delay, lag)
    e_a = axis.relay.e_a if cycle is None else cycle.e_a
    predicted = _predicted(config, name, drives, e_a, K_L or found.fit.plant.K_L) if options.predict else None
    return _told(found, name, segments[0].output, options, cycle, predicted, axis.gain_unit)


def _predicted(
    config: RigConfig, name: str, drives: Sequence[Excitation], e_a: float, K_L: float
) -> Prediction:
    from seod.respond.predict import predict  # noqa: PLC0415 - the compiled plant

    return predict(config, name, drives, e_a, K_L)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _axis(config: RigConfig, name: str | None) -> str:
    """The axis meant.

    Raises:
        RespondError: There are several, or none of that name.
    """
    if name is None and len(config.axes) == 1:
        return next(iter(config.axes))
    if name not in config.axes:
        what = "which axis?" if name is None else f"no axis {name!r}:"
        raise RespondError(f"{what} --axis takes one of {', '.join(config.axes)}")
    return name


def _told(
    found: Response,
    name: str,
    output: Output,
    options: Options,
    cycle: LimitCycle | None,
    predicted: Prediction | None,
    gain_unit: str = "unit/s/V",
) -> str:
    if options.plot is not None:
        plot(found, output, cycle, name, options.plot)
    if options.as_json:
        answer: dict[str, Any] = as_json(found, output, cycle, predicted)
        return json.dumps(answer, allow_nan=False)
    return as_text(found, name, cycle, predicted, gain_unit)
