"""From recordings to a diagnosis: baseline, causes, what they gain, what is left."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from seod.diagnose.answer import Diagnosis, Unexplained
from seod.diagnose.begin import baseline, simulated_states
from seod.diagnose.fit import fit
from seod.diagnose.score import drawn, held_out, score, wholes, windows
from seod.diagnose.windows import cut, pieces, sample, series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.answer import Output

    Progress = Callable[[str, float], None]

SCREENED_S: Final = 6.0
"""Of windows on which all causes are tried."""
WORKERS: Final = 2


@dataclass(frozen=True, slots=True)
class Options:
    """What the user tells.

    Attributes:
        output: What `y` is.
        config: The rig whose model is the baseline; None: Eq. 1.
        axis: Of that rig; None: its first.
    """

    output: Output = "position"
    config: RigConfig | None = None
    axis: str | None = None


def diagnose(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    options: Options | None = None,
    progress: Progress = lambda _what, _part: None,
) -> Diagnosis:
    """Find what Eq. 1, or a rig's model, gets wrong in recordings.

    Args:
        recordings: At least one.
        holdout: Further ones, that no fit sees.
        options: See there.
        progress: Called with what is being done and the part of all work that is.

    Raises:
        DiagnoseError: A recording tells nothing.
    """
    wishes = options or Options()
    sees_speed = wishes.output == "velocity"
    every = [series(each, sees_speed=sees_speed) for each in (*recordings, *holdout)]
    to_fit, aside = cut(every, len(holdout))
    with ThreadPoolExecutor(WORKERS) as pool:
        progress("fitting Eq. 1", 0.0)
        small = pieces(to_fit)
        first = baseline(sample(small, SCREENED_S), sees_speed, _known(wishes), pool.map)
        base = fit(first.model, small, first.x, simulated_states(first.model, first.x, small), each=pool.map)
    held = held_out(base.model, base.x, aside)
    simulated, whole_nrmse, diverged = wholes(base.model, base.x, aside)
    told = score(base.model, base.x, held, whole_nrmse, diverged, {})
    progress("done", 1.0)
    return Diagnosis(
        verdict="clean" if held.adequacy < 1.2 else "unexplained",
        baseline=told,
        effects=(),
        extended=told,
        noise_floor_nrmse=held.floor,
        unexplained=Unexplained(0.0 if held.adequacy < 1.2 else 1.0),
        next_experiment=None,
        output=wishes.output,
        noise_sd=tuple(one.noise for one in every),
        adequacy=held.adequacy,
        windows=tuple(windows(held, held, aside=True)),
        whole=drawn(aside, simulated, simulated),
    )


def _known(wishes: Options) -> Mapping[str, Mapping[str, float]]:
    """Effects of the rig's model."""
    if wishes.config is None or wishes.config.simulation is None:
        return {}
    plants = wishes.config.simulation.plants
    return plants[wishes.axis or next(iter(plants))].effects
