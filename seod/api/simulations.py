"""`seod.simulate`: a recording from the plant of a rig file, and the truth that is in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.answers import Answer
from seod.api.data import How, one, pair
from seod.api.options import hertz_of, seconds_of, volts_of
from seod.api.progress import followed, teller
from seod.api.rig_file import rig_of
from seod.config.units import BASE, UNITS
from seod.files.user_files import irregular
from seod.simulate.csv_file import ENDINGS, write_csv
from seod.simulate.options import Options, excitation_named, read_effects
from seod.simulate.procedure import Simulation as Procedure
from seod.simulate.summary import summary
from sim.cache import are_compiled
from sim.excitation import GivenInput, read_input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from os import PathLike

    from matplotlib.figure import Figure

    from seod.api.data import Data
    from seod.api.options import Number
    from seod.api.progress import Bar, Told
    from seod.api.rig_file import RigFile
    from seod.data.recording import Recording
    from seod.simulate.view import AxisView


COMPILING = "compiling the kernel (once)"
"""A step of `progress`."""


@dataclass(frozen=True, repr=False)
class Simulation(Answer):
    """A simulated recording. Wherever measured data are taken, it is too.

    Attributes:
        recording: What a daemon would have recorded, in SI units.
        told: What it is, and the truth that is in it.
        columns: As they are written, by name.
    """

    recording: Recording
    told: dict[str, Any] = field(hash=False)
    columns: dict[str, Any] = field(hash=False)

    @property
    def truth(self) -> dict[str, Any]:
        """K_L, omega_n, zeta and effects of the plant; what it is to small signals."""
        truth: dict[str, Any] = self.told["truth"]
        return truth

    def summary(self) -> str:
        """The recording, and the truth in a line."""
        truth = ", ".join(f"{name} {self.truth[name]:.6g}" for name in ("K_L", "omega_n", "zeta"))
        effects = ", ".join(self.truth["effects"]) or "no effects"
        return f"{self.recording.summary()}\n  truth: {truth}; {effects}"

    def to_dict(self) -> dict[str, Any]:
        """As `seod simulate` prints it."""
        return self.told

    def to_columns(self) -> dict[str, Any]:
        """The recording's columns, in SI units."""
        return self.recording.to_columns()

    def plot(self) -> Figure:
        """Command and reading over time."""
        return self.recording.plot()

    def save(self, path: str | PathLike[str], told: Callable[[float], None] = lambda _: None) -> Path:
        """Write the recording as CSV, plain or gzip; a file that is there already is kept as `NAME~`.

        Raises:
            ValueError: The name ends otherwise, or its folder is not there.
            OSError: It cannot be written.
        """
        to = Path(path)
        if why := unwritable(to):
            raise ValueError(f"{to}: {why}")
        units = self.recording.units
        write_csv(to, {_headed(name, units): column for name, column in self.columns.items()}, told)
        return to


def _headed(name: str, units: Mapping[str, str]) -> str:
    """A column tells its unit where a reader would take it for another."""
    unit = units.get(name, "")
    return f"{name} [{unit}]" if unit and (name == "y" or (name == "u" and unit != "V")) else name


def unwritable(path: Path) -> str:
    """Why a recording of this name cannot be written; "" if that can be tried."""
    if not path.name.endswith(ENDINGS):
        return f"the name must end in {' or '.join(ENDINGS)}"
    return "" if path.parent.is_dir() else f"there is no directory {path.parent}"


def simulate(
    config: RigFile | str | PathLike[str],
    *,
    axis: str | None = None,
    effect: Mapping[str, Any] | Iterable[str] = (),
    excitation: str = "relay",
    amplitude: Number | None = None,
    bias: Number | None = None,
    duration: Number | None = None,
    frequency: Number | None = None,
    band: str | tuple[float, float] | None = None,
    period: Number | None = None,
    lines: int | None = None,
    cycles: int | None = None,
    input: Data = None,  # noqa: A002 - as on the command line
    noise: float | None = None,
    latency: Number = 0.0,
    seed: int | None = None,
    progress: Told | Bar | None = None,
) -> Simulation:
    """Simulate what the daemon would record of a rig.

    Args:
        config: Rig file with a `simulation:` section.
        axis: The axis, where there are several.
        effect: In the plant, as in docs/model.md: `{"valve_deadband.half_width": 0.05}`,
            `{"valve_deadband": {"half_width": 0.05}}`, or words as on the command line.
        excitation: `relay`, `two-phase`, `sine`, `sweep`, `linear-sweep`, `multisine`, `steps` or `file`.
        amplitude: [V]; left out: e_a.
        bias: Added to it [V].
        duration: [s]; left out: 10 s.
        frequency: Of the sine, or of pairs of steps [Hz].
        band: Of sweep or multisine [Hz]: `"0.5:60"`, or a pair.
        period: Of the multisine [s].
        lines: Number of the multisine's lines, spread by octaves.
        cycles: Of each of the two phases.
        input: With `excitation="file"`: a CSV file, or a table with columns t, u, and if wanted ps,
            temperature.
        noise: Standard deviation, as `noise` of the plant; left out: the rig file's.
        latency: From a sample to the command's leaving [s].
        seed: Random seed of noise, defects and signal; left out: the rig file's.
        progress: Called with the step and the part that is done, or a bar such as tqdm's.

    Raises:
        ConfigErrors: The rig file is wrong.
        ValueError: An option is wrong, or cannot be.
        OSError: The input file cannot be read.
    """
    rig = rig_of(config)
    assert rig is not None  # noqa: S101 - one was given
    options = Options(
        excitation=excitation_named(excitation),
        effects=read_effects(_words(effect)),
        amplitude=volts_of("amplitude", amplitude),
        bias=volts_of("bias", bias),
        duration=seconds_of("duration", duration),
        frequency=hertz_of("frequency", frequency),
        band=None if band is None else pair(band, "--band", positive=True),
        period=seconds_of("period", period),
        lines=lines,
        cycles=cycles,
        input=None if input is None else _input(input),
        noise=noise,
        latency=seconds_of("latency", latency) or 0.0,
        seed=seed,
    )
    if rig.config.simulation is None:
        raise ValueError(f"rig {rig.rig} has no `simulation:` section: there is nothing to simulate")
    procedure = Procedure(rig.config, _axis(rig, axis), options)
    told = None if progress is None else teller(progress)
    if told is not None and not are_compiled(*procedure.compiled_parts):
        told(COMPILING, 0.0)
    columns = followed("simulating", procedure.run, procedure.fraction, told)
    return Simulation(_recording(procedure, columns), summary(procedure, columns), columns)


def _axis(rig: RigFile, axis: str | None) -> str:
    there = ", ".join(rig.axes)
    if axis is None and len(rig.axes) > 1:
        raise ValueError(f"rig {rig.rig} has the axes {there}: choose one by --axis")
    if axis is not None and axis not in rig.axes:
        raise ValueError(f"no axis {axis!r}; there are {there}")
    return axis or next(iter(rig.axes))


def _words(effect: Mapping[str, Any] | Iterable[str]) -> list[str]:
    """`{"valve_lag": {"time": 2e-3}}` as `valve_lag.time=0.002`."""
    if isinstance(effect, str):
        return [effect]
    if not hasattr(effect, "items"):
        return [str(word) for word in effect]
    words = []
    for name, value in effect.items():
        each = value.items() if hasattr(value, "items") else [("", value)]
        words += [f"{name}.{key}={number!r}" if key else f"{name}={number!r}" for key, number in each]
    return words


def _input(given: Data) -> GivenInput:
    if isinstance(given, str | Path):
        if why := irregular(Path(given)):
            raise ValueError(f"--input {given}: {why}")
        return read_input(Path(given))
    table = dict(given) if hasattr(given, "items") else {name: given[name] for name in given.columns}
    # copied: for the read-only columns of a DataFrame the kernel would be compiled once more
    there = {str(name): np.array(column, np.float64) for name, column in table.items()}
    if missing := [name for name in ("t", "u") if name not in there]:
        raise ValueError(f"input: no column {', '.join(missing)}; there are {', '.join(there) or 'none'}")
    if len(there["t"]) < 2 or not np.all(np.diff(there["t"]) > 0.0):
        raise ValueError("input: t must ascend, and have two rows or more")
    return GivenInput(there["t"], there["u"], there.get("ps"), there.get("temperature"))


def _recording(procedure: Procedure, columns: Mapping[str, Any]) -> Recording:
    """The columns as a recording: what a reader makes of the file, without the file."""
    name = Path(f"{procedure.config.rig}.{procedure.name}")
    units = units_of(procedure.view)
    table = {_headed(role, units): np.asarray(column) for role, column in columns.items()}
    return one(table, How(name=str(name)))


def units_of(view: AxisView) -> dict[str, str]:
    """SI units of an axis' readings and commands."""
    output = view.config.outputs[view.axis.output]
    return {"y": BASE.get(view.sensor.dimension, ""), "u": BASE[UNITS[output.unit][0]]}
