"""`seod.diagnose`: what the simulation gets wrong in recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seod.answers import Answer
from seod.api.data import How, arrays, listed, one
from seod.api.options import delay_of, gain_of, part_of
from seod.api.progress import teller
from seod.api.rig_file import RigFile, rig_of
from seod.diagnose.command import Options, command_line, found, unit_of
from seod.diagnose.command import part_of as told_part
from seod.diagnose.report.as_read import as_read
from seod.diagnose.report.files import RIG, Rig, extended_rig, facts, write
from seod.diagnose.report.page import page
from seod.diagnose.report.text import as_text
from seod.diagnose.report.units import Units

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from os import PathLike

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from seod.api.data import Data
    from seod.api.options import Number
    from seod.api.progress import Bar, Told
    from seod.data import Recording
    from seod.diagnose.record.daemon_part import Part
    from seod.diagnose.result import Diagnosis as Found
    from seod.diagnose.result import FoundEffect, Grade, Hold, NextExperiment, Output, Score, Verdict
    from seod.diagnose.search.budget import Effort


@dataclass(frozen=True, repr=False)
class Diagnosis(Answer):
    """What the baseline gets wrong, which causes explain it, and the extended model.

    Attributes:
        found: All that was found.
        unit: Of y in all numbers: SI where the data tell theirs. Sentences and pictures have theirs.
        recordings: What it is of.
        holdout: Recordings that no fit has seen.
        rig: Whose model is the baseline; None: Eq. 1.
        axis: Of that rig.
        asked: Files and options, by which the same can be asked on the command line; None: data in memory.
    """

    found: Found
    unit: str
    recordings: tuple[Recording, ...]
    holdout: tuple[Recording, ...] = ()
    rig: RigFile | None = None
    axis: str | None = None
    asked: tuple[Sequence[Path], Options] | None = None

    @property
    def verdict(self) -> Verdict:
        """`clean`, `effects` or `unexplained`."""
        return self.found.verdict

    @property
    def grade(self) -> Grade:
        """What the extended model is good for."""
        return self.found.grade

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Causes, in order of gain."""
        return self.found.effects

    @property
    def baseline(self) -> Score:
        """Eq. 1, or the rig's model."""
        return self.found.baseline

    @property
    def extended(self) -> Score:
        """With the effects."""
        return self.found.extended

    @property
    def next_experiment(self) -> NextExperiment | None:
        """What would tell apart causes that these recordings cannot."""
        return self.found.next_experiment

    @property
    def units(self) -> dict[str, str]:
        """Of the values."""
        gain = Units.of(self.unit, self.found.output).gain
        return {"y": self.unit, "K_L": gain, "omega_n": "rad/s", "zeta": "1"}

    @property
    def title(self) -> str:
        """Of the page."""
        return "What the simulation gets wrong"

    def summary(self) -> str:
        """Verdict, figures before and after, causes, and what else there is to say."""
        return as_text(*self._as_read())

    def to_dict(self) -> dict[str, Any]:
        """As `seod diagnose --json` prints it."""
        return self.found.as_json() | {"units": self.units}

    def to_columns(self) -> dict[str, Any]:
        """A row for each parameter of each cause."""
        d, units = self.found, Units.of(self.unit, self.found.output)
        rows = [(e, name, p) for e in d.effects for name, p in e.parameters.items()]
        return {
            "cause": [e.name for e, _, _ in rows],
            "parameter": [name for _, name, _ in rows],
            "value": [p.value for _, _, p in rows],
            "low": [p.ci95[0] for _, _, p in rows],
            "high": [p.ci95[1] for _, _, p in rows],
            "unit": [units.named(p.unit) for _, _, p in rows],
            "share": [d.share(e) for e, _, _ in rows],
            "p_value": [e.p_value for e, _, _ in rows],
        }

    def plot(self) -> Figure:
        """A held-out window where the baseline is at its worst: measured, simulated, and the errors."""
        from seod.diagnose.report.over_time import draw  # noqa: PLC0415 - matplotlib

        return draw(*self._as_read())

    @property
    def drawable(self) -> bool:
        """Whether there are windows to draw."""
        return bool(self.found.windows)

    def to_html(self) -> str:
        """The report: one page with all pictures in it."""
        every = (*self.recordings, *self.holdout)
        sources = [path.name for each in every for path in each.paths]
        return page(*self._as_read(), sources, facts(every, self.command()))

    def command(self, out: Path | None = None) -> str:
        """By which the same can be asked on the command line; "" for data in memory."""
        return "" if self.asked is None else command_line(self.asked[0], self.asked[1]._replace(out=out))

    def rig_file(self) -> RigFile:
        """The extended model as a rig file, for `seod.simulate` and `seod run`.

        Raises:
            ValueError: The model makes no rig.
            ConfigErrors: Likewise.
        """
        text = extended_rig(self.found, self.recordings[0], self._rig())
        return RigFile.from_text(text, RIG, Path() if self.rig is None else self.rig.path.parent)

    def save(self, out: str | PathLike[str]) -> list[str]:
        """Write report.html, diagnosis.json and the extended rig into a folder, as `--out` does.

        Returns:
            What could not be written, in sentences.

        Raises:
            OSError: A file cannot be written.
        """
        every = [*self.recordings, *self.holdout]
        folder, told = Path(out), self.to_dict()
        return write(folder, self.found, self.unit, every, self._rig(), self.command(folder), told)

    def _as_read(self) -> tuple[Found, str]:
        return as_read(self.found, self.recordings[0], self.unit)

    def _rig(self) -> Rig | None:
        if self.rig is None or self.axis is None:
            return None
        return Rig(self.rig.path, self.rig.text, self.rig.config, self.axis)


def diagnose(
    data: Data = None,
    *,
    t: ArrayLike | None = None,
    u: ArrayLike | None = None,
    y: ArrayLike | None = None,
    t_u: ArrayLike | None = None,
    ps: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    f: ArrayLike | None = None,
    holdout: Data = None,
    config: RigFile | str | PathLike[str] | None = None,
    axis: str | None = None,
    output: Output | None = None,
    gain: Number | None = None,
    delay: Number | None = None,
    hold: Hold | None = None,
    columns: str | Mapping[str, str] = "",
    units: str | Mapping[str, str] = "",
    between: str | tuple[float, float] | None = None,
    effort: Effort = "normal",
    relevance: float = 2.0,
    progress: Told | Bar | None = None,
) -> Diagnosis:
    """Show what the simulation gets wrong, name the cause, and extend the model.

    Args:
        data: A path, a table of pandas or polars, a `Recording`, a `Simulation`, or a list of these, which
            are fitted jointly. Left out: the arrays.
        t: As of `seod.read`.
        u: Likewise.
        y: Likewise.
        t_u: Likewise.
        ps: Likewise.
        temperature: Likewise.
        f: Likewise.
        holdout: Recordings that no fit may see.
        config: Rig file, whose model is the baseline; left out: Eq. 1.
        axis: Of recordings and rig files with several.
        output: What y is; left out: as the rig file's axis has it, else both are tried.
        gain: K_L if it is known, in SI or as `"50 mm/s/V"`.
        delay: Delay if it is known [s], or `"4 ms"`; left out: a cause like others.
        hold: Whether u holds until the next row (`zero`) or runs straight on to it (`first`); left out: it
            holds, unless a cause is not needed where it runs on.
        columns: As of `seod.read`.
        units: Likewise.
        between: Likewise.
        effort: `quick`, `normal` or `thorough`: how long causes are searched for.
        relevance: Systematic rest that is called unexplained, in % of the movement's standard deviation.
        progress: Called with the step and the part that is done, or a bar such as tqdm's.

    Raises:
        ReadError: Data cannot be read.
        DiagnoseError: A recording tells nothing.
        ValueError: An option is wrong.
    """
    rig, given = rig_of(config), arrays(t=t, u=u, y=y, t_u=t_u, ps=ps, temperature=temperature, f=f)
    name = axis if rig is None else rig.axis(axis)
    how = How(columns, units, axis, part_of(between), of_rig=rig is not None)
    every, unseen = listed(data, given), [] if holdout is None else listed(holdout)
    parts = [None if how.between is not None else _part(each, axis) for each in every]
    recordings = [
        one(each, how if part is None else how._replace(between=part[:2]))
        for each, part in zip(every, parts, strict=True)
    ]
    others = [one(each, how._replace(between=None)) for each in unseen]
    options = Options(
        [path for each in others for path in each.paths],
        None if rig is None else rig.path,
        None,
        axis,
        output,
        _text(columns),
        _text(units),
        how.between,
        effort,
        hold,
        gain_of(gain),
        delay_of(delay),
        0.01 * relevance,
    )
    config_ = None if rig is None else rig.config
    told = found(recordings, others, config_, options, parts, teller(progress))
    unit = unit_of(recordings[0], told.output, config_, axis)
    typed = all(isinstance(each, str | Path) for each in (*every, *unseen))
    asked = ([Path(each) for each in every], options) if typed else None
    return Diagnosis(told, unit, tuple(recordings), tuple(others), rig, name, asked)


def _part(data: Data, axis: str | None) -> Part | None:
    return told_part(Path(data), axis) if isinstance(data, str | Path) else None


def _text(pairs: str | Mapping[str, str]) -> str:
    """As the command line has it."""
    return pairs if isinstance(pairs, str) else ",".join(f"{name}={each}" for name, each in pairs.items())
