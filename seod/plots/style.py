"""One style for all pictures, by matplotlib: colours that the colour-blind can tell apart, light or dark.

Colours are those of Okabe and Ito (2008), which keep a contrast of 3 or more on white and on a dark page.
"""

from __future__ import annotations

import io
import re
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from matplotlib import rc_context
from matplotlib.figure import Figure

from seod.files.user_files import named

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["AFTER", "BEFORE", "FLOOR", "MEASURED", "ORDER", "Figure", "new_figure", "save", "style", "svg"]

MEASURED: Final = "#1f2329"
"""The measurement's colour, and that of all text; on a dark page it is light."""
BEFORE: Final = "#d55e00"
AFTER: Final = "#0072b2"
FLOOR: Final = "#8c8c8c"
"""Baseline, extended model, noise."""
ORDER: Final = (AFTER, BEFORE, "#009e73", "#cc79a7", "#8c8c8c")
"""Colours of curves that have no meaning of their own."""
_GRID: Final = "#dcdfe3"
_PAPER: Final = "#ffffff"
_DARK: Final = {MEASURED: "#e6e8eb", _GRID: "#3a3f46", _PAPER: "#16191d"}
"""What a light picture's ink, grid and paper are on a dark page."""
FORMATS: Final = (".png", ".svg", ".pdf")
"""Endings of files that a picture is saved to."""
_FAMILY: Final = "'DejaVu Sans'"


def _parameters(dark: bool) -> Any:
    own = _DARK if dark else {}
    ink, grid, paper = (own.get(colour, colour) for colour in (MEASURED, _GRID, _PAPER))
    return {
        "figure.facecolor": paper,
        "axes.facecolor": paper,
        "savefig.facecolor": paper,
        "axes.edgecolor": grid,
        "axes.labelcolor": ink,
        "text.color": ink,
        "xtick.color": ink,
        "ytick.color": ink,
        "grid.color": grid,
        "legend.frameon": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 9,
        "axes.labelsize": 8,
        "figure.titlesize": 10,
        "xtick.labelsize": 7.5,
        "ytick.labelsize": 7.5,
        "legend.fontsize": 8,
        "grid.linewidth": 0.6,
        "lines.linewidth": 1.0,
        "font.family": "DejaVu Sans",
        "axes.prop_cycle": _cycle(ink),
        "svg.fonttype": "none",
        "svg.hashsalt": "seod",  # the same picture has the same bytes
        "path.simplify": True,
    }


def _cycle(ink: str) -> Any:
    from cycler import cycler  # noqa: PLC0415 - comes with matplotlib

    return cycler(color=[ink, *ORDER])


@contextmanager
def style(dark: bool = False) -> Iterator[None]:
    """Around all drawing of a picture."""
    with rc_context(_parameters(dark)):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty picture of this size [inch], whose parts find their own room."""
    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, to: Path) -> None:
    """Write a picture; the ending of the file's name says in which format: PNG, SVG or PDF.

    Raises:
        ValueError: Another ending.
        OSError: The file cannot be written.
    """
    ending = to.suffix.lower() or ".png"
    if ending not in FORMATS:
        raise ValueError(f"{to}: a picture's name ends in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    with style(), named(to):
        figure.savefig(to, format=ending[1:], dpi=110)


def _settled(figure: Figure) -> None:
    """Find the room of all parts, once: while it is drawn it would be done twice more."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


def svg(figure: Figure) -> str:
    """A picture as an `<svg>` element for a page: ink follows the page's text, grid its `--line`.

    It names nothing outside of itself, and no part of it but those that it refers to.
    """
    text = io.StringIO()
    with style():
        figure.patch.set_visible(False)
        _settled(figure)
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    picture = text.getvalue()
    picture = re.sub(r"<metadata>.*?</metadata>", "", picture[picture.index("<svg") :], flags=re.DOTALL)
    used = set(re.findall(r"#([\w-]+)[\")]", picture))
    picture = re.sub(r' id="([\w.-]+)"', lambda found: found.group() if found[1] in used else "", picture)
    picture = picture.replace(MEASURED, "currentColor").replace(_GRID, f"var(--line, {_GRID})")
    picture = picture.replace(_FAMILY, f"{_FAMILY}, Verdana, sans-serif")
    return re.sub(r">\n\s*<", "><", picture.replace("<svg ", '<svg role="img" ', 1)).strip()
