"""The rig's model beside one axis: rows in, errors out, the work in a thread of its own."""

from __future__ import annotations

import queue
import threading
from typing import TYPE_CHECKING, Any, Final

from seod.config.resolution import resolution_of
from seod.model_monitor.judge import ModelError, Verdict, judge
from seod.model_monitor.models import model_of, nominal_pressure, plant_of
from seod.observe.segments import Segments
from seod.terminal.text import number

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from seod.config.model import RigConfig
    from seod.model_monitor.window import Model, Segment
    from seod.observe.messages import RowTuple

CLOSE_S: Final = 1.0
"""Longest wait for a segment that is under way; compiling takes longer, and is cut off."""


class ModelMonitor:
    """One axis. Nothing here waits; while a segment is computed the next ones are left out.

    Args:
        config: The rig file; its `simulation:` section is the model.
        axis: Name of the axis.
    """

    def __init__(self, config: RigConfig, axis: str) -> None:
        self.axis, self._config = axis, config
        self.left = False
        plant = plant_of(config, axis)
        self._segments = Segments(plant.omega_n, nominal_pressure(config, axis)) if plant else None
        self._resolution = 0.0 if config.axes[axis].mode == "velocity" else _resolution(config, axis)
        self._verdict = Verdict()
        self._newest: dict[str, Any] | None = None
        self._work: queue.Queue[Segment | None] = queue.Queue(1)
        self._done: queue.Queue[ModelError | Exception] = queue.Queue()
        self._trouble, self._told = "", False
        self._thread: threading.Thread | None = None
        self._model: Model | None = None

    def feed(self, rows: Sequence[RowTuple]) -> None:
        """Take the newest rows; those of an axis that is excited make segments."""
        if self._segments is None or self._trouble:
            return
        for segment in self._segments.add(rows):
            self._offer(segment)

    def _offer(self, segment: Segment) -> None:
        """Hand a segment to the thread if that is free."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"model of {self.axis}", daemon=True)
            self._thread.start()
        if self._work.empty():
            self._work.put(segment)

    def answers(self) -> Iterator[tuple[ModelError, str]]:
        """Errors since the last call, each with what is new about the verdict, in a sentence."""
        while not self._done.empty():
            answer = self._done.get()
            if isinstance(answer, Exception):
                self._trouble = f"{type(answer).__name__}: {answer}"
                return
            changed = self._verdict.add(answer)
            self.left = self._verdict.left
            self._newest = answer.as_message(self.axis, self.left)
            yield answer, _sentence(answer, self.left) if changed else ""

    def trouble(self) -> str:
        """Why there is no model, once."""
        told, self._told = self._told, bool(self._trouble)
        return "" if told else self._trouble

    def newest(self) -> dict[str, Any] | None:
        """The last message, or None."""
        return self._newest

    def interrupted(self) -> None:
        """Rows are missing."""
        if self._segments is not None:
            self._segments.clear()

    def close(self) -> None:
        """End the thread, and the model with it; a model that starts just now is not waited for."""
        if self._thread is None:
            return
        while not self._work.empty():
            self._work.get()
        self._work.put(None)
        if self._model is not None:
            self._thread.join(CLOSE_S)
            self._model.close()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        try:
            self._model = model_of(self._config, self.axis)
            while self._model is not None and (segment := self._work.get()) is not None:
                left = self._model.residual(segment)
                error = judge(segment, left, self._resolution, self._model.name)
                if error is not None:
                    self._done.put(error)
                self._work.task_done()
        except (OSError, ValueError, ArithmeticError) as failure:
            self._done.put(failure)


def _resolution(config: RigConfig, axis: str) -> float:
    return resolution_of(config.sensors[config.axes[axis].sensor])


def _sentence(error: ModelError, left: bool) -> str:
    numbers = f"error {number(100.0 * error.nrmse, 3)} % of the movement, statistic {error.statistic:.3g}"
    if left:
        return f"the rig has left its model ({numbers}); `seod diagnose` on a recording says why"
    return f"the model holds again ({numbers})"
