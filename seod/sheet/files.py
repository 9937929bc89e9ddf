"""The sheet as a file: HTML, or PDF by WeasyPrint; all at once or not at all."""

from __future__ import annotations

import os
import re
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Final

from seod.files.user_files import named
from seod.plots.style import MEASURED
from seod.sheet.segments import SheetError

ENDINGS: Final = (".html", ".pdf")
_VARIABLE: Final = re.compile(r"var\(--[a-z]+, (#[0-9a-f]{6})\)")
"""A colour of a picture that follows the page, with the one that it is without a page."""


def check_name(to: Path) -> None:
    """Refuse a file's name before any work is done.

    Raises:
        SheetError: It ends in none of `ENDINGS`, or its folder is not there.
    """
    if to.suffix.lower() not in ENDINGS:
        raise SheetError(f"--out {to}: the name must end in {' or '.join(ENDINGS)}")
    if not to.parent.is_dir():
        raise SheetError(f"--out {to}: there is no folder {to.parent}")
    if to.suffix.lower() == ".pdf":
        _weasyprint()


def write(page: str, to: Path) -> None:
    """Write the page as the ending of its name says.

    Raises:
        SheetError: WeasyPrint is not installed.
        OSError: It cannot be written; what was there stays.
    """
    content = pdf(page) if to.suffix.lower() == ".pdf" else page.encode()
    descriptor, name = tempfile.mkstemp(dir=to.parent, prefix=f".{to.name}.")
    part = Path(name)
    try:
        with named(to, part), os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        part.chmod(0o644)
        with named(to, part):
            part.replace(to)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def pdf(page: str) -> bytes:
    """The page as PDF: the same bytes for the same page.

    Raises:
        SheetError: WeasyPrint is not installed.
    """
    html = _weasyprint()
    plain = _VARIABLE.sub(r"\1", page).replace("currentColor", MEASURED)  # which its SVG does not know
    made = html(string=plain).write_pdf(pdf_identifier=b"seod-sheet")
    assert isinstance(made, bytes)  # noqa: S101 - without a target it is returned
    return made


def _weasyprint() -> type:
    try:
        html: type = import_module("weasyprint").HTML  # optional, heavy, and without types
    except (ImportError, OSError) as error:  # OSError: without Pango
        why = "" if isinstance(error, ImportError) else f" ({error})"
        what = f"a PDF needs WeasyPrint: pip install 'seod[pdf]'{why}"
        raise SheetError(f"{what}; without it: --out FILE.html") from error
    return html
