"""One self-contained HTML page: what is wrong, how much, why it is believed."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final

from seod.diagnose.report import checks
from seod.diagnose.report.fields import fields, planes
from seod.diagnose.report.over_time import errors, over_blocks, overlay, wholes
from seod.diagnose.report.pictures import Pictures
from seod.diagnose.report.tables import effects, figures, ranking
from seod.diagnose.report.words import consequences, headline
from seod.plots.page import facts as facts_list
from seod.plots.page import whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from seod.diagnose.result import Diagnosis

_HERE: Final = Path(__file__).parent


def page(d: Diagnosis, unit: str, sources: Sequence[str], facts: Sequence[tuple[str, str]] = ()) -> str:
    """The report.

    Args:
        d: What is told; it has windows.
        unit: Of y.
        sources: Names of the recordings.
        facts: What is known of the run, such as its date: names and texts.
    """
    body = "".join(_sections(d, unit, sources, facts))
    return whole(f"Diagnosis of {', '.join(sources)}", body)


def _sections(
    d: Diagnosis, unit: str, sources: Sequence[str], facts: Sequence[tuple[str, str]]
) -> Iterator[str]:
    pictures = Pictures(d, unit)
    yield f"<h1>What the simulation gets wrong</h1><div class='sub'>{escape(', '.join(sources))}</div>"
    yield facts_list(facts)
    yield f'<div class="verdict {d.verdict}">{escape(headline(d))}</div>'
    yield figures(d, unit)
    yield f"<ul>{''.join(f'<li>{escape(each)}</li>' for each in consequences(d, unit))}</ul>"
    if d.next_experiment is not None and d.next_experiment.command:
        yield f"<pre>{escape(d.next_experiment.command)}</pre>"
    if d.effects:
        yield f"<h2>Causes, each with all the others in the model</h2>{effects(d, unit)}"
    yield f"<h2>{'Before and after' if d.extends else 'Measured and simulated'}</h2>"
    yield f"{overlay(pictures)}{errors(pictures)}{''.join(wholes(pictures))}"
    fails = "Where it fails" if d.verdict != "clean" else "Where it would fail"
    yield f"<h2>{fails}</h2>{_pair([*fields(pictures), *planes(pictures)])}"
    left = [checks.whiteness(pictures), checks.input_left(pictures), checks.spectra(pictures)]
    left += [over_blocks(pictures), *filter(None, [checks.distortion(pictures), checks.phase(pictures)])]
    yield f"<h2>What is left, and whether it is noise</h2>{_pair(left)}"
    if d.candidates:
        yield f"<h2>All causes that were tried</h2>{ranking(d)}"
    yield f"<h2>How to read this page</h2><p class='sub'>{_text('how_to_read.txt')}</p>"


def _pair(pictures: Iterable[str]) -> str:
    return f'<div class="pair">{"".join(pictures)}</div>'


def _text(name: str) -> str:
    return (_HERE / name).read_text("utf-8")
