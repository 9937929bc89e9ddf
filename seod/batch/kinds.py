"""Kinds of tasks: what each asks, and the key figures that its table shows."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from seod.api.diagnoses import diagnose
from seod.api.identification import identify
from seod.api.responses import response
from seod.api.simulations import simulate

if TYPE_CHECKING:
    from collections.abc import Callable

Told = dict[str, Any]
"""An answer as its command's `--json` prints it."""
RECORDING: Final = ".csv.gz"
"""Of simulated recordings."""


class Kind(NamedTuple):
    """One kind of task.

    Attributes:
        ask: Path and options to the answer, and a recording's bytes where one is made, else none.
        figures: Columns of the table, and where in the answer each is.
        function: Of the Python interface; its arguments are the options that may be given.
    """

    ask: Callable[[str, dict[str, Any]], tuple[Told, bytes]]
    figures: dict[str, tuple[str, ...]]
    function: Callable[..., Any]


def _values(*names: str) -> dict[str, tuple[str, ...]]:
    return {name if of == "value" else f"{name}_{of}": (name, of) for name in names for of in ("value", "sd")}


def _identify(path: str, options: dict[str, Any]) -> tuple[Told, bytes]:
    return identify(path, **options).to_dict(), b""


def _diagnose(path: str, options: dict[str, Any]) -> tuple[Told, bytes]:
    return diagnose(path, **options).to_dict(), b""


def _response(path: str, options: dict[str, Any]) -> tuple[Told, bytes]:
    return response(path, **options).to_dict(), b""


def _simulate(path: str, options: dict[str, Any]) -> tuple[Told, bytes]:
    made = simulate(path, **options)
    with tempfile.TemporaryDirectory() as folder:
        recording = made.save(Path(folder) / f"run{RECORDING}").read_bytes()
    return made.to_dict(), recording


KINDS: Final = {
    "identify": Kind(
        _identify,
        _values("K_L", "omega_n", "zeta", "delay") | {"quality": ("quality",), "nrmse": ("nrmse",)},
        identify,
    ),
    "diagnose": Kind(
        _diagnose,
        {
            "verdict": ("verdict",),
            "grade": ("grade",),
            "causes": ("effects", "name"),
            "K_L": ("extended", "K_L"),
            "omega_n": ("extended", "omega_n"),
            "zeta": ("extended", "zeta"),
            "baseline_nrmse": ("baseline", "holdout_nrmse"),
            "extended_nrmse": ("extended", "holdout_nrmse"),
            "noise_floor_nrmse": ("noise_floor_nrmse",),
        },
        diagnose,
    ),
    "response": Kind(
        _response,
        {
            "K_L": ("fit", "K_L", "value"),
            "omega_n": ("fit", "omega_n", "value"),
            "zeta": ("fit", "zeta", "value"),
            "quality": ("quality",),
        },
        response,
    ),
    "simulate": Kind(
        _simulate,
        {
            "rows": ("rows",),
            "seed": ("seed",),
            "K_L": ("truth", "K_L"),
            "omega_n": ("truth", "omega_n"),
            "zeta": ("truth", "zeta"),
        },
        simulate,
    ),
}
"""By the name of the command that asks the same of one recording."""


def figure(answer: Any, place: tuple[str, ...]) -> Any:
    """What stands at a place of an answer; None where there is nothing. Of a list all, with `+` between."""
    for name in place:
        if isinstance(answer, list):
            return "+".join(str(each[name]) for each in answer)
        answer = None if answer is None else answer.get(name)
    return "+".join(map(str, answer)) if isinstance(answer, list) else answer
