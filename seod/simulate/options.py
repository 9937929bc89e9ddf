"""What someone wants simulated, as it comes from the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, cast, get_args

from sim.effects import parameter

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sim.excitation import GivenInput

Excitation = Literal["relay", "two-phase", "sine", "sweep", "linear-sweep", "multisine", "steps", "file"]

EXCITATIONS: tuple[str, ...] = get_args(Excitation)

BELONGS = {
    "amplitude": tuple(kind for kind in EXCITATIONS if kind != "file"),
    "bias": tuple(kind for kind in EXCITATIONS if kind != "file"),
    "duration": tuple(kind for kind in EXCITATIONS if kind != "file"),
    "frequency": ("sine", "steps"),
    "band": ("sweep", "linear-sweep", "multisine"),
    "period": ("multisine",),
    "lines": ("multisine",),
    "cycles": ("two-phase",),
    "input": ("file",),
}
"""Options and the excitations that they belong to."""


@dataclass(frozen=True)
class Options:
    """See the options of `seod simulate`; None stands for what was not said."""

    excitation: Excitation = "relay"
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    amplitude: float | None = None
    bias: float | None = None
    duration: float | None = None
    frequency: float | None = None
    band: tuple[float, float] | None = None
    period: float | None = None
    lines: int | None = None
    cycles: int | None = None
    input: GivenInput | None = None
    noise: float | None = None
    latency: float = 0.0
    seed: int | None = None

    def __post_init__(self) -> None:
        for option, kinds in BELONGS.items():
            if getattr(self, option) is not None and self.excitation not in kinds:
                raise ValueError(
                    f"--{option} belongs to --excitation {' or '.join(kinds)}, not to {self.excitation}"
                )
        if self.excitation == "file" and self.input is None:
            raise ValueError("--excitation file needs --input FILE, a CSV file with columns t and u")


def excitation_named(name: str) -> Excitation:
    """The excitation of that name.

    Raises:
        ValueError: There is none.
    """
    for known in get_args(Excitation):
        if name == known:
            return cast("Excitation", known)
    raise ValueError(f"--excitation {name}: there are {', '.join(EXCITATIONS)}")


def read_effects(words: Iterable[str]) -> dict[str, dict[str, float]]:
    """`["valve_lag.time=2e-3"]` to values by effect and parameter; of several the last one counts.

    Raises:
        ValueError: A word is not of that form, or names something unknown; it tells what there is.
    """
    found: dict[str, dict[str, float]] = {}
    for word in words:
        place, equals, text = word.partition("=")
        effect, of = parameter(place.strip())
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not equals or math.isnan(value):
            raise ValueError(f"{word}: give a number, such as {effect.name}.{of.name}={_example(of.null)}")
        if not of.low <= value <= of.high:
            raise ValueError(f"{word}: must be within [{of.low:g}, {of.high:g}] {of.unit}")
        found.setdefault(effect.name, {})[of.name] = value
    return found


def _example(null: float) -> str:
    return f"{null:g}" if math.isfinite(null) and null != 0.0 else "1"
