"""Reports of the diagnosis beside recordings: whose they are, and what they say.

`run.mcap` is told of by `run.diagnosis.json` (`seod diagnose run.mcap --json > run.diagnosis.json`) or
`run/diagnosis.json` (`seod diagnose run.mcap --out run`); one of its axes by `run.AXIS.diagnosis.json`.
"""

from __future__ import annotations

import json
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from seod.archive.store import stem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.archive.store import Known, Store

ENDING: Final = "diagnosis.json"


class Report(NamedTuple):
    """A report and its axis; None: all axes of the recording."""

    axis: str | None
    file: Known


def by_recording(files: Sequence[Known]) -> dict[str, list[Report]]:
    """Reports by the stem of the recording that they may be of, in the order of their names."""
    found: dict[str, list[Report]] = defaultdict(list)
    for file in files:
        about = file.name.removesuffix(ENDING).rstrip("./")
        found[about].append(Report(None, file))
        of_axis, dot, axis = about.rpartition(".")
        if dot and "/" not in axis:
            found[of_axis].append(Report(axis, file))
    return found


def name_of(recording: str, axis: str | None) -> str:
    """What a report that is made here is called."""
    return ".".join([stem(recording), *([axis] if axis else []), ENDING])


def add(rows: Sequence[dict[str, Any]], reports: Sequence[Report], store: Store) -> None:
    """Write verdict and causes of the reports into the rows of one recording, those of an axis last."""
    for report in sorted(reports, key=lambda each: each.axis is not None):
        own = [row for row in rows if row.get("axis") and report.axis in (None, row["axis"])]
        if own:
            said = _said(report, store)
            for row in own:
                _write(row, said)


def _write(row: dict[str, Any], said: dict[str, str]) -> None:
    problem = said.get("problem")
    if problem:
        row["problem"] = "; ".join([*([row["problem"]] if row.get("problem") else []), problem])
    else:
        row.update(said)


def _said(report: Report, store: Store) -> dict[str, str]:
    """`verdict` and `causes` as columns, or `problem`."""
    try:
        told = json.loads(store.read(report.file.name))
        causes = [{"name": each["name"], "parameters": each["parameters"]} for each in told["effects"]]
        return {"verdict": str(told["verdict"]), "causes": json.dumps(causes)}
    except (OSError, ValueError, RecursionError, KeyError, TypeError) as error:
        return {"problem": f"{report.file.name}: is no report of `seod diagnose` ({type(error).__name__})"}
