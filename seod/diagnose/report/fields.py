"""Pictures of residuals over what they may depend on: states, command, supply, phase."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.chart import MEASURED, Chart, Curve, Map
from seod.diagnose.show.acting import acting
from seod.diagnose.show.maps import binned, explains, plane

if TYPE_CHECKING:
    from seod.diagnose.report.pictures import Pictures
    from seod.diagnose.result import Array
    from seod.diagnose.show.maps import Binned

_FEW: Final = 4
"""Bins that are drawn as points, such as the two voltages of a relay."""


def fields(p: Pictures) -> list[str]:
    """Residual force over the load's states, residual volts over pressures and command."""
    velocity, position = f"velocity [{p.units.speed}]", f"position [{p.units.position}]"
    pressure = f"{p.load}, as acceleration [{p.units.acceleration}]"
    pictures = [
        _field(p, "Over velocity: a step at 0 is friction", velocity, "force", "velocity"),
        _field(p, "Over position: a slope is a spring, waves are ripple", position, "force", "position"),
        _field(p, f"Over the {p.load}: a bend is flow, or a drive's limit", pressure, "volts", "pressure"),
        _field(p, "Over the command: a flat or a bend is the valve", "u [V]", "volts", "u"),
    ]
    if any(w.ps is not None for w in p.windows):
        pictures.append(_field(p, "Over supply pressure", "supply pressure / nominal", "volts", "ps"))
    return pictures


def planes(p: Pictures) -> list[str]:
    """Residual force over position and velocity, before and after, in the same colours."""
    x, y, units = _states(p, "position"), _states(p, "velocity"), p.units
    tables = [(label, plane(x, y, np.concatenate([r.force for r in left]))) for label, _, left in p.models]
    values = np.abs(tables[0][1][2])
    most = float(np.nanquantile(values, 0.98)) if np.isfinite(values).any() else 1.0
    return [
        Map(
            f"Residual force, {label} (full colour {most:.3g} {units.acceleration})",
            f"position [{units.position}]",
            f"velocity [{units.speed}]",
            *table,
            most or 1.0,
        ).svg()
        for label, table in tables
    ]


def over_phase(p: Pictures, turn: Array) -> str:
    """Error over the phase of the cycle, shape (n,) of all windows [cycles]."""
    return bins(p, "Over the phase of the cycle", "phase [cycles]", f"error [{p.unit}]", turn, "error")


def bins(p: Pictures, title: str, x_label: str, y_label: str, x: Array, kind: str) -> str:
    """A field of the residuals (`error`, `force`, `volts`) over `x`: means with 95 % intervals."""
    curves = []
    for label, colour, left in p.models:
        values = np.concatenate([getattr(r, kind) for r in left])
        curves += _band(binned(x, values, _correlated(p, kind)), label, colour)
    if kind == "force" and (told := _acting(p)) is not None:
        found = binned(x, told, _correlated(p, kind))
        if explains(found, told):
            curves.append(Curve(found.centre, found.mean, "the causes, as measured", MEASURED, 1.4, "5 3"))
    return Chart(title, x_label, y_label, curves).svg()


def _band(found: Binned, label: str, colour: str) -> list[Curve]:
    if np.count_nonzero(np.isfinite(found.mean)) > _FEW:
        band = Curve(found.centre, found.low, "", colour, to=found.high)
        return [Curve(found.centre, found.mean, label, colour, 1.8), band]
    gap = np.full(len(found.centre), np.nan)
    bars = np.column_stack([found.low, found.high, gap]).ravel()
    points = Curve(found.centre, found.mean, label, colour, dots=True)
    return [points, Curve(np.repeat(found.centre, 3), bars, "", colour, 1.6)]


def _correlated(p: Pictures, kind: str) -> float:
    """Neighbouring samples that count as one: differentiated errors are band-limited."""
    if kind == "error":
        return 1.0
    return max(1.0, math.pi / (4.0 * p.diagnosis.baseline.omega_n) / p.tick)


def _acting(p: Pictures) -> Array | None:
    """What the measurement says of the causes that act on the load, windows end to end."""
    if not p.diagnosis.extends:
        return None
    pieces = [acting(p.diagnosis, w) for w in p.windows]
    told = [each for each in pieces if each is not None]
    return np.concatenate(told) if len(told) == len(pieces) else None


def _field(p: Pictures, title: str, x_label: str, kind: str, quantity: str) -> str:
    label = "residual [V]" if kind == "volts" else f"residual force [{p.units.acceleration}]"
    return bins(p, title, x_label, label, _states(p, quantity), kind)


def _states(p: Pictures, name: str) -> Array:
    pieces = [getattr(w, name) for w in p.windows]
    missing = [np.full(len(w.t), np.nan) for w in p.windows]
    return np.concatenate([m if each is None else each for each, m in zip(pieces, missing, strict=True)])
