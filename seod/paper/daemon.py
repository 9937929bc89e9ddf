"""The daemon's loop on a simulated rig and simulated time, and an estimator beside it for each method."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from drivers.virtual import VirtualDriver, VirtualOptions
from seod.config.channels import input_channels, neutral_values, output_channels
from seod.config.resolution import resolution_of
from seod.estimate import make_estimator
from seod.loop.pacer import SimulatedPacer
from seod.loop.tick import Loop
from seod.observe.estimation import Axis
from seod.observe.timing import Timing
from seod.observe.two_phase import TwoPhase
from seod.processes.ring import AxisState, Column, Shared, Word

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.estimate.base import Estimate
    from sim.config import SimulationConfig

    Array = NDArray[np.float64]

RING: Final = 1 << 12
"""Rows that the ring holds."""
BLOCK_S: Final = 0.01
"""Rows are taken, and courses followed, this often."""
PATIENCE_S: Final = 20.0
"""In which the loop must have excited the axis."""
BEGINS: Final = 1000.0
"""Simulated time at start [s]: the same numbers in each run."""


class PaperError(Exception):
    """The rig did not do what the figure needs; says what."""


@dataclass
class Told:
    """What came out of one run.

    Attributes:
        estimates: By method.
        rows: Values of each tick of the axis, by `Column`.
    """

    estimates: dict[str, list[Estimate]] = field(default_factory=dict)
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def column(self, which: int) -> Array:
        """One value of all rows, shape (n,)."""
        return np.array([row[which] for row in self.rows])


def _simulation(config: RigConfig, seed: int, constants: dict[str, float]) -> SimulationConfig:
    """What the rig file simulates, with another seed and other numbers of some constant channels."""
    if config.simulation is None:
        raise PaperError(f"rig {config.rig} has no `simulation:` section")
    changed = {"seed": seed, "constants": {**config.simulation.constants, **constants}}
    return config.simulation.model_copy(update=changed)


class Daemon:
    """One axis of a rig file under the daemon's own loop.

    Args:
        config: The rig file; its simulation is run.
        axis: Which axis is excited; the others hold.
        methods: Estimators that listen.
        seed: Of the sensors' noise.
        constants: Other numbers of constant channels, such as the supply pressure.
        settings: Set before it starts, such as `e_a` and `reference`.
    """

    def __init__(
        self,
        config: RigConfig,
        axis: str,
        methods: tuple[str, ...],
        seed: int = 1,
        constants: dict[str, float] | None = None,
        settings: dict[str, Any] | None = None,
    ) -> None:
        self.config, self.name, self.index = config, axis, list(config.axes).index(axis)
        self._shared = Shared(len(config.axes), RING)
        self._pacer = SimulatedPacer(1.0 / config.loop.rate_hz, self._shared)
        self._pacer.start = BEGINS
        options = VirtualOptions(
            kind="virtual", realtime=False, simulation=_simulation(config, seed, constants or {})
        )
        self.driver = VirtualDriver(options, self._pacer.now)
        self.driver.open(input_channels(config), output_channels(config), neutral_values(config))
        self.driver.start()
        self._loop = Loop(config, self.driver, self._shared, self._pacer, 1, self._fenced)
        sensor = config.sensors[config.axes[axis].sensor]
        period, timing = self._pacer.period, Timing.of(self._pacer.period)
        self._axes = {
            method: Axis(
                axis,
                _by(config, axis, method),
                period,
                make_estimator,
                sensor.lag,
                resolution_of(sensor),
                timing,
            )
            for method in methods
        }
        self._second: TwoPhase | None = None
        if "two-phase" in self._axes:
            self._second = TwoPhase(self._axes["two-phase"], self._post, lambda _code, _why: None)
        self._ids = 0
        self._asked: set[int] = set()
        self.told = Told({method: [] for method in methods})
        if settings:
            self.set(**settings)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.close()
        self._shared.close()

    @staticmethod
    def _fenced() -> None:
        raise PaperError("the loop was fenced")

    def set(self, **values: Any) -> None:
        """Change settings of the axis, as `seod set` does."""
        self._command("set", values)

    def constant(self, channel: str, value: float) -> None:
        """Have a constant channel of the rig at a number."""
        if self.driver.rig is not None:
            self.driver.rig.set_constant(self._pacer.now(), channel, value)

    def start(self) -> None:
        """Excite the axis, and wait until its relay is on.

        Raises:
            PaperError: It is not, or a fault came.
        """
        self._command("start", {})
        for _ in range(round(PATIENCE_S / BLOCK_S)):
            self.run(BLOCK_S)
            if self._loop.axes[self.index].course.state is AxisState.EXCITING:
                return
        raise PaperError(f"rig {self.config.rig}: axis {self.name} was not excited within {PATIENCE_S:g} s")

    def run(self, seconds: float, course: Callable[[float], None] | None = None) -> None:
        """Let time pass; `course` is called with the seconds passed, `BLOCK_S` apart."""
        ticks, block = round(seconds / self._pacer.period), round(BLOCK_S / self._pacer.period)
        for begin in range(0, ticks, block):
            if course is not None:
                course(begin * self._pacer.period)
            for _ in range(min(block, ticks - begin)):
                self._loop.tick(self._pacer.next())
            self._take()

    def forget(self) -> None:
        """Leave out what was told until now."""
        self.told = Told({method: [] for method in self._axes})

    def _command(self, op: str, values: dict[str, Any]) -> None:
        self._asked.add(self._ids + 1)
        self._post(op, values)
        self.run(self._pacer.period)

    def _post(self, op: str, values: dict[str, Any]) -> None:
        self._ids += 1
        self._shared.commands.put({"id": self._ids, "op": op, "axis": self.index, "values": values})

    def _take(self) -> None:
        for event in self._shared.events.take():
            self._hear(event)
        ring = self._shared.row_ring
        tail, head = ring.pending()
        ring.tail = head
        self._shared.words[Word.CONSUMED] = head
        width = Column.COUNT
        first = 2 + self.index * width
        at = [(entry % ring.slots) * ring.slot_bytes for entry in range(tail, head)]
        block = [self._shared.row_struct.unpack_from(ring.data, each)[first : first + width] for each in at]
        self.told.rows += block
        for method, axis in self._axes.items():
            answers = axis.feed(block)
            self.told.estimates[method] += answers
            if method == "two-phase" and self._second is not None:
                for each in answers:
                    self._second.consider(each, block[-1][Column.REFERENCE])

    def _hear(self, event: dict[str, Any]) -> None:
        kind = event["event"]
        if self._second is not None and event.get("axis") in {self.name, None}:
            self._second.heard(event)
        if kind == "fault":
            raise PaperError(f"rig {self.config.rig}: {event['code']}: {event['why']}")
        if kind == "reply" and event["error"] and event["id"] in self._asked:
            raise PaperError(f"rig {self.config.rig}: {event['error']}")
        if kind == "state" and event["axis"] == self.name:
            for axis in self._axes.values():
                axis.enter(event["t"], event["state"])
        if kind == "changed" and event["axis"] == self.name:
            for axis in self._axes.values():
                axis.change(event["values"])


def _by(config: RigConfig, axis: str, method: str) -> Any:
    """The axis' section with another estimator."""
    section = config.axes[axis]
    wanted = "wave" if method == "two-phase" else method
    return section.model_copy(update={"estimator": section.estimator.model_copy(update={"method": wanted})})


def middle(told: list[Estimate], name: str) -> float:
    """Median of what was told; nan where nothing was."""
    values = [getattr(each, name) for each in told if getattr(each, name) is not None]
    return float(np.median(values)) if values else math.nan
