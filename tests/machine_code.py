"""Compile what tests simulate with, before they begin: `python -m tests.machine_code`.

Test processes that begin at the same moment would each compile the same kernel, a minute of processor time.
Here one does, while the linters have the other processor.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import seod
from sim.cache import HYDRAULIC, REDUCED, are_compiled, compile_plant

TESTS = Path(__file__).parent
KERNELS = (*REDUCED, *HYDRAULIC, "runs.sampled_relay", "runs.follow", "windows.follow_windows")
CYCLES = {"excitation": "multisine", "period": 0.5, "lines": 10}


def main() -> None:
    """Simulate with each kernel once."""
    compile_plant(("reduced", "hydraulic"))
    rig = seod.RigFile.shipped()
    seod.simulate(rig, duration=0.1)  # a relay
    made = seod.simulate(rig, amplitude=0.2, duration=1.5, **CYCLES)
    seod.diagnose(made, effort="quick", between="0:1")
    _hidden()
    assert are_compiled(*KERNELS)


def _hidden() -> None:
    """The actuator of `tests/blind`, which shares no line with `sim`."""
    sys.path.insert(0, str(TESTS / "blind"))
    from hidden_rig import GIVEN, Drive, Rig, simulate

    t = np.arange(0.0, 0.01, 1e-3)
    simulate(Rig(17.0, 60.0, 0.5, {}), t, Drive(GIVEN, np.ones(len(t))))


if __name__ == "__main__":
    main()
