"""Compile what tests simulate with, before they begin: `python -m tests.machine_code`.

Test processes that begin at the same moment would each compile the same kernel, a minute of processor time.
Here one does, while the linters have the other processor. What these sources have been compiled to already is
not looked at again.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import numpy as np

import seod
from sim.cache import HYDRAULIC, REDUCED, are_compiled, cache_folder, compile_plant

TESTS = Path(__file__).parent
KERNELS = (*REDUCED, *HYDRAULIC, "runs.sampled_relay", "runs.follow", "windows.follow_windows")
CYCLES = {"excitation": "multisine", "period": 0.5, "lines": 10}


def main() -> None:
    """Simulate with each kernel once."""
    done = _note()
    if done is not None and done.exists() and are_compiled(*KERNELS):
        return
    compile_plant(("reduced", "hydraulic"))
    rig = seod.RigFile.shipped()
    seod.simulate(rig, duration=0.1)  # a relay
    made = seod.simulate(rig, amplitude=0.2, duration=1.5, **CYCLES)
    seod.diagnose(made, effort="quick", between="0:1")
    _hidden()
    assert are_compiled(*KERNELS)
    if done is not None:
        done.touch()


def _note() -> Path | None:
    """The file that says so, beside the machine code of these sources; None where nothing is kept."""
    folder = cache_folder()
    hidden = sorted((TESTS / "blind").glob("hidden_*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in hidden)).hexdigest()[:16]
    return folder / f"tests-{digest}" if folder else None


def _hidden() -> None:
    """The actuator of `tests/blind`, which shares no line with `sim`."""
    sys.path.insert(0, str(TESTS / "blind"))
    from hidden_rig import GIVEN, Drive, Rig, simulate

    t = np.arange(0.0, 0.01, 1e-3)
    simulate(Rig(17.0, 60.0, 0.5, {}), t, Drive(GIVEN, np.ones(len(t))))


if __name__ == "__main__":
    main()
