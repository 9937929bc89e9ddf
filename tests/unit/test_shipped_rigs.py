"""The rig files in `configs/`: each passes `seod check`, and its estimates tell its plants' true values."""

from __future__ import annotations

import itertools
from statistics import median
from typing import TYPE_CHECKING, Any

import pytest

from drivers.can_config import CanOptions
from drivers.can_load import Bus
from drivers.serial_load import Line
from seod.config.check import check
from seod.config.load import load_rig
from seod.config.truth import truth
from seod.estimate import TABLE
from seod.files.shipped import configs_dir
from seod.loop.pacer import SimulatedPacer
from seod.loop.process import make_driver
from seod.loop.tick import Loop
from seod.observe.estimation import Axis
from seod.processes.ring import Shared, Word
from sim.can_rig import CanRig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from seod.config.model import RigConfig

pytestmark = pytest.mark.slow

RIGS = sorted(configs_dir().glob("*.yaml"))
LINES = {"arduino", "serial"}
"""Their other end is a process of its own that keeps real time: tests/test_serial.py."""
PHYSICAL = {"servo-hydraulic", "seat-hydraulic", "tail-hydraulic"}
"""What their limit cycles tell is not what small movements do: tests/unit/test_paper.py."""
EXCITED_S = 4.0
A_MOMENT_S = 1e-7
"""The rig on the bus lives this much later than the loop, so that rounding never makes it miss a turn."""

_channels = itertools.count()


class Simulation:
    """A loop with its driver on simulated time; on a bus, the simulated rig at the other end as well."""

    def __init__(self, config: RigConfig) -> None:
        self.config = config
        self.shared = Shared(len(config.axes), 1 << 15)
        self.pacer = SimulatedPacer(1.0 / config.loop.rate_hz, self.shared)
        self.pacer.start = 1000.0  # the same numbers in each run
        self.rig = self._rig_on_the_bus()
        self.driver = make_driver(config, self.pacer.now)
        self.loop = Loop(config, self.driver, self.shared, self.pacer, 1)

    def _rig_on_the_bus(self) -> CanRig | None:
        if self.config.driver["kind"] != "can":
            return None
        options = CanOptions.model_validate(self.config.driver)
        assert self.config.simulation is not None
        rig = CanRig(options, self.config.simulation, lambda: self.pacer.now() + A_MOMENT_S)
        rig.open()
        return rig

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.pacer.period)):
            t = self.pacer.next()
            self._step_rig()
            self.loop.tick(t)
            self._step_rig()  # the commands arrive before time goes on
            self.shared.words[Word.CONSUMED] = self.shared.row_ring.head[0]

    def _step_rig(self) -> None:
        if self.rig is None:
            return
        for _ in range(
            len(self.rig.messages) + 1
        ):  # python-can's bus hands back each own frame, and ends there
            self.rig.step(self.pacer.now() + A_MOMENT_S, 0.0)

    def start(self) -> str | None:
        return self.loop.start(self.pacer.now(), self.loop.axes)

    def rows(self, axis: int) -> list[Any]:
        """All rows of an axis, as the gateway takes them."""
        ring = self.shared.row_ring
        assert ring.head[0] <= ring.slots
        width = (len(self.shared.row_struct.unpack_from(ring.data)) - 2) // len(self.config.axes)
        at = 2 + axis * width
        offsets = (entry * ring.slot_bytes for entry in range(ring.head[0]))
        return [self.shared.row_struct.unpack_from(ring.data, o)[at : at + width] for o in offsets]

    def estimates(self, index: int) -> list[Any]:
        """Good answers of an axis."""
        axis = self.loop.axes[index]
        gateway = Axis(axis.name, axis.config, self.pacer.period, lambda s: TABLE[s.method](s))
        return [e for e in gateway.feed(self.rows(index)) if e.quality == "ok"]

    def events(self) -> list[dict[str, Any]]:
        return list(self.shared.events.take())

    def close(self) -> None:
        self.driver.close()
        if self.rig is not None:
            self.rig.close()
        self.shared.close()


@pytest.fixture
def simulate(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Path], Simulation]]:
    for module in ("drivers.can", "sim.can_rig"):  # stamps are of the real clock: time of reading counts
        monkeypatch.setattr(f"{module}.REALTIME_STAMPS", frozenset())
    made: list[Simulation] = []

    def make(path: Path) -> Simulation:
        config = load_rig(path)
        if config.driver["kind"] == "can":  # python-can's bus within this process
            there = {"interface": "virtual", "channel": f"shipped-{next(_channels)}", "echo": False}
            config = config.model_copy(update={"driver": config.driver | there})
        made.append(Simulation(config))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_a_shipped_rig_passes_its_check_without_a_warning(path: Path) -> None:
    config = load_rig(path)
    report = check(config)
    assert (report.refusals, report.warnings) == ((), ())
    assert config.simulation is not None
    connection = None if report.connection is None else type(report.connection.traffic)
    assert connection == (Bus if path.stem.endswith("can") else Line if path.stem in LINES else None)


@pytest.mark.parametrize(
    "path", [p for p in RIGS if p.stem not in LINES | PHYSICAL], ids=lambda path: path.stem
)
def test_a_shipped_rig_gives_its_true_values(path: Path, simulate: Callable[[Path], Simulation]) -> None:
    rig = simulate(path)
    rig.run(0.05)
    assert rig.start() is None
    rig.run(EXCITED_S)
    assert [e["why"] for e in rig.events() if e["event"] in ("fault", "warning")] == []
    true = truth(rig.config)
    for index, axis in enumerate(rig.loop.axes):
        answers = rig.estimates(index)
        assert len(answers) > 20, axis.name
        for name in ("omega_n", "zeta"):
            found = median(getattr(answer, name) for answer in answers)
            assert found == pytest.approx(true[axis.name][name], rel=0.02), (axis.name, name)


@pytest.mark.parametrize("name", ["seat", "tail"])
def test_two_axes_at_2_khz_need_more_than_a_classic_bus(name: str) -> None:
    connection = check(load_rig(configs_dir() / f"{name}-can.yaml")).connection
    assert connection is not None
    bus = connection.traffic
    assert all(frame.fd for frame in bus.frames)
    assert bus.load() < 0.5
    classic = [type(frame)(frame.name, frame.length, frame.rate_hz) for frame in bus.frames]
    assert type(bus)("classic", 1_000_000, None, tuple(classic)).load() > 0.8
