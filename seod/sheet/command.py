"""`seod report`: reads what there is, makes the sheet, writes its page."""

from __future__ import annotations

from collections import defaultdict
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from seod.sheet.files import check_name, write
from seod.sheet.limits import parse_limit
from seod.sheet.response import read_response
from seod.sheet.rig import of_file, of_recording
from seod.sheet.segments import Period, SheetError, of_period, read
from seod.sheet.sheet import Asked, made_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.sheet.response import Measured
    from seod.sheet.segments import Segment
    from seod.sheet.sheet import Sheet


class Options(NamedTuple):
    """Of the command, as they are written."""

    rig: str
    since: str
    until: str
    archive: str
    config: Path | None
    responses: Sequence[str]
    reference: str
    limits: Sequence[str]
    out: Path | None


def make(options: Options) -> Sheet:
    """The sheet, written where that is asked for.

    Raises:
        SheetError, ConfigErrors, ValueError: An option is wrong, or there is nothing to tell.
        OSError: A file cannot be read or written.
    """
    if options.out is not None:
        check_name(options.out)
    period = Period(_day("--since", options.since), _day("--until", options.until))
    if period.first and period.last and period.first > period.last:
        raise SheetError(f"--until {period.last}: is before --since {period.first}")
    reference = _span("--reference", options.reference)
    asked = Asked(
        options.rig, options.archive, period, reference, [parse_limit(each) for each in options.limits]
    )
    found = read(options.archive, options.rig)
    rig = of_recording(options.archive, of_period(found, period))
    if options.config is not None:
        rig = of_file(options.config, options.rig)
    sheet = made_of(asked, found, rig, _responses(options.responses, found))
    if options.out is not None:
        from seod.sheet.page import page  # noqa: PLC0415 - matplotlib

        write(page(sheet), options.out)
    return sheet


def _day(option: str, text: str) -> date | None:
    """A day; None where none is told.

    Raises:
        SheetError: It is none.
    """
    if not text:
        return None
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise SheetError(f"{option} {text}: is no day; one is written as 2026-11-01") from error


def _span(option: str, text: str) -> Period | None:
    """`2026-11-01:2026-11-07`, or one day; None where none is told."""
    if not text:
        return None
    first, _, last = text.partition(":")
    span = Period(_day(option, first), _day(option, last or first))
    if span.first and span.last and span.first > span.last:
        raise SheetError(f"{option} {text}: its last day is before its first")
    return span


def _responses(told: Sequence[str], found: Sequence[Segment]) -> dict[str, list[Measured]]:
    """By axis; a file without one is of the only axis.

    Raises:
        SheetError: There are several axes, or a file is no response.
    """
    axes = sorted({each.axis for each in found})
    by_axis: dict[str, list[Measured]] = defaultdict(list)
    for each in told:
        axis, equals, name = each.partition("=")
        if not equals or Path(each).exists():
            if len(axes) != 1:
                which = f"of which axis? write {axes[0]}={each}; there are {', '.join(axes)}"
                raise SheetError(f"--response {each}: {which}")
            axis, name = axes[0], each
        by_axis[axis].append(read_response(Path(name)))
    return dict(by_axis)
