"""Excites a rig to measure its frequency response: by its running daemon, or one that is started for it."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seod.calibrate.command import daemon
from seod.calibrate.procedure import CalibrationError
from seod.client import RequestError
from seod.respond import live
from seod.respond.record import RespondError
from seod.respond.response import respond

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.respond.design import Excitation
    from seod.respond.predict import Prediction
    from seod.respond.record import Segment
    from seod.respond.relay import LimitCycle
    from seod.respond.response import Response


@dataclass(frozen=True)
class Measured:
    """What came of exciting a rig.

    Attributes:
        axis: Its name.
        segments: Of the recording.
        response: What they tell.
        cycle: What the relay's limit cycle says; None where it was not run.
        predicted: What the rig file's plant would show; None where nobody asked.
    """

    axis: str
    segments: Sequence[Segment]
    response: Response
    cycle: LimitCycle | None
    predicted: Prediction | None


def on_rig(
    config: RigConfig,
    path: Path,
    name: str,
    excitation: live.Options,
    known: tuple[float | None, float | None],
    predicts: bool,
    told: Callable[[str, float], None],
) -> Measured:
    """Excite the rig of a rig file, by its running daemon or one that is started for it.

    Args:
        config: The rig file, read.
        path: Where it is.
        name: The axis.
        excitation: How it is excited.
        known: K_L [unit/s/V] and delay [s], if they are known.
        predicts: Simulate what the rig file's plant would show.
        told: Called with what is being done, and the part that is.

    Raises:
        CalibrationError: The rig refuses, or the guard stopped it.
        RespondError: The options do not fit the rig, or nothing came of it.
    """
    axis = config.axes[name]
    if predicts and config.simulation is None:
        raise RespondError("--predict needs a plant: `simulation:` in the rig file")
    try:
        with _interruptible(), daemon(config, path) as client:
            segments, cycle, drives = live.measure(
                client, name, axis, excitation, lambda what, done: told(f"{name}: {what}", done)
            )
            K_L = client.get(name)["settings"]["K_L"] or (cycle and cycle.plant.K_L)
    except RequestError as error:
        raise CalibrationError(str(error)) from error
    found = respond(segments, *known, config.sensors[axis.sensor].lag)
    e_a = axis.relay.e_a if cycle is None else cycle.e_a
    predicted = _predicted(config, name, drives, e_a, K_L or found.fit.plant.K_L) if predicts else None
    return Measured(name, segments, found, cycle, predicted)


def _predicted(
    config: RigConfig, name: str, drives: Sequence[Excitation], e_a: float, K_L: float
) -> Prediction:
    from seod.respond.predict import predict  # noqa: PLC0415 - the compiled plant

    return predict(config, name, drives, e_a, K_L)


@contextmanager
def _interruptible() -> Iterator[None]:
    """SIGTERM ends as ctrl-C does: the axis stopped and back in place. In the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, usual)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
