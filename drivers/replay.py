"""Driver of a recorded run: what the rig said then, it says again; what it is told now, nobody hears.

Channels are those of the rig file that the recording holds. The numbers of an axis' sensor, of its supply
pressure and of its temperature are those of the recording, in SI: its sensor's scale is in them already.
Times are those of the recording, moved so that its first tick is at `start`.

The daemon does not tick on this driver: it plays `items`, the recorded rows and events themselves.
"""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

from drivers.base import NO_SAMPLE, Channel, Driver, DriverError, DriverStateError, Sample

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from seod.record.read import Beginning, Item


class ReplayOptions(BaseModel):
    """The rig file's `driver:` section for kind `replay`."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    kind: Literal["replay"]
    file: str
    """An MCAP recording, relative to the rig file; its further parts (`NAME.0002.mcap` ...) follow."""
    realtime: bool = True
    """False: as fast as the estimates can be made."""

    @field_validator("file", mode="after")
    @classmethod
    def _find(cls, value: str, info: ValidationInfo) -> str:
        path = (Path((info.context or {}).get("directory", ".")) / value).resolve()
        if not path.is_file():
            raise ValueError(f"no such file: {path}")
        return str(path)


def _begin(options: ReplayOptions) -> Beginning:
    from seod.record.read import RecordingError, beginning  # noqa: PLC0415 - only this driver needs it

    try:
        return beginning(Path(options.file))
    except (RecordingError, OSError) as error:
        raise DriverError(f"driver.file: {error}") from error


@contextmanager
def _rig_of(options: ReplayOptions) -> Iterator[None]:
    """Around what looks into the rig file of the recording, which may be damaged."""
    try:
        yield
    except (KeyError, TypeError, AttributeError) as error:
        raise DriverError(f"driver.file: {options.file}: the rig file in it is damaged: {error!r}") from error


def _fields(rig: dict[str, Any], axes: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Input channel -> number of the axis and field of its rows that hold it."""
    found: dict[str, tuple[int, str]] = {}
    for number, axis in enumerate(axes):
        config = rig["axes"][axis]
        for key, name in (("sensor", "y"), ("supply_pressure", "ps"), ("temperature", "temperature")):
            if config.get(key) is not None:
                found.setdefault(rig["sensors"][config[key]]["channel"], (number, name))
    return found


class ReplayDriver(Driver):
    """Reads the recording at the clock's pace."""

    Options = ReplayOptions
    push = True
    acts_on = "recording"
    counter_names: ClassVar[tuple[str, ...]] = ("rows", "commands_unheard")

    def __init__(self, options: ReplayOptions, clock: Callable[[], float]) -> None:
        super().__init__(options, clock)
        self.axes: tuple[str, ...] = ()
        self._fields: list[tuple[int, str]] | None = None
        self._rows: Iterator[tuple[float, Any]] = iter(())
        self._next: tuple[float, Any] | None = None
        self._shift = math.nan
        self._samples: list[Sample] = []
        self._neutral: list[float] = []

    @classmethod
    def channels(cls, options: ReplayOptions) -> tuple[Channel, ...]:
        """Channels of the recorded rig file; an e-stop line and marks of an encoder were not recorded."""
        begun = _begin(options)
        with _rig_of(options):
            outputs = {begun.rig["outputs"][axis["output"]]["channel"] for axis in begun.rig["axes"].values()}
            sensors = {sensor["channel"] for sensor in begun.rig["sensors"].values()}
        return (
            *(Channel(name, "input") for name in sorted(sensors)),
            *(Channel(name, "output", "V") for name in sorted(outputs)),
        )

    def open(
        self,
        inputs: Sequence[str],
        outputs: Sequence[str],
        neutral: Sequence[float] | None = None,
    ) -> None:
        """Open the recording."""
        if self._fields is not None:
            raise DriverStateError("the recording is open already: close it first")
        begun = _begin(self.options)
        known = {(channel.name, channel.direction) for channel in self.channels(self.options)}
        for name, direction in [*((n, "input") for n in inputs), *((n, "output") for n in outputs)]:
            if (name, direction) not in known:
                there = ", ".join(sorted(n for n, d in known if d == direction))
                raise DriverError(
                    f"no {direction} channel {name!r} in {self.options.file}; there are {there}"
                )
        with _rig_of(self.options):
            held = _fields(begun.rig, begun.axes)
        self.axes = begun.axes
        self._fields = [held.get(name, (0, "")) for name in inputs]
        self._samples = [NO_SAMPLE] * len(inputs)
        self._neutral = [0.0] * len(outputs) if neutral is None else list(neutral)

    def items(self) -> Iterator[Item]:
        """Recorded rows (dtype `seod.record.layout.row_dtype`) and events, in their order."""
        from seod.record.read import items  # noqa: PLC0415 - as above

        return items(Path(self.options.file), self.axes)

    def start(self) -> None:
        """Begin with the first row, now."""
        self._opened("start")
        self._rows = self._single_rows()
        self._next = next(self._rows, None)
        self._shift = self.clock() - (self._next[0] if self._next else 0.0)

    def _single_rows(self) -> Iterator[tuple[float, Any]]:
        for item in self.items():
            if not isinstance(item, dict):
                yield from zip(item["tick_t"].tolist(), item["axes"], strict=True)

    def wait(self, deadline: float) -> bool:
        """Sleep to the next row or to `deadline` [s]."""
        self._running("wait")
        due = math.inf if self._next is None else self._next[0] + self._shift
        left = min(due, deadline) - self.clock()
        if left > 0.0:
            time.sleep(left)
        return due <= deadline

    def read(self, t: float) -> list[Sample]:
        """What each sensor said by `t` [s]; the last of it once the recording has ended."""
        fields = self._running("read")
        newest = None
        while self._next is not None and self._next[0] + self._shift <= t:
            newest = self._next[1]
            self._next = next(self._rows, None)
            self.counters[0] += 1
        if newest is not None:
            self._samples = [
                Sample(float(newest[name][axis]), float(newest["t"][axis]) + self._shift)
                if name
                else NO_SAMPLE
                for axis, name in fields
            ]
        return self._samples

    def write(self, t: float, values: Sequence[float]) -> float:  # noqa: ARG002 - nobody hears it
        """Nothing but count; the clock's time is returned [s]."""
        self._running("write")
        self.counters[1] += 1
        return self.clock()

    def neutral(self, t: float) -> float:
        """As `write`."""
        return self.write(t, self._neutral)

    def close(self) -> None:
        """Let go of the recording."""
        self._fields = None
        self._rows = iter(())
        self._shift = math.nan

    def _opened(self, call: str) -> list[tuple[int, str]]:
        if self._fields is None:
            raise DriverStateError(f"{call}: call open first")
        return self._fields

    def _running(self, call: str) -> list[tuple[int, str]]:
        fields = self._opened(call)
        if math.isnan(self._shift):
            raise DriverStateError(f"{call}: call start first")
        return fields
