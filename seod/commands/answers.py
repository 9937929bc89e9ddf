"""Commands that ask the Python interface: its errors as sentences, its answers as text, JSON or a picture."""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING

from seod.commands.common import CommandError, plain_errors, show

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from seod.answers import Answer
    from seod.data import Recording


@contextmanager
def asking() -> Iterator[None]:
    """Around a question: whatever it is refused with is told on stderr, with exit status 1."""
    from seod.calibrate.procedure import CalibrationError  # noqa: PLC0415 - numerics
    from seod.data.source import ReadError  # noqa: PLC0415
    from seod.diagnose.result import DiagnoseError  # noqa: PLC0415
    from seod.identify.record import IdentifyError  # noqa: PLC0415
    from seod.respond.record import RespondError  # noqa: PLC0415

    refused = (ReadError, IdentifyError, DiagnoseError, RespondError, CalibrationError, ValueError)
    with plain_errors():
        try:
            yield
        except refused as error:
            raise CommandError(str(error)) from error


def answer(found: Answer, as_json: bool, plot: Path | None) -> None:
    """Print it, and draw it where that is asked for."""
    if plot is not None:
        from seod.plots.style import save  # noqa: PLC0415 - matplotlib

        save(found.plot(), plot)
    show(json.dumps(found.to_dict(), allow_nan=False) if as_json else found.summary())


def tell_problems(recordings: Iterable[Recording]) -> None:
    """Say on stderr what a user must know of the files before the answer is believed."""
    from seod.data.problems import tell  # noqa: PLC0415 - numpy

    for each in recordings:
        tell(each.problems)
