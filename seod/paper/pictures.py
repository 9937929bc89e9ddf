"""The figures as pictures: SVG and PNG, the same bytes from the same numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Numbers = dict[str, Any]

LOOKS: Final = {
    "peaks": ("peaks (the paper's procedure)", "#d55e00"),
    "exact": ("exact", "#0072b2"),
    "wave": ("wave", "#009e73"),
    "two-phase": ("two-phase", "#cc79a7"),
}
"""Name and colour of each method."""
RC: Final[Any] = {
    "svg.hashsalt": "seod",
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.fontsize": 8,
    "figure.constrained_layout.use": True,
}
DOTS: Final = 130
"""Per inch of the PNG."""


def save(
    numbers: Numbers, draw: Callable[[Figure, Numbers], None], size: tuple[float, float], path: Path
) -> None:
    """Draw and write `path`.svg and `path`.png."""
    import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure as Made  # noqa: PLC0415

    with mpl.rc_context(rc=RC):
        figure = Made(figsize=size)
        FigureCanvasAgg(figure)
        draw(figure, numbers)
        figure.savefig(path.with_suffix(".svg"), metadata={"Date": None, "Creator": None})
        figure.savefig(path.with_suffix(".png"), dpi=DOTS, metadata={"Software": None})


def _numbers(values: list[float | None]) -> np.ndarray:
    return np.array([math.nan if value is None else value for value in values])


def figure_4(figure: Figure, n: Numbers) -> None:
    """Correction factors over zeta."""
    for axes, name, text in zip(figure.subplots(1, 2), ("xi", "Gamma"), ("ξ", "Γ"), strict=True):
        axes.plot(n["zeta"], n[f"{name}_eq8"], color="#d55e00", label="Eq. 8")
        axes.plot(n["zeta"], n[f"{name}_exact"], color="#0072b2", label="exact limit cycle")
        axes.plot(n["zeta_simulated"], n[f"{name}_simulated"], "k.", label="simulation")
        axes.set(xscale="log", xlabel="ζ", ylabel=text)
        axes.legend()


def figure_10(figure: Figure, n: Numbers) -> None:
    """Waves."""
    rows = figure.subplots(3, 1, sharex=True)
    for axes, name, text in zip(
        rows,
        ("speed", "relay_input", "relay_output"),
        ("speed [rad/s]", "relay's input [rad]", "relay's output [V]"),
        strict=True,
    ):
        axes.plot(n["t"], n[name], color="#0072b2", lw=1)
        axes.set_ylabel(text)
    rows[-1].set_xlabel("t [s]")


def _band(axes: Axes, x: list[float], n: Numbers, name: str, method: str) -> None:
    label, colour = LOOKS[method]
    values, wide = _numbers(n[name]), _numbers(n[f"{name}_95"])
    axes.plot(x, values, color=colour, lw=1, label=label)
    if np.nanmax(wide, initial=0.0) > 0.0:
        axes.fill_between(x, values - wide, values + wide, color=colour, alpha=0.2, lw=0)


def _sweep(figure: Figure, n: Numbers, over: str, key: str, scale: float, text: str) -> None:
    for axes, name, label in zip(
        figure.subplots(1, 2), ("zeta", "omega_n"), ("ζ", "ω_n [rad/s]"), strict=True
    ):
        tops = []
        for method in ("peaks", "exact", "wave"):
            x = [each * scale for each in n[method][over]]
            _band(axes, x, n[method], name, method)
            tops.append(np.nanmax(_numbers(n[method][name])))
        small = n["small_signal"]
        axes.plot(
            [x * scale for x in small[key]], small[name], "k--", lw=1, label="small signals, by physics"
        )
        tops.append(max(small[name]))
        for mark, part in zip("os", (name for name in n if name.startswith("response")), strict=False):
            of = n[part]
            x = [each * scale for each in of[key]]
            axes.errorbar(
                x,
                _numbers(of[name]),
                _numbers(of[f"{name}_95"]),
                fmt=mark,
                ms=4,
                mfc="none",
                color="k",
                lw=0.8,
                label=f"frequency response, {part.partition('_')[2]} V",
            )
            tops.append(np.nanmax(_numbers(of[name])))
        axes.set(xlabel=text, ylabel=label, ylim=(0, 1.15 * max(tops)))
    figure.axes[0].legend()


def figure_11(figure: Figure, n: Numbers) -> None:
    """Both parameters over supply pressure."""
    _sweep(figure, n, "ps", "ps", 1e-6, "supply pressure [MPa]")


def figure_12(figure: Figure, n: Numbers) -> None:
    """Both parameters over speed."""
    _sweep(figure, n, "speed", "speed", 1.0, "speed [rad/s]")


def figure_15(figure: Figure, n: Numbers) -> None:
    """Rudder over supply pressure."""
    _sweep(figure, n, "ps", "ps", 1e-6, "supply pressure [MPa]")


def _bode(gain: Axes, phase: Axes, n: Numbers, integral: bool) -> None:
    sizes = [name for name in n if name.startswith("response")]
    omega = np.array(n[sizes[0]]["points"]["omega"])
    grid = np.geomspace(omega[0], omega[-1], 200)
    for mark, part in zip("os", sizes, strict=False):
        points = n[part]["points"]
        label = f"response, {part.partition('_')[2]} V"
        gain.plot(
            points["omega"], 20 * np.log10(points["gain"]), mark, ms=3, mfc="none", color="k", label=label
        )
        phase.plot(points["omega"], np.degrees(points["phase"]), mark, ms=3, mfc="none", color="k")
    for method, (label, colour) in LOOKS.items():
        plant = n[method]
        if plant["zeta"] is None or plant["omega_n"] is None:
            continue
        K_L = plant["K_L"] or n["small_signal"]["K_L"]
        s = 1j * grid
        square = plant["omega_n"] ** 2
        G = (
            K_L
            * square
            / (s**2 + 2 * plant["zeta"] * plant["omega_n"] * s + square)
            / (s if integral else 1.0)
        )
        gain.plot(grid, 20 * np.log10(np.abs(G)), color=colour, lw=1, label=label)
        phase.plot(grid, np.degrees(np.unwrap(np.angle(G))), color=colour, lw=1)
    for axes in (gain, phase):
        _decades(axes)
    phase.set_xlabel("ω [rad/s]")


def _decades(axes: Axes) -> None:
    """A logarithmic axis of frequencies with few, plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter  # noqa: PLC0415 - an extra, and slow to import

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def figure_13(figure: Figure, n: Numbers) -> None:
    """Bode plots at three speeds."""
    grid = figure.subplots(2, 3, sharex=True)
    for column, (speed, each) in enumerate(n.items()):
        _bode(grid[0][column], grid[1][column], each, False)
        grid[0][column].set_title(f"{speed} rad/s")
    grid[0][0].set_ylabel("gain [dB re rad/s/V]")
    grid[1][0].set_ylabel("phase [deg]")
    grid[0][0].legend()


def figure_14(figure: Figure, n: Numbers) -> None:
    """Bode plots of the seat."""
    grid = figure.subplots(2, 2, sharex=True)
    for column, axis in enumerate(("roll", "pitch")):
        _bode(grid[0][column], grid[1][column], n[axis], True)
        grid[0][column].set_title(axis)
    grid[0][0].set_ylabel("gain [dB re rad/V]")
    grid[1][0].set_ylabel("phase [deg]")
    grid[0][0].legend()


def exponents(figure: Figure, n: Numbers) -> None:
    """Exponent of omega_n over supply pressure, by mechanism."""
    axes = figure.subplots()
    rows = list(n["rows"])
    place = np.arange(len(rows))
    for shift, (key, label, colour) in enumerate(
        (
            ("small_signal", "small signals", "#666666"),
            ("exact", "limit cycle at 1.5 V", "#0072b2"),
            ("exact_small", "limit cycle at 0.1 V", "#56b4e9"),
        )
    ):
        axes.barh(
            place + 0.27 * (shift - 1), _numbers([row[key] for row in rows]), 0.25, color=colour, label=label
        )
    axes.axvline(1.0, color="k", ls=":", lw=1)
    axes.set_yticks(place, [row["mechanism"] for row in rows])
    axes.invert_yaxis()
    axes.set_xlabel("exponent of ω_n over supply pressure, 5 to 10 MPa (dotted: in proportion)")
    axes.legend()


def amplitude(figure: Figure, n: Numbers) -> None:
    """Where zeta and omega_n of the limit cycle are the small-signal ones."""
    grid = figure.subplots(1, len(n["maps"]))
    for axes, each in zip(np.atleast_1d(grid), n["maps"], strict=True):
        ps, e_a = np.array(each["ps"]) * 1e-6, np.array(each["e_a"])
        worst = np.array([[math.nan if v is None else v for v in row] for row in each["worst"]])
        shown = axes.pcolormesh(
            ps,
            e_a,
            np.clip(100 * worst, 0.5, 100).T,
            cmap="viridis_r",
            norm="log",
            shading="nearest",
            vmin=0.5,
            vmax=100,
        )
        axes.contour(ps, e_a, worst.T, [0.02], colors="r", linewidths=1.5)
        axes.set(yscale="log", xlabel="supply pressure [MPa]", ylabel="e_a [V]", title=each["axis"])
        axes.grid(visible=False)
    figure.colorbar(shown, ax=grid, label="largest error of ζ and ω_n [%]")


PICTURES: Final[dict[str, tuple[Callable[[Figure, Numbers], None], tuple[float, float]]]] = {
    "4": (figure_4, (9, 3.6)),
    "10": (figure_10, (8, 5)),
    "11": (figure_11, (10, 4)),
    "12": (figure_12, (10, 4)),
    "13": (figure_13, (12, 6)),
    "14": (figure_14, (9, 6)),
    "15": (figure_15, (10, 4)),
    "exponent": (exponents, (8, 5.5)),
    "amplitude": (amplitude, (12, 3.8)),
}
"""How each figure is drawn, and its size in inches."""
