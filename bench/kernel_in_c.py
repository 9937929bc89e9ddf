"""The kernel in C (`bench/kernel.c`), compiled by cc -O2 and called by ctypes."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sim import exact, kernel, matrix_steps, physics, runs, substep
from sim.parameters import PARAMETERS
from sim.runs import RELAY
from sim.state import STATE

if TYPE_CHECKING:
    from numpy.typing import NDArray

CONSTANTS = {
    "SAME": exact.SAME,
    "SMALL": exact.SMALL,
    "TERMS": exact.TERMS,
    "COST": exact.COST,
    "PASSED": exact.PASSED,
    "MATRIX_STATES": matrix_steps.STATES,
    "KEPT": matrix_steps.KEPT,
    "MATRIX_SAME": matrix_steps.SAME,
    "MATRIX_COST": matrix_steps.COST,
    "WORTH": matrix_steps.WORTH,
    "MATRIX_TERMS": matrix_steps.TERMS,
    "LAMINAR": physics.LAMINAR,
    "VACUUM": physics.VACUUM,
    "SETTLED": physics.SETTLED,
    "ROUNDING": kernel.ROUNDING,
    "SHARPNESS": kernel.SHARPNESS,
    "MOST_TRIALS": kernel.MOST_TRIALS,
    "MOST_EVENTS": kernel.MOST_EVENTS,
    "HALVINGS": substep.HALVINGS,
    "PASSES": substep.PASSES,
    "ON_TIME": runs.ON_TIME,
}
ROWS = ctypes.c_long


def records() -> str:
    """The header with the records and constants, as the Python side has them."""
    lines = [f"#define {name} {value!r}" for name, value in CONSTANTS.items()]
    for kind, dtype in (("Plant", PARAMETERS), ("State", STATE), ("Relay", RELAY)):
        fields = " ".join(f"double {name}{_lengths(dtype[name])};" for name in dtype.names or ())
        lines.append(f"typedef struct {{ {fields} }} {kind};")
    return "\n".join(lines) + "\n"


def _lengths(field: np.dtype) -> str:
    """Of an array in a record, as C writes them; of a number nothing."""
    return "".join(f"[{length}]" for length in field.shape)


def build(folder: Path) -> ctypes.CDLL:
    """Compile the library into `folder`.

    Raises:
        OSError, subprocess.CalledProcessError: There is no C compiler, or it refuses.
    """
    (folder / "kernel_records.h").write_text(records())
    here = Path(__file__).parent
    command = ["cc", "-O2", "-std=c11", "-Wall", "-fPIC", "-shared", f"-I{folder}", f"-I{here}"]
    subprocess.run([*command, "-o", folder / "kernel.so", here / "kernel.c", "-lm"], check=True)
    return ctypes.CDLL(str(folder / "kernel.so"))


class KernelInC:
    """The runs, on the same records and arrays; without noise, supply and temperature."""

    def __init__(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            self.library = build(Path(folder))

    def follow(self, p: NDArray, s: NDArray, t: NDArray, u: NDArray, y: NDArray) -> None:
        self.library.follow(_at(p), _at(s), _at(t), _at(u), _at(t), ROWS(len(t)), _at(y))

    def sampled_relay(
        self, p: NDArray, s: NDArray, r: NDArray, t: NDArray, y: NDArray, u: NDArray, t_u: NDArray
    ) -> None:
        self.library.sampled_relay(_at(p), _at(s), _at(r), _at(t), ROWS(len(t)), _at(y), _at(u), _at(t_u))

    def ideal_relay(
        self, p: NDArray, s: NDArray, r: NDArray, t: NDArray, y: NDArray, switches: NDArray
    ) -> int:
        rows, most = ROWS(len(t)), ROWS(len(switches))
        return self.library.ideal_relay(_at(p), _at(s), _at(r), _at(t), rows, _at(y), _at(switches), most)


def _at(array: NDArray) -> ctypes.c_void_p:
    if not array.flags.c_contiguous or array.itemsize % np.dtype(np.float64).itemsize:
        raise ValueError(f"an array of contiguous doubles is needed, not {array.dtype}")
    return ctypes.c_void_p(array.ctypes.data)
