"""Who pays for numba: those that simulate, when they begin to; nobody else."""

from __future__ import annotations

import subprocess
import sys

import pytest

from sim.cache import is_plant_compiled

SHOWN = "; import sys; print(sorted({'numba', 'llvmlite'} & set(sys.modules)))"


def numba_after(code: str) -> str:
    command = [sys.executable, "-c", code + SHOWN]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        "import seod.cli, seod.commands, seod.loop.process, seod.gateway.process, seod.supervisor.process",
        "import drivers.can, drivers.virtual, sim.config, sim.cache, sim.truth, seod.launch.daemon",
        "from seod.config.load import load_rig; from seod.config.check import check; "
        "from seod.config.truth import truth; from seod.files.shipped import configs_dir; "
        "truth(load_rig(configs_dir() / 'virtual.yaml'))",
    ],
    ids=["daemon", "drivers", "rig file"],
)
def test_the_daemon_and_its_rig_files_do_without(code: str) -> None:
    assert numba_after(code) == "[]"


@pytest.mark.slow
def test_a_virtual_rig_that_is_opened_has_it() -> None:
    code = (
        "from drivers.virtual import VirtualDriver; from seod.config.load import load_rig; "
        "from seod.files.shipped import configs_dir; rig = load_rig(configs_dir() / 'virtual.yaml'); "
        "driver = VirtualDriver(VirtualDriver.Options.model_validate(rig.driver), lambda: 0.0); "
        "driver.open(['encoder'], ['amplifier'])"
    )
    assert numba_after(code) == "['llvmlite', 'numba']"
    assert is_plant_compiled()  # as `seod run` looks for it
