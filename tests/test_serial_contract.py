"""The driver contract on a line whose other end is another process: `seod rig`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
import yaml

from drivers import driver_class
from drivers.serial_counters import COMMANDS
from seod.files.shipped import configs_dir
from tests.peers import Program, Rpc, until
from tests.unit.test_driver_contract import *  # noqa: F403 - the same tests, on other benches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from drivers.base import Driver
    from drivers.serial_config import SerialOptions
    from tests.unit.test_driver_contract import Bench

pytestmark = pytest.mark.processes


class RigProcess:
    """`seod rig` speaking serial, with its control port."""

    def __init__(self, folder: Path) -> None:
        self.port = folder / "board"
        section = yaml.safe_load((configs_dir() / "serial.yaml").read_text())
        self.section = {**section["driver"], "port": str(self.port)}
        path = folder / "rig.yaml"
        path.write_text(yaml.safe_dump({**section, "driver": self.section}))
        self.program = Program(folder / "rig.log", "rig", path, "--control-port", "0")
        self.rpc = Rpc(self.program.ready()["control_port"])

    def history(self) -> list[float]:
        """All commands so far [V]."""
        return [volts for _, volts in self.rpc.call("history", plant="motor")]

    def taken(self) -> int:
        """Commands so far."""
        taken: int = self.rpc.call("state")["counts"]["commands"]
        return taken

    def unplug(self) -> None:
        self.rpc.call("unplug", seconds=0.2)

    def plug_in(self) -> None:
        until("the port", self.port.exists)

    def close(self) -> None:
        self.rpc.close()
        self.program.stop()


class ProcessBench:
    """The `serial` driver and a board that samples by itself all the time."""

    inputs = ("angle", "run_enable")
    outputs = ("valve",)
    simulated = False
    silent = False

    def __init__(self, peer: RigProcess, clock: Callable[[], float]) -> None:
        self.peer = peer
        peer.plug_in()
        kind = driver_class("serial")
        self.options: SerialOptions = kind.Options.model_validate(peer.section)  # type: ignore[assignment]
        self.driver: Driver = kind(self.options, clock)
        self._commands, self._taken = len(peer.history()), peer.taken()

    def sample(self, value: float) -> None:
        """It comes by itself: wait for one that is taken from now on."""
        begun = self.driver.clock()
        until("a sample", lambda: self.driver.read(self.driver.clock())[0].t >= begun)

    def commands(self) -> list[list[float]]:
        until("the commands", lambda: self.peer.taken() - self._taken >= self.driver.counters[COMMANDS])
        new = self.peer.history()[self._commands :]
        self._commands += len(new)
        return [[volts] for volts in new]

    def cut(self) -> bool:
        self.peer.unplug()
        return True

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigProcess]:
    process = RigProcess(tmp_path_factory.mktemp("rig"))
    yield process
    process.close()


@pytest.fixture
def bench(rig: RigProcess) -> Iterator[Bench]:
    bench = ProcessBench(rig, time.monotonic)
    yield bench
    bench.driver.close()
