"""`seod.response`: the frequency response, from recordings or on a rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seod.answers import Answer
from seod.api.data import How, arrays, one, pair, several
from seod.api.identification import gain_unit
from seod.api.options import delay_of, gain_of, part_of, seconds_of, volts_of
from seod.api.progress import teller
from seod.api.rig_file import rig_of
from seod.machine.limits import needs_linux
from seod.respond.record import RespondError, Segment
from seod.respond.relay import recorded
from seod.respond.response import respond
from seod.respond.show import as_json, as_text, draw

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from seod.api.data import Data
    from seod.api.options import Number
    from seod.api.progress import Bar, Told
    from seod.api.rig_file import RigFile
    from seod.data import Recording
    from seod.respond.predict import Prediction
    from seod.respond.record import Output
    from seod.respond.relay import LimitCycle
    from seod.respond.response import Response


@dataclass(frozen=True, repr=False)
class FrequencyResponse(Answer):
    """Points of a frequency response, and the plant of Eq. 1 fitted to them.

    Attributes:
        response: Points and fits.
        name: Of the recordings, or of the axis.
        output: What y is.
        gain_unit: Unit of K_L.
        cycle: What a limit cycle says, to compare; None where there is none.
        predicted: What the rig file's plant would show; None where nobody asked.
        recordings: What it is of; none where a rig was excited.
    """

    response: Response
    name: str
    output: Output
    gain_unit: str
    cycle: LimitCycle | None = None
    predicted: Prediction | None = None
    recordings: tuple[Recording, ...] = ()

    @property
    def quality(self) -> str:
        """`ok`, or why it is not to be believed."""
        return self.response.quality

    @property
    def omega_n(self) -> float:
        """Undamped natural frequency of the fit [rad/s]."""
        return self.response.fit.plant.omega_n

    @property
    def zeta(self) -> float:
        """Damping ratio of the fit."""
        return self.response.fit.plant.zeta

    @property
    def K_L(self) -> float:
        """Gain of the fit, in `gain_unit`."""
        return self.response.fit.plant.K_L

    def summary(self) -> str:
        """Fits with 95 % intervals beside what the limit cycle tells, and what distorts."""
        return as_text(self.response, self.name, self.cycle, self.predicted, self.gain_unit)

    def to_dict(self) -> dict[str, Any]:
        """As `seod response --json` prints it."""
        units = {"K_L": self.gain_unit, "omega_n": "rad/s", "zeta": "1", "delay": "s"}
        return as_json(self.response, self.output, self.cycle, self.predicted) | {"units": units}

    def to_columns(self) -> dict[str, Any]:
        """A row for each point: omega [rad/s], G as real and imaginary part, gain, phase [deg], sd."""
        points = self.to_dict()["points"]
        return {name: np.array([point[name] for point in points]) for name in points[0]}

    def plot(self) -> Figure:
        """Bode plot."""
        return draw(self.response, self.output, self.cycle, self.name)


def response(
    data: Data = None,
    *,
    t: ArrayLike | None = None,
    u: ArrayLike | None = None,
    y: ArrayLike | None = None,
    t_u: ArrayLike | None = None,
    config: RigFile | str | PathLike[str] | None = None,
    axis: str | None = None,
    kind: Literal["multisine", "sine"] | None = None,
    amplitude: Number | None = None,
    band: str | tuple[float, float] | None = None,
    period: Number | None = None,
    periods: int | None = None,
    realisations: int | None = None,
    points: int | None = None,
    seed: int | None = None,
    relay: bool | None = None,
    e_a: Number | None = None,
    predict: bool = False,
    limit_cycle: Data = None,
    gain: Number | None = None,
    delay: Number | None = None,
    output: Output | None = None,
    columns: str | Mapping[str, str] = "",
    units: str | Mapping[str, str] = "",
    between: str | tuple[float, float] | None = None,
    progress: Told | Bar | None = None,
) -> FrequencyResponse:
    """Measure a frequency response: points, the fit of Eq. 1, a Bode plot.

    With data it is that of recordings; without, the rig of `config` is excited by its daemon (Linux).

    Args:
        data: As of `seod.identify`; each recording is a segment of its own.
        t: As of `seod.read`.
        u: Likewise.
        y: Likewise.
        t_u: Likewise.
        config: Rig file: the rig to excite, or with data the rig that they are of.
        axis: Of rigs and recordings with several.
        kind: On a rig: random-phase multisines (default), or sines one after the other.
        amplitude: On a rig: largest voltage [V]; left out: e_a, or less to fit the limits.
        band: On a rig: lowest and highest frequency [Hz], `"0.5:60"`; left out: by what the relay shows.
        period: Of the multisine, or of the data [s]; left out: found.
        periods: On a rig: of each multisine, to average over.
        realisations: On a rig: multisines with other phases.
        points: On a rig: number of sines.
        seed: On a rig: random seed of the multisine's phases.
        relay: On a rig: run the relay before, to compare.
        e_a: On a rig: amplitude of that relay [V].
        predict: On a rig: simulate what the rig file's plant would show.
        limit_cycle: With data: a relay's recording, to compare with.
        gain: K_L if it is known, in SI or as `"50 mm/s/V"`.
        delay: Delay if it is known [s], or `"4 ms"`.
        output: What y of the data is; left out: a position.
        columns: As of `seod.read`.
        units: Likewise.
        between: Likewise.
        progress: Called with the step and the part that is done, or a bar such as tqdm's.

    Raises:
        ReadError: Data cannot be read.
        RespondError: They tell no response, or options do not fit the rig.
        CalibrationError: The rig refuses, or the guard stopped it.
        ValueError: An option is wrong.
    """
    given = arrays(t=t, u=u, y=y, t_u=t_u)
    live: dict[str, Any] = {
        "kind": kind,
        "amplitude": volts_of("amplitude", amplitude),
        "band": None if band is None else pair(band, "--band", positive=True),
        "periods": periods,
        "realisations": realisations,
        "points": points,
        "relay": relay,
        "e_a": volts_of("e_a", e_a),
        "seed": seed,
    }
    live = {name: value for name, value in live.items() if value is not None}
    of_data = {"output": output, "columns": columns, "units": units, "between": between}
    of_data["limit_cycle"] = limit_cycle
    rig = rig_of(config)
    chosen = _Options(gain_of(gain), delay_of(delay), seconds_of("period", period))
    if data is None and given is None:
        _refuse([name for name, value in of_data.items() if value not in (None, "")], "recordings", "a rig")
        if rig is None:
            raise ValueError("give recordings, or a rig by --config")
        return _on_rig(rig, axis, live, chosen, predict, teller(progress))
    _refuse([*live, *(["predict"] if predict else [])], "a rig that is excited", "recordings")
    how = How(columns, units, axis, part_of(between), of_rig=rig is not None)
    return _of_recordings(data, given, how, rig, output or "position", chosen, limit_cycle)


@dataclass(frozen=True)
class _Options:
    gain: float | None
    delay: float | None
    period: float | None


def _refuse(options: list[str], right: str, wrong: str) -> None:
    if options:
        told = ", ".join(f"--{name.replace('_', '-')}" for name in sorted(options))
        raise ValueError(f"{told}: for {right}, not for {wrong}")


def _on_rig(
    rig: RigFile, axis: str | None, live: dict[str, Any], chosen: _Options, predict: bool, told: Told
) -> FrequencyResponse:
    needs_linux()
    from seod.respond import live as excitation  # noqa: PLC0415 - Linux only
    from seod.respond.on_rig import on_rig  # noqa: PLC0415

    name = axis_of(rig, axis)
    options = excitation.Options(period=chosen.period, **live)
    known = chosen.gain, chosen.delay
    found = on_rig(rig.config, rig.path, name, options, known, predict, told)
    unit, output = rig.axes[name].gain_unit, found.segments[0].output
    return FrequencyResponse(found.response, name, output, unit, found.cycle, found.predicted)


def _of_recordings(
    data: Data,
    given: dict[str, ArrayLike] | None,
    how: How,
    rig: RigFile | None,
    output: Output,
    chosen: _Options,
    limit_cycle: Data,
) -> FrequencyResponse:
    recordings = several(data, given, how)
    names = [str(each.paths[0]) for each in recordings]
    segments = [
        Segment.of(name, each.t, each.u, each.y, each.t_u, output=output, period=chosen.period)
        for name, each in zip(names, recordings, strict=True)
    ]
    delay, lag, unit = chosen.delay, 0.0, gain_unit(recordings[0], output)
    if rig is not None:
        section = rig.axes[axis_of(rig, how.axis)]
        lag, unit = rig.config.sensors[section.sensor].lag, section.gain_unit
        delay = section.estimator.delay if delay is None and section.estimator.delay > 0.0 else delay
    found = respond(segments, chosen.gain, delay, lag)
    cycle, every = None, recordings
    if limit_cycle is not None:
        if chosen.gain is None:
            raise RespondError("--relay needs K_L, --gain K: one limit cycle does not tell it")
        of = one(limit_cycle, how._replace(between=None))
        name, every = str(of.paths[0]), [*recordings, of]
        cycle = recorded(name, of.t, of.u, of.y, of.t_u, output, chosen.gain, chosen.delay)
    return FrequencyResponse(found, ", ".join(names), output, unit, cycle, None, tuple(every))


def axis_of(rig: RigFile, name: str | None) -> str:
    """The axis meant.

    Raises:
        RespondError: There are several, or none of that name.
    """
    if name is None and len(rig.axes) == 1:
        return next(iter(rig.axes))
    if name is None or name not in rig.axes:
        what = "which axis?" if name is None else f"no axis {name!r}:"
        raise RespondError(f"{what} --axis takes one of {', '.join(rig.axes)}")
    return name
