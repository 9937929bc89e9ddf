"""Pages that people keep: one file, no scripts, nothing from outside, light or dark, fit to be printed."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def whole(title: str, body: str) -> str:
    """A page of its own.

    Args:
        title: Plain text.
        body: HTML.
    """
    style = (Path(__file__).parent / "page.css").read_text("utf-8")
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style>"
        f"</head><body>{body}</body></html>\n"
    )


def facts(told: Sequence[tuple[str, str]]) -> str:
    """Names and texts, a line each, as HTML."""
    lines = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in told)
    return f"<dl>{lines}</dl>" if lines else ""


def table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """HTML of cells that are escaped already; `kind` is its class in the page's style."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    parts = f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody>"
    return f'<div class="scroll"><table class="{kind}">{parts}</table></div>'
