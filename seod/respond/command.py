"""`seod response`: on the rig of a rig file, or from recordings; a table, JSON or a plot out."""

from __future__ import annotations

import json
import signal
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import Progress

from seod.calibrate.command import daemon
from seod.calibrate.procedure import CalibrationError
from seod.client import RequestError
from seod.data import read
from seod.respond import live
from seod.respond.record import RespondError, Stretch
from seod.respond.relay import recorded
from seod.respond.response import respond
from seod.respond.show import as_json, as_text, plot

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.respond.design import Excitation
    from seod.respond.predict import Prediction
    from seod.respond.record import Output
    from seod.respond.relay import LimitCycle
    from seod.respond.response import Response


@dataclass(frozen=True)
class Wishes:
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


def from_recordings(paths: Sequence[Path], config: RigConfig | None, wishes: Wishes) -> str:
    """The answer as it is printed.

    Args:
        paths: Recordings; each is a stretch of its own.
        config: Rig file, whose sensor's lag and delay are known then.
        wishes: Options.

    Raises:
        ReadError: A file cannot be read.
        RespondError: The recordings tell no response.
    """
    stretches = []
    for path in paths:
        data = read(path, wishes.columns, wishes.units, wishes.axis, between=wishes.between)
        more = {"output": wishes.output, "period": wishes.period}
        stretches.append(Stretch.of(str(path), data.t, data.u, data.y, data.t_u, **more))
    delay, lag = wishes.delay, 0.0
    if config is not None:
        section = config.axes[_axis(config, wishes.axis)]
        lag = config.sensors[section.sensor].lag
        delay = section.estimator.delay if delay is None and section.estimator.delay > 0.0 else delay
    found = respond(stretches, wishes.gain, delay, lag)
    cycle = None if wishes.relay is None else _recorded_cycle(wishes.relay, wishes)
    return _told(found, ", ".join(map(str, paths)), wishes.output, wishes, cycle, None)


def _recorded_cycle(path: Path, wishes: Wishes) -> LimitCycle:
    """What the recording of a relay says.

    Raises:
        RespondError: K_L is not known, without which it says little, or it says nothing.
    """
    if wishes.gain is None:
        raise RespondError("--relay needs K_L, --gain K: one limit cycle does not tell it")
    data = read(path, wishes.columns, wishes.units, wishes.axis)
    return recorded(str(path), data.t, data.u, data.y, data.t_u, wishes.output, wishes.gain, wishes.delay)


def on_rig(config: RigConfig, path: Path, excitation: live.Wishes, wishes: Wishes) -> str:
    """Excite the rig of a rig file, by its running daemon or one that is started for it.

    Raises:
        CalibrationError: The rig refuses, or the guard stopped it.
        RespondError: The wishes do not fit the rig, or nothing came of it.
    """
    name = _axis(config, wishes.axis)
    axis = config.axes[name]
    if wishes.predict and config.simulation is None:
        raise RespondError("--predict needs a plant: `simulation:` in the rig file")
    console = Console(stderr=True)
    signal.signal(signal.SIGTERM, _interrupt)  # ends as ctrl-C does: the axis stopped and back in place
    try:
        with daemon(config, path) as client, Progress(console=console, transient=True) as progress:
            task = progress.add_task(name, total=1.0)
            stretches, cycle, drives = live.measure(
                client,
                name,
                axis,
                excitation,
                lambda what, done: progress.update(task, description=f"{name}: {what}", completed=done),
            )
            K_L = client.get(name)["settings"]["K_L"] or (cycle and cycle.plant.K_L)
    except RequestError as error:
        raise CalibrationError(str(error)) from error
    lag = config.sensors[axis.sensor].lag
    found = respond(stretches, wishes.gain, wishes.delay, lag)
    e_a = axis.relay.e_a if cycle is None else cycle.e_a
    predicted = _predicted(config, name, drives, e_a, K_L or found.fit.plant.K_L) if wishes.predict else None
    return _told(found, name, stretches[0].output, wishes, cycle, predicted)


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
    wishes: Wishes,
    cycle: LimitCycle | None,
    predicted: Prediction | None,
) -> str:
    if wishes.plot is not None:
        plot(found, output, cycle, name, wishes.plot)
    if wishes.as_json:
        answer: dict[str, Any] = as_json(found, output, cycle, predicted)
        return json.dumps(answer, allow_nan=False)
    return as_text(found, name, cycle, predicted)
