"""The answer for programs, for people, and as a Bode plot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich import box
from rich.table import Table

from seod.respond.fit import NAMES, Plant, model
from seod.terminal import console
from seod.terminal.text import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seod.respond.fit import Fit
    from seod.respond.points import Points
    from seod.respond.predict import Prediction
    from seod.respond.record import Output
    from seod.respond.relay import LimitCycle
    from seod.respond.response import Response

INTERVAL: Final = 1.96
_SHOWN: Final = {
    "omega_n": (1.0, "rad/s"),
    "zeta": (1.0, ""),
    "delay": (1000.0, "ms"),
}


def as_json(
    response: Response, output: Output, cycle: LimitCycle | None = None, predicted: Prediction | None = None
) -> dict[str, Any]:
    """Everything; see docs/response.md. What is undefined is None."""
    return {
        "output": output,
        "quality": response.quality,
        "message": response.message or None,
        "periodic": response.periodic,
        "points": _points_json(response.points),
        "distortion": {"odd": _distortion(response, True), "even": _distortion(response, False)},
        "fit": _fit_json(response.fit),
        "fit_without_delay": _fit_json(response.without_delay),
        "limit_cycle": None if cycle is None else _cycle_json(cycle),
        "difference": None if cycle is None else difference(response.fit.plant, cycle.plant),
        "predicted": None if predicted is None else _predicted_json(predicted),
    }


def _points_json(found: Points) -> list[dict[str, float]]:
    columns = {
        "omega": found.omega,
        "gain": np.abs(found.G),
        "phase": np.degrees(_phase(found.G)),
        "real": found.G.real,
        "imag": found.G.imag,
        "sd": found.sd,
        "coherence": found.coherence,
        "volts": found.volts,
    }
    rows = np.stack(list(columns.values()), axis=1).tolist()
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _distortion(response: Response, odd: bool) -> dict[str, Any] | None:
    empty = response.detection
    level = None if empty is None else empty.distortion(odd)
    if empty is None or level is None:
        return None
    chosen = empty.odd == odd
    lines = zip(
        empty.omega[chosen].tolist(), empty.level[chosen].tolist(), empty.noise[chosen].tolist(), strict=True
    )
    told = [{"omega": omega, "level": size, "noise": noise} for omega, size, noise in lines]
    return {"level": level[0], "significant": level[1], "lines": told}


def _fit_json(fit: Fit) -> dict[str, Any]:
    values = {name: getattr(fit.plant, name) for name in NAMES}
    told: dict[str, Any] = {name: {"value": values[name], "sd": fit.sd[name]} for name in NAMES}
    return told | {"misfit": fit.misfit, "error": fit.error}


def _cycle_json(cycle: LimitCycle) -> dict[str, Any]:
    plant = cycle.plant
    return {
        "e_a": cycle.e_a,
        "K_L": plant.K_L,
        "omega_n": {"value": plant.omega_n, "sd": cycle.omega_n_sd},
        "zeta": {"value": plant.zeta, "sd": cycle.zeta_sd},
    }


def difference(response: Plant, cycle: Plant) -> dict[str, float]:
    """Limit cycle against response, relative."""
    return {
        "omega_n": cycle.omega_n / response.omega_n - 1.0,
        "zeta": cycle.zeta / response.zeta - 1.0,
    }


def _predicted_json(predicted: Prediction) -> dict[str, Any]:
    plants = {"limit_cycle": predicted.limit_cycle, "response": predicted.response}
    told: dict[str, Any] = {
        name: {"omega_n": plant.omega_n, "zeta": plant.zeta} for name, plant in plants.items()
    }
    return told | {"difference": difference(predicted.response, predicted.limit_cycle)}


def as_text(
    response: Response,
    name: str,
    cycle: LimitCycle | None = None,
    predicted: Prediction | None = None,
    gain_unit: str = "unit/s/V",
) -> str:
    """Fits with 95 % intervals beside what the limit cycle tells, and what distorts."""
    table = Table(box=box.SIMPLE, pad_edge=False)
    for title in ("", "response", "without delay", *(["limit cycle"] if cycle else []), ""):
        table.add_column(title, justify="right" if title else "left")
    for key in NAMES:
        factor, unit = (1.0, gain_unit) if key == "K_L" else _SHOWN[key]
        cells = [_with_interval(fit, key, factor) for fit in (response.fit, response.without_delay)]
        table.add_row(key, *cells, *([_of_cycle(cycle, key)] if cycle else []), unit)
    found = response.points
    band = f"{found.omega[0]:.3g} to {found.omega[-1]:.3g} rad/s"
    head = f"{name}: {response.quality}, {len(found.omega)} points, {band}"
    said = [f"! {response.message}"] if response.message else []
    lines = [head, console.as_text(table, width=100).strip("\n"), *said, *_distortion_text(response)]
    if cycle is not None:
        lines.append(
            "limit cycle against response: " + _difference_text(difference(response.fit.plant, cycle.plant))
        )
    if predicted is not None:
        expected = difference(predicted.response, predicted.limit_cycle)
        lines.append("expected of the rig file's plant: " + _difference_text(expected))
    return "\n".join(lines)


def _with_interval(fit: Fit, name: str, factor: float) -> str:
    value, sd = getattr(fit.plant, name) * factor, fit.sd[name] * factor
    return f"{number(value, 5)} +- {number(INTERVAL * sd, 2)}" if sd > 0.0 else f"{number(value, 5)} given"


def _of_cycle(cycle: LimitCycle, name: str) -> str:
    sd = {"omega_n": cycle.omega_n_sd, "zeta": cycle.zeta_sd}.get(name)
    if sd is None:
        return number(cycle.plant.K_L, 5) if name == "K_L" else "-"
    return f"{number(getattr(cycle.plant, name), 5)} +- {number(INTERVAL * sd, 2)}"


def _difference_text(parts: dict[str, float]) -> str:
    return f"omega_n {100 * parts['omega_n']:+.2f} %, zeta {100 * parts['zeta']:+.2f} %"


def _distortion_text(response: Response) -> list[str]:
    parts = []
    for word, odd in (("odd", True), ("even", False)):
        level = None if response.detection is None else response.detection.distortion(odd)
        if level is not None:
            parts.append(f"{word} {100 * level[0]:.2g} %" if level[1] else f"{word} none above noise")
    return [f"distortion: {', '.join(parts)}"] if parts else []


def draw(response: Response, output: Output, cycle: LimitCycle | None, title: str) -> Figure:
    """Bode plot: points and their fit; the limit cycle as a line (Figs. 13, 14)."""
    from seod.plots.style import new_figure, style  # noqa: PLC0415 - matplotlib

    with style():
        figure = new_figure(7.0, 6.4)
        gain, phase = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        _draw_points(gain, phase, response)
        _draw_curves(gain, phase, response, cycle, output)
        gain.set_title(title)
        gain.set_ylabel("position / voltage [dB]" if output == "position" else "speed / voltage [dB]")
        phase.set_ylabel("phase [deg]")
        phase.set_xlabel("frequency [rad/s]")
        phase.set_xscale("log")
        gain.legend()
    return figure


def _draw_points(gain: Any, phase: Any, response: Response) -> None:
    from seod.plots.style import ORDER  # noqa: PLC0415 - matplotlib

    found = response.points
    clear = found.sd < 0.3 * np.abs(found.G)
    omega, G, spread = found.omega[clear], found.G[clear], found.sd[clear] / np.abs(found.G[clear])
    bars = {"fmt": "o", "markersize": 4, "capsize": 2, "elinewidth": 0.8, "color": ORDER[0]}
    gain.errorbar(
        omega, _decibel(G), INTERVAL * 20.0 / math.log(10.0) * spread, label="response, points", **bars
    )
    phase.errorbar(omega, np.degrees(_phase(G)), np.degrees(INTERVAL * spread), **bars)


def _draw_curves(gain: Any, phase: Any, response: Response, cycle: LimitCycle | None, output: Output) -> None:
    from seod.plots.style import BEFORE, FLOOR  # noqa: PLC0415 - matplotlib

    omega = np.geomspace(response.points.omega[0] / 1.5, response.points.omega[-1] * 1.5, 400)
    curves = [("response, fitted", response.fit.plant, {"color": FLOOR, "linestyle": "--", "linewidth": 1.0})]
    if cycle is not None:
        curves.append((f"limit cycle, {cycle.e_a:.3g} V", cycle.plant, {"color": BEFORE, "linewidth": 1.4}))
    for label, plant, style in curves:
        G = model(plant, omega, output)
        gain.plot(omega, _decibel(G), label=label, **style)
        phase.plot(omega, np.degrees(_phase(G)), **style)


def _decibel(G: Any) -> Any:
    return 20.0 * np.log10(np.abs(G))


def _phase(G: Any) -> Any:
    """Of a response by frequency, without jumps; it begins between -270 and 90 degrees."""
    angle = np.unwrap(np.angle(G))
    return angle - 2.0 * np.pi * np.ceil((angle[0] - 0.5 * np.pi) / (2.0 * np.pi)) if len(angle) else angle
