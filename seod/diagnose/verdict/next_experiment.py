"""The experiment that tells apart causes which the recordings cannot, tried out by simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.causes.table import CAUSES, alike_under_relay, group, hidden_by_relay
from seod.diagnose.result import NextExperiment
from seod.diagnose.tuning.verdict import NEXT_EXPERIMENT
from seod.diagnose.verdict.experiment_trial import Excitation, Run, follow, perform, refitted, times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.model import Model
    from seod.diagnose.result import Array, FoundEffect


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
            return _for(effect, rivals[: NEXT_EXPERIMENT.rivals_tried], model, x, noise, volts, tick)
    return None


def beyond_a_relay(model: Model, x: Array, noise: float, volts: float, tick: float) -> NextExperiment | None:
    """The experiment that shows what a record with two commands cannot; arguments as of `next_experiment`.

    What the valve does to two values is a change of its gain, or a bias. None where a multisine does not show
    what is tried of each either.
    """
    values = model.values(x)
    excitation = excitations(values["omega_n"], volts, tick)[-1]
    t, apart = times(values["omega_n"], tick), []
    hidden = [name for name in hidden_by_relay() if name not in model.names]
    names = [name for name in hidden if CAUSES[name].has_room(model.scales)]
    for name in names:
        other = model.with_effect(name)
        shown = other.searched(values | hidden_by_relay()[name].shown(volts))
        run = perform(other.kernel_parameters(shown), excitation, t)
        apart.append(refitted(model, [x], run, noise)[1])
    if not names or min(apart) < NEXT_EXPERIMENT.misses_by:
        return None
    low, high = excitation.band
    amplitudes = ", ".join(f"{each:.3g}" for each in excitation.amplitudes)
    return NextExperiment(
        input=f"multisine, {low:g} to {high:g} Hz: {amplitudes} V one after the other",
        reason=(
            f"the command has two values: {', '.join(names)} vanish into the gain, alike are {_alike()}; "
            f"under the multisine each shows by at least {min(apart):.3g} times the noise, "
            f"with {_sizes()} (simulated)"
        ),
        separates=tuple(names),
        command=" && ".join(
            f"seod response --config RIG.yaml --amplitude {each:.4g} --band {low:g}:{high:g}"
            for each in excitation.amplitudes
        ),
    )


def _alike() -> str:
    return ", ".join(f"{one} and {other}" for one, other in alike_under_relay())


def _sizes() -> str:
    return ", or ".join(dict.fromkeys(one.size for one in hidden_by_relay().values()))


def _rival(name: str, effect: FoundEffect, model: Model, x: Array) -> Rival | None:
    """None for a wave, whose frequency nobody knows, and where its own limits leave no room.

    Nor is one that does nothing without a cause that is not there.
    """
    if effect.name not in model.names or not CAUSES[name].has_room(model.scales):
        return None
    others = model.without(effect.name)
    if CAUSES[name].needs not in {"", *others.names}:
        return None
    other = others.with_effect(name)
    values = model.values(x)
    begins = [values | start for start in group(name, model.scales).starts]
    places = {coordinate.place for coordinate in other.coordinates}
    known = [other.searched(start) for start in begins if places <= start.keys()]
    return Rival(name, other, known[: NEXT_EXPERIMENT.starts_tried]) if known else None


def _for(
    effect: FoundEffect, rivals: list[Rival], model: Model, x: Array, noise: float, volts: float, tick: float
) -> NextExperiment | None:
    record, t = model.kernel_parameters(x), times(model.values(x)["omega_n"], tick)
    best: tuple[float, Excitation] | None = None
    for excitation in excitations(model.values(x)["omega_n"], volts, tick):
        run = perform(record, excitation, t)
        apart = _least_misfit(rivals, run, noise)
        if best is None or apart > best[0]:
            best = apart, excitation
        if apart > NEXT_EXPERIMENT.misses_by:
            break
    if best is not None and best[0] > NEXT_EXPERIMENT.misses_by:
        return _experiment(effect, rivals, best[1], best[0], float(t[-1]))
    return _sensor(
        effect, rivals, perform(record, excitations(model.values(x)["omega_n"], volts, tick)[-1], t), noise
    )


def _least_misfit(rivals: Sequence[Rival], run: Run, noise: float) -> float:
    """What the nearest rival leaves, over the noise; those after one that comes near do not matter."""
    least = math.inf
    for each in rivals:
        least = min(least, refitted(each.model, each.begins, run, noise)[1])
        if least < NEXT_EXPERIMENT.misses_by:
            break
    return least


def excitations(omega_n: float, volts: float, tick: float) -> list[Excitation]:
    """In the order of what they ask of the rig and of whoever runs it."""
    f = omega_n / (2.0 * math.pi)
    low, high = (part * f for part in NEXT_EXPERIMENT.band)
    band = _rounded(low), _rounded(min(high, NEXT_EXPERIMENT.highest / tick))
    relay, sine, multisine = (
        tuple(part * volts for part in parts)
        for parts in (NEXT_EXPERIMENT.relay, NEXT_EXPERIMENT.sine, NEXT_EXPERIMENT.multisine)
    )
    return [
        Excitation("relay", relay, band),
        Excitation("two-phase", (volts,), band),
        Excitation("steps", (volts,), (_rounded(NEXT_EXPERIMENT.steps * f), band[1])),
        Excitation("sine", sine, band),
        Excitation("multisine", multisine, band),
    ]


def _rounded(hz: float) -> float:
    """To a thousandth, slow ones to three digits."""
    return round(hz, max(3, 2 - math.floor(math.log10(hz))))


def _experiment(
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
        _, pressure = follow(each.model.kernel_parameters(x), run.t, run.u)
        apart = min(apart, float(np.sqrt(np.mean((pressure - run.pressure) ** 2))) / spread)
    if apart < NEXT_EXPERIMENT.pressure_differs:
        return None
    names = effect.name, *(each.name for each in rivals)
    return NextExperiment(
        input="the same input, with the load force (both chambers' pressures) or the spool recorded too",
        reason=(
            f"no input alone separates {' and '.join(names)}: y is the same; the load force would "
            f"differ by {100.0 * apart:.2g} % of its own deviation (simulated)"
        ),
        separates=names,
    )
