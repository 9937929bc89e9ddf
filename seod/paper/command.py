"""`seod paper`: computes the figures in several processes; writes pictures, numbers and one page."""

from __future__ import annotations

import json
from html import escape
from typing import TYPE_CHECKING, Any, Final

from seod.batch.door import LOCAL, door
from seod.batch.executor import Failed, StoppedError, completed
from seod.batch.processes import Processes
from seod.paper.words import SAYS, TITLES, shows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from seod.batch.executor import Executor

Numbers = dict[str, Any]

WEIGHTS: Final = {
    "amplitude": 8,
    "13": 8,
    "14": 6,
    "exponent": 5,
    "11": 5,
    "12": 5,
    "15": 5,
    "4": 2,
    "10": 1,
}
"""What each costs, longest first; for the order and the bar."""
WORKERS: Final = 2

STYLE: Final = (
    "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}"
    "img{max-width:100%}h2{border-top:1px solid #ccc;padding-top:1em}"
    "dt{font-weight:bold}table{border-collapse:collapse}td,th{padding:.15em .8em;text-align:right}"
    "th:first-child,td:first-child{text-align:left}tr:nth-child(even){background:#f4f4f4}"
)


BEGINS: Final = (
    "<p>Ichiyanagi and Nishiumi identify three hydraulic rigs by their self-excited oscillation. Here the "
    "rigs are simulated physically (<code>configs/*-hydraulic.yaml</code>), and the daemon's own loop and "
    "estimators run on them, 2000 times a second as in the paper. Figures are compared by what the paper "
    "prints and says; points that it does not print are not drawn.</p>"
    "<p>Bands and bars are 95 % intervals as each method states them; the paper's own procedure "
    "(<code>peaks</code>) states none.</p>"
)


def compute(figure: str) -> Numbers:
    """The numbers of one figure."""
    from seod.paper import figures, findings  # noqa: PLC0415 - numba, and only in the workers

    if figure == "exponent":
        found = findings.exponents()
    elif figure == "amplitude":
        found = findings.amplitude()
    else:
        found = getattr(figures, f"figure_{figure}")()
    kept: Numbers = figures.kept(found)
    return kept


def executor(scheduler: str = LOCAL, workers: int | None = None) -> Executor:
    """Who computes: processes of this machine, this one alone (0 workers), or a scheduler's workers.

    Raises:
        ValueError, ImportError: As of `seod.batch.door.door`.
    """
    if scheduler == LOCAL and workers != 0:
        return Processes(workers or WORKERS)
    return door(scheduler, workers)


def compute_all(
    chosen: Sequence[str], show: Callable[[str, float], None], by: Executor
) -> dict[str, Numbers]:
    """The numbers of these figures; `show` takes what has just come and how far all is.

    Raises:
        StoppedError: A figure could not be computed, or whoever computes has gone.
    """
    order = [name for name in WEIGHTS if name in chosen]
    whole, done, found = sum(WEIGHTS[name] for name in order), 0, dict[str, Numbers]()
    show(f"{len(order)} figures", 0.0)
    with by:
        for name, numbers in completed(by, compute, order):
            if isinstance(numbers, Failed):
                raise StoppedError(f"figure {name}: {numbers.why}")
            found[name] = numbers
            done += WEIGHTS[name]
            show(TITLES[name].partition(":")[0], done / whole)
    return {name: found[name] for name in TITLES if name in found}


def write(found: dict[str, Numbers], out: Path) -> list[Path]:
    """Pictures, `paper.json` and `paper.html` into a folder; returns what was written."""
    from seod.paper.pictures import PICTURES, save  # noqa: PLC0415 - matplotlib

    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, numbers in found.items():
        draw, size = PICTURES[name]
        save(numbers, draw, size, out / file_name(name))
        written += [out / f"{file_name(name)}.svg", out / f"{file_name(name)}.png"]
    numbers_file, page_file = out / "paper.json", out / "paper.html"
    numbers_file.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n")
    page_file.write_text(page(found))
    return [*written, numbers_file, page_file]


def file_name(figure: str) -> str:
    """Of a figure's pictures, without ending."""
    return f"figure-{figure}"


def page(found: dict[str, Numbers]) -> str:
    """One page on all figures, beside whose pictures it lies."""
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>The paper's figures on simulated rigs</title><style>{STYLE}</style></head><body>",
        "<h1>The paper's figures on simulated rigs</h1>",
        BEGINS,
    ]
    for name, numbers in found.items():
        ours = "".join(f"<p>{escape(sentence)}</p>" for sentence in shows(name, numbers))
        parts.append(
            f"<h2 id='figure-{name}'>{escape(TITLES[name])}</h2>"
            f"<dl><dt>The paper</dt><dd><p>{escape(SAYS[name])}</p></dd><dt>Our rig</dt><dd>{ours}</dd></dl>"
            f"<img src='{file_name(name)}.svg' alt='{escape(TITLES[name])}'>{_table(name, numbers)}"
        )
    return "\n".join([*parts, "</body></html>\n"])


def _table(name: str, n: Numbers) -> str:
    """Figures in numbers, where a table says more than a picture."""
    if name == "14":
        return "".join(_points(axis, n[axis]) for axis in ("pitch", "roll"))
    if name == "13":
        return "".join(_points(f"{speed} rad/s", each) for speed, each in n.items())
    if name == "exponent":
        rows = [
            [row["mechanism"], *(_number(row[key]) for key in ("small_signal", "exact_small", "exact"))]
            for row in n["rows"]
        ]
        return _html(["exponent of omega_n", "small signals", f"{n['small']:g} V", f"{n['large']:g} V"], rows)
    return ""


def _points(title: str, n: Numbers) -> str:
    rows = [
        [
            method.replace("_", " "),
            *(_with(each, key) for key in ("zeta", "omega_n", "K_L")),
            each.get("quality", ""),
        ]
        for method, each in n.items()
        if isinstance(each, dict)
    ]
    return _html([title, "zeta", "omega_n [rad/s]", "K_L [rad/s/V]", "quality"], rows)


def _with(each: Numbers, key: str) -> str:
    wide = each.get(f"{key}_95")
    return _number(each.get(key)) + (f" ± {wide:.2g}" if wide else "")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{round(value, 12) + 0.0:.4g}"


def _html(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    line = "".join(f"<th>{escape(each)}</th>" for each in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(each)}</td>' for each in row)}</tr>" for row in rows)
    return f"<table><tr>{line}</tr>{body}</table>"
