"""Line charts and maps as SVG text: no package is needed, and they stay sharp at any size."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.scale import Scale, covering

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MEASURED: Final = "#444444"
BEFORE: Final = "#d1495b"
AFTER: Final = "#1b6ca8"
FLOOR: Final = "#8a8a8a"
"""Colours of the whole report: measurement, baseline, extended model, noise."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 10.0, 12.0, 40.0
_LINE: Final = 15.0
"""Height of a line of the title or the legend."""
_TITLE_LETTER, _LEGEND_LETTER, _LEGEND_SPACE = 6.9, 6.0, 38.0
"""Width of a letter, and of a legend's line with the space about it: of the widest of usual fonts."""
_COLUMNS: Final = 700
"""Columns of pixels that a dense line is thinned to: of each its lowest and highest point."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One line: `dash` and `dots` as SVG has them; a band where `to` is given."""

    x: Array
    y: Array
    label: str = ""
    colour: str = MEASURED
    width: float = 1.3
    dash: str = ""
    dots: bool = False
    to: Array | None = None


@dataclass(slots=True)
class Chart:
    """Curves in a frame; `note` stands under the title for who asks what it shows."""

    title: str
    x_label: str
    y_label: str
    curves: list[Curve] = field(default_factory=list)
    width: float = 460.0
    height: float = 250.0
    log_x: bool = False
    log_y: bool = False

    def svg(self) -> str:
        """The picture."""
        across, up = self._scales()
        inside = "".join(_drawn(curve, across, up) for curve in self.curves)
        return _picture(self, across, up, inside + self._legend())

    def wide(self) -> str:
        """A wide chart: where the page is narrow it is scrolled, not made too small to read."""
        return f'<div class="scroll wide">{self.svg()}</div>'

    @property
    def head(self) -> float:
        """Height of title and legend."""
        rows = len(wrapped(self.title, self.width)) + len(self._legend_rows())
        return _TOP + _LINE * rows

    @property
    def full_height(self) -> float:
        """With as many lines of title and legend as there are."""
        return self.height + max(0.0, self.head - _TOP - 2.0 * _LINE)

    def _scales(self) -> tuple[Scale, Scale]:
        ends = [curve.to for curve in self.curves if curve.to is not None]
        across = covering((c.x for c in self.curves), _LEFT, self.width - _RIGHT, self.log_x)
        heights = [*(c.y for c in self.curves), *ends]
        return across, covering(heights, self.full_height - _BOTTOM, self.head, self.log_y)

    def _legend_rows(self) -> list[list[Curve]]:
        """Curves with a label, as many in a row as there is room for."""
        rows: list[list[Curve]] = []
        room = 0.0
        for curve in filter(lambda each: each.label, self.curves):
            needs = _legend_width(curve)
            if needs > room:
                rows.append([])
                room = self.width - _LEFT - _RIGHT
            rows[-1].append(curve)
            room -= needs
        return rows

    def _legend(self) -> str:
        parts, y = [], _TOP + _LINE * len(wrapped(self.title, self.width))
        for row in self._legend_rows():
            at = _LEFT
            for curve in row:
                parts.append(
                    f'<line x1="{at + 4:.0f}" x2="{at + 20:.0f}" y1="{y:.0f}" y2="{y:.0f}" '
                    f'stroke="{curve.colour}" stroke-width="2" stroke-dasharray="{curve.dash}"/>'
                    f'<text x="{at + 24:.0f}" y="{y + 4:.0f}" class="legend">{escape(curve.label)}</text>'
                )
                at += _legend_width(curve)
            y += _LINE
        return "".join(parts)


def _legend_width(curve: Curve) -> float:
    return _LEGEND_SPACE + _LEGEND_LETTER * len(curve.label)


def wrapped(title: str, width: float) -> list[str]:
    """Lines of a title that a picture of this width has room for."""
    return wrap(title, max(10, int((width - _LEFT - _RIGHT) / _TITLE_LETTER)))


@dataclass(slots=True)
class Map:
    """A quantity over two others, as colours about zero: red above, blue below, white where no data is.

    Attributes:
        x, y: Edges of the cells, shapes (n + 1,) and (m + 1,).
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

    def svg(self) -> str:
        """The picture."""
        across = Scale(self.x[0], self.x[-1], _LEFT, self.width - _RIGHT)
        up = Scale(self.y[0], self.y[-1], self.full_height - _BOTTOM, self.head)
        return _picture(self, across, up, "".join(self._cells(across, up)))

    @property
    def head(self) -> float:
        """Height of the title."""
        return _TOP + _LINE * len(wrapped(self.title, self.width))

    @property
    def full_height(self) -> float:
        """With as many lines of title as there are."""
        return self.height + max(0.0, self.head - _TOP - _LINE)

    def _cells(self, across: Scale, up: Scale) -> Iterator[str]:
        left, top = across.pixels(self.x), up.pixels(self.y)
        for j, i in np.argwhere(np.isfinite(self.values)).tolist():
            colour = diverging(self.values[j, i] / self.most)
            size = left[i + 1] - left[i], top[j] - top[j + 1]
            yield (
                f'<rect x="{left[i]:.1f}" y="{top[j + 1]:.1f}" width="{size[0] + 0.3:.1f}" '
                f'height="{size[1] + 0.3:.1f}" fill="{colour}"/>'
            )


def diverging(share: float) -> str:
    """Colour of -1 (blue) over 0 (nearly white) to 1 (red)."""
    share = max(-1.0, min(1.0, share))
    end = (202, 52, 68) if share > 0.0 else (25, 95, 160)
    mixed = (round(244 + (each - 244) * abs(share) ** 0.7) for each in end)
    return "#" + "".join(f"{each:02x}" for each in mixed)


def _picture(of: Chart | Map, across: Scale, up: Scale, inside: str) -> str:
    wide, high, middle = of.width, of.full_height, 0.5 * (of.head + of.full_height - _BOTTOM)
    title = "".join(
        f'<text x="{_LEFT:.0f}" y="{16.0 + k * _LINE:.0f}" class="title">{escape(line)}</text>'
        for k, line in enumerate(wrapped(of.title, wide))
    )
    return (
        f'<svg viewBox="0 0 {wide:.0f} {high:.0f}" width="{wide:.0f}" height="{high:.0f}" role="img">'
        f"{title}{''.join(_grid(across, up))}{inside}"
        f'<text x="{0.5 * (_LEFT + wide - _RIGHT):.0f}" y="{high - 6:.0f}" class="label" '
        f'text-anchor="middle">{escape(of.x_label)}</text>'
        f'<text transform="translate(12 {middle:.0f}) rotate(-90)" class="label" '
        f'text-anchor="middle">{escape(of.y_label)}</text></svg>'
    )


def _grid(across: Scale, up: Scale) -> Iterator[str]:
    for tick, x in _placed(across):
        yield f'<path d="M{x:.1f} {up.start:.0f}V{up.end:.0f}" class="grid"/>'
        yield f'<text x="{x:.1f}" y="{up.start + 13:.0f}" class="tick" text-anchor="middle">{tick:g}</text>'
    for tick, y in _placed(up):
        yield f'<path d="M{across.start:.0f} {y:.1f}H{across.end:.0f}" class="grid"/>'
        at = f'x="{across.start - 4:.0f}" y="{y + 3:.1f}"'
        yield f'<text {at} class="tick" text-anchor="end">{tick:g}</text>'


def _placed(scale: Scale) -> Iterable[tuple[float, float]]:
    ticks = scale.ticks()
    return zip(ticks, scale.pixels(np.array(ticks)).tolist(), strict=True)


def _drawn(curve: Curve, across: Scale, up: Scale) -> str:
    x, y = across.pixels(curve.x), up.pixels(curve.y)
    if curve.to is not None:
        outline = "".join(_outlines(x, y, up.pixels(curve.to)))
        return f'<path d="{outline}" fill="{curve.colour}" fill-opacity="0.15" stroke="none"/>'
    if curve.dots:
        kept = np.isfinite(x) & np.isfinite(y)
        dots = zip(x[kept].tolist(), y[kept].tolist(), strict=True)
        return "".join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.2" fill="{curve.colour}"/>' for a, b in dots)
    x, y = thinned(x, y)
    return (
        f'<path d="{_path(x, y)}" fill="none" stroke="{curve.colour}" stroke-width="{curve.width}" '
        f'stroke-dasharray="{curve.dash}" stroke-linejoin="round"/>'
    )


def _outlines(x: Array, y: Array, back: Array) -> Iterator[str]:
    """Of a band, one for each stretch without a gap."""
    kept = np.isfinite(x) & np.isfinite(y) & np.isfinite(back)
    for rows in np.split(np.arange(len(x)), np.flatnonzero(np.diff(kept)) + 1):
        if kept[rows[0]]:
            yield _path(np.r_[x[rows], x[rows][::-1]], np.r_[y[rows], back[rows][::-1]]) + "Z"


def thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """A dense line by the lowest and highest point of each column, in their order; a short one as it is."""
    if len(x) <= 3 * _COLUMNS:
        return x, y
    edges = np.linspace(0, len(x), _COLUMNS + 1).astype(np.intp)
    rows = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        piece = y[first:last]
        if np.isfinite(piece).any():
            rows += sorted({first + int(np.nanargmin(piece)), first + int(np.nanargmax(piece))})
    return x[rows], y[rows]


def _path(x: Array, y: Array) -> str:
    """Broken where a value is missing."""
    parts, pen = [], "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if np.isnan(a) or np.isnan(b):
            pen = "M"
            continue
        parts.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L"
    return "".join(parts)
