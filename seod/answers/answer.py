"""The base class of all answers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Answer(ABC):
    """An answer to a question about a rig or a recording.

    `print(answer)` and a notebook show `summary()`; a notebook shows the picture as well.
    """

    @abstractmethod
    def summary(self) -> str:
        """The answer as text, as the command prints it."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The answer as the command's `--json` prints it: JSON-able; what is undefined is None."""

    @abstractmethod
    def plot(self) -> Figure:
        """A picture of it, a figure of matplotlib."""

    @abstractmethod
    def to_columns(self) -> dict[str, Any]:
        """What `to_frame` shows: columns of one length, by name."""

    def to_frame(self) -> pd.DataFrame:
        """The answer as a table of pandas.

        Raises:
            ImportError: pandas is not installed; `to_columns()` has the same.
        """
        try:
            import pandas as pd  # noqa: PLC0415 - optional
        except ImportError as error:
            raise ImportError(
                "to_frame() needs pandas: pip install 'seod[notebook]'; to_columns() does without"
            ) from error
        return pd.DataFrame(self.to_columns())

    def to_html(self) -> str:
        """A page of its own: one file, no scripts, nothing from outside."""
        style = (Path(__file__).parent / "page.css").read_text("utf-8")
        title = escape(self.title)
        return (
            f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
            f"<style>{style}</style></head><body><h1>{title}</h1>{self._repr_html_()}</body></html>\n"
        )

    @property
    def title(self) -> str:
        """Of the page."""
        return type(self).__name__

    def _repr_html_(self) -> str:
        from seod.plots.style import style, svg  # noqa: PLC0415 - matplotlib

        text = f"<pre>{escape(self.summary())}</pre>"
        if not self.drawable:
            return text
        with style():
            return f"{text}<div>{svg(self.plot())}</div>"

    @property
    def drawable(self) -> bool:
        """Whether there is anything to draw."""
        return True

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        first = self.summary().partition("\n")[0]
        return f"<{type(self).__name__}: {first}>"
