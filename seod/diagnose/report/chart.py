"""Line charts and maps of the report, drawn by matplotlib in the style of all pictures."""

from __future__ import annotations

from dataclasses import dataclass, field
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.plots.style import AFTER, BEFORE, FLOOR, MEASURED, new_figure, style, svg
from seod.plots.thin import thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["AFTER", "BEFORE", "FLOOR", "MEASURED", "Chart", "Curve", "Map", "thinned", "wrapped"]

_PIXELS: Final = 96.0
"""Of a page, in an inch."""
_LETTER, _SPACE, _LINE = 6.2, 42.0, 12.5
"""Width of a letter, of what stands beside a legend's entry, and height of its line: pixels, points."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One line: `dash` as SVG has it; a band where `to` is given."""

    x: Array
    y: Array
    label: str = ""
    colour: str = MEASURED
    width: float = 1.3
    dash: str = ""
    dots: bool = False
    to: Array | None = None

    def draw(self, axes: Axes) -> None:
        """Into a picture."""
        if self.to is not None:
            told: dict[str, Any] = {"label": self.label} if self.label else {}
            axes.fill_between(
                self.x, self.y, self.to, facecolor=self.colour, alpha=0.18, linewidth=0.0, **told
            )
            return
        look: dict[str, Any] = {"color": self.colour, "label": self.label or "_"}
        if self.dots:
            axes.plot(self.x, self.y, linestyle="none", marker="o", markersize=3.2, **look)
            return
        dashes = tuple(float(each) for each in self.dash.split())
        line = (0.0, dashes) if dashes else "-"
        axes.plot(*thinned(self.x, self.y), linewidth=0.75 * self.width, linestyle=line, **look)


@dataclass(slots=True)
class Chart:
    """Curves in a frame; sizes in pixels of the page."""

    title: str
    x_label: str
    y_label: str
    curves: list[Curve] = field(default_factory=list)
    width: float = 460.0
    height: float = 250.0
    log_x: bool = False
    log_y: bool = False

    def figure(self) -> Figure:
        """The picture, as high as its title and its legend need."""
        lines = wrapped(self.title, self.width)
        rows = self._legend_rows()
        high = self.height + max(0.0, (len(lines) + rows - 2) * _LINE / 0.75)
        figure = new_figure(self.width / _PIXELS, high / _PIXELS)
        self.draw(figure.subplots())
        return figure

    def draw(self, axes: Axes) -> None:
        """Into a part of a picture."""
        lines, rows = wrapped(self.title, self.width), self._legend_rows()
        axes.set_xscale("log" if self.log_x else "linear")
        axes.set_yscale("log" if self.log_y else "linear")
        for curve in self.curves:
            curve.draw(axes)
        axes.margins(x=0.01)
        axes.set(xlabel=self.x_label, ylabel=self.y_label)
        axes.set_title("\n".join(lines), pad=4.0 + _LINE * rows, fontweight="bold")
        if rows:
            across = -(-self._labelled() // rows)
            above: Any = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.0}
            axes.legend(ncols=across, handlelength=1.6, columnspacing=1.2, labelspacing=0.2, **above)

    def svg(self) -> str:
        """The picture for a page."""
        with style():
            return svg(self.figure())

    def wide(self) -> str:
        """A wide chart: where the page is narrow it is scrolled, not made too small to read."""
        return f'<div class="scroll wide">{self.svg()}</div>'

    def _labelled(self) -> int:
        return sum(bool(curve.label) for curve in self.curves)

    def _legend_rows(self) -> int:
        """Lines of the legend: so many that the longest entries fit side by side."""
        labels = [curve.label for curve in self.curves if curve.label]
        if not labels:
            return 0
        fit = max(1, int((self.width - 70.0) / (_SPACE + _LETTER * max(map(len, labels)))))
        return -(-len(labels) // fit)


@dataclass(slots=True)
class Map:
    """A quantity over two others, as colours about zero: red above, blue below, none where no data is.

    Attributes:
        x, y: Edges of the grid, shapes (n + 1,) and (m + 1,).
        values: Shape (m, n); nan where there is none.
        most: Value at which the colour is full.
    """

    title: str
    x_label: str
    y_label: str
    x: Array
    y: Array
    values: Array
    most: float
    width: float = 460.0
    height: float = 250.0

    def figure(self) -> Figure:
        """The picture."""
        lines = wrapped(self.title, self.width)
        figure = new_figure(self.width / _PIXELS, (self.height + (len(lines) - 1) * _LINE / 0.75) / _PIXELS)
        axes = figure.subplots()
        shown = axes.pcolormesh(
            self.x, self.y, np.ma.masked_invalid(self.values), cmap="RdBu_r", vmin=-self.most, vmax=self.most
        )
        figure.colorbar(shown, ax=axes, pad=0.01, aspect=30).outline.set_visible(False)
        axes.set(xlabel=self.x_label, ylabel=self.y_label)
        axes.set_title("\n".join(lines), fontweight="bold")
        return figure

    def svg(self) -> str:
        """The picture for a page."""
        with style():
            return svg(self.figure())


def wrapped(title: str, width: float) -> list[str]:
    """Lines of a title that a picture of this width [pixels] has room for."""
    return wrap(title, max(10, int((width - 70.0) / 7.6)))
