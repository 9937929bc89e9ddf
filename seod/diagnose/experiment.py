"""The experiment that tells apart causes which the recordings cannot, tried out by simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.answer import NextExperiment
from seod.diagnose.coordinates import group
from seod.diagnose.trial import Excitation, Run, follow, perform, refitted, times

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.answer import Array, FoundEffect
    from seod.diagnose.coordinates import Values
    from seod.diagnose.model import Model

ENOUGH: Final = 1.0
"""Times the noise by which the rival must miss, once it is fitted: its squared error is then doubled."""
PRESSURE: Final = 0.03
"""Part of the load pressure's deviation by which the models must differ for it to be worth a sensor."""
VANISHING: Final[dict[str, Callable[[float], Values]]] = {
    "valve_deadband": lambda volts: {"valve_deadband.half_width": 0.1 * volts},
    "valve_hysteresis": lambda volts: {"valve_hysteresis.half_width": 0.1 * volts},
    "valve_saturation": lambda volts: {"valve_saturation.limit": 0.6 * volts},
}
"""Causes that two values of the command hide, each with a part of it."""
_RIVALS: Final = 3
_STARTS: Final = 2
"""Places from which a rival's fit begins."""


class Rival(NamedTuple):
    """Another cause in the place of a found one."""

    name: str
    model: Model
    begins: list[Array]


def next_experiment(
    effects: Sequence[FoundEffect], model: Model, x: Array, noise: float, volts: float, tick: float
) -> NextExperiment | None:
    """What to do next where a found effect could be another; None where all are told apart.

    Args:
        effects: Found, with `indistinguishable_from`.
        model: The extended model.
        x: Its searched numbers.
        noise: Of the samples [unit, or unit/s].
        volts: Largest command of the recordings [V]: no trial asks for more.
        tick: Sampling interval [s].
    """
    for effect in effects:
        rivals = [each for name in effect.indistinguishable_from if (each := _rival(name, effect, model, x))]
        if rivals:
            return _for(effect, rivals[:_RIVALS], model, x, noise, volts, tick)
    return None


def beyond_a_relay(model: Model, x: Array, noise: float, volts: float, tick: float) -> NextExperiment | None:
    """The experiment that shows what a record with two commands cannot; arguments as of `next_experiment`.

    What the valve does to two values is a change of its gain, or a bias. None where a multisine does not show
    what is tried of each either.
    """
    values = model.values(x)
    excitation = excitations(values["omega_n"], volts, tick)[-1]
    t, apart = times(values["omega_n"], tick), []
    names = [name for name in VANISHING if name not in model.names]
    for name in names:
        other = model.with_effect(name)
        run = perform(other.record(other.searched(values | VANISHING[name](volts))), excitation, t)
        apart.append(refitted(model, [x], run, noise)[1])
    if not names or min(apart) < ENOUGH:
        return None
    low, high = excitation.band
    amplitudes = ", ".join(f"{each:.3g}" for each in excitation.amplitudes)
    return NextExperiment(
        input=f"multisine, {low:g} to {high:g} Hz: {amplitudes} V one after the other",
        reason=(
            f"the command has two values: {', '.join(names)} vanish into the gain, asymmetric_gain equals "
            f"a load_bias; under the multisine each shows by at least {min(apart):.3g} times the noise, with "
            "a tenth of the command as half width, or six tenths as limit (simulated)"
        ),
        separates=tuple(names),
        command=" && ".join(
            f"seod response --config RIG.yaml --amplitude {each:.4g} --band {low:g}:{high:g}"
            for each in excitation.amplitudes
        ),
    )


def _rival(name: str, effect: FoundEffect, model: Model, x: Array) -> Rival | None:
    """None for a wave: where its frequency would begin nobody knows."""
    if effect.name not in model.names:
        return None
    other = model.without(effect.name).with_effect(name)
    values = model.values(x)
    begins = [values | start for start in group(name, model.scales).starts]
    places = {each.place for each in other.coordinates}
    known = [other.searched(start) for start in begins if places <= start.keys()]
    return Rival(name, other, known[:_STARTS]) if known else None


def _for(
    effect: FoundEffect, rivals: list[Rival], model: Model, x: Array, noise: float, volts: float, tick: float
) -> NextExperiment | None:
    record, t = model.record(x), times(model.values(x)["omega_n"], tick)
    best: tuple[float, Excitation] | None = None
    for excitation in excitations(model.values(x)["omega_n"], volts, tick):
        run = perform(record, excitation, t)
        apart = _apart(rivals, run, noise)
        if best is None or apart > best[0]:
            best = apart, excitation
        if apart > ENOUGH:
            break
    if best is not None and best[0] > ENOUGH:
        return _told(effect, rivals, best[1], best[0], float(t[-1]))
    return _sensor(
        effect, rivals, perform(record, excitations(model.values(x)["omega_n"], volts, tick)[-1], t), noise
    )


def _apart(rivals: Sequence[Rival], run: Run, noise: float) -> float:
    """What the nearest rival leaves, over the noise; those after one that comes near do not matter."""
    least = math.inf
    for each in rivals:
        least = min(least, refitted(each.model, each.begins, run, noise)[1])
        if least < ENOUGH:
            break
    return least


def excitations(omega_n: float, volts: float, tick: float) -> list[Excitation]:
    """In the order of what they ask of the rig and of whoever runs it."""
    f = omega_n / (2.0 * math.pi)
    band = round(0.1 * f, 3), round(min(3.0 * f, 0.4 / tick), 3)
    slow = round(0.1 * f, 3), band[1]
    return [
        Excitation("relay", (volts / 4.0, volts / 2.0, volts), band),
        Excitation("two-phase", (volts,), band),
        Excitation("steps", (volts,), (round(0.3 * f, 3), band[1])),
        Excitation("sine", (volts / 8.0, volts), slow),
        Excitation("multisine", (volts / 4.0, volts), band),
    ]


def _told(
    effect: FoundEffect, rivals: Sequence[Rival], excitation: Excitation, apart: float, length: float
) -> NextExperiment:
    names = effect.name, *(each.name for each in rivals)
    volts = ", ".join(f"{each:.3g}" for each in excitation.amplitudes) + " V"
    volts += " one after the other" if len(excitation.amplitudes) > 1 else ""
    where = {
        "multisine": f", {excitation.band[0]:g} to {excitation.band[1]:g} Hz",
        "sine": f" of {excitation.band[0]:g} Hz",
        "steps": f", {excitation.band[0]:g} pairs a second",
    }.get(excitation.kind, "")
    return NextExperiment(
        input=f"{excitation.kind}{where}: {volts}, {length:.2g} s in all or longer",
        reason=(
            f"fitted to it, {' and '.join(names[1:])} would still miss what {names[0]} does by at least "
            f"{apart:.3g} times the noise (simulated)"
        ),
        separates=names,
        command=" && ".join(
            _command(excitation, volts, length / len(excitation.amplitudes), k)
            for k, volts in enumerate(excitation.amplitudes, 1)
        ),
    )


def _command(excitation: Excitation, volts: float, length: float, number: int) -> str:
    """For a daemon that runs and records; what is no relay for the simulated rig."""
    low, high = excitation.band
    if excitation.kind in {"relay", "two-phase"}:
        phases = "true" if excitation.kind == "two-phase" else "false"
        return f"seod set e_a={volts:.4g} two_phase={phases} && seod start && sleep {length:.2g} && seod stop"
    more = f" --band {low:g}:{high:g}" if excitation.kind == "multisine" else f" --frequency {low:g}"
    return (
        f"seod simulate RIG.yaml --out next{number}.csv --excitation {excitation.kind} "
        f"--amplitude {volts:.4g}{more}"
    )


def _sensor(effect: FoundEffect, rivals: Sequence[Rival], run: Run, noise: float) -> NextExperiment | None:
    """No input separates them: whether the load pressure would."""
    spread = max(float(np.std(run.pressure)), 1e-300)
    apart = math.inf
    for each in rivals:
        x, _ = refitted(each.model, each.begins, run, noise)
        _, pressure = follow(each.model.record(x), run.t, run.u)
        apart = min(apart, float(np.sqrt(np.mean((pressure - run.pressure) ** 2))) / spread)
    if apart < PRESSURE:
        return None
    names = effect.name, *(each.name for each in rivals)
    return NextExperiment(
        input="the same input, with the load pressure (of both chambers) or the spool recorded beside y",
        reason=(
            f"no input alone separates {' and '.join(names)}: y is the same; the load pressure would "
            f"differ by {100.0 * apart:.2g} % of its own deviation (simulated)"
        ),
        separates=names,
    )
