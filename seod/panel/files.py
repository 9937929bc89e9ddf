"""Recordings and the rig file over HTTP, and jobs on them."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import html
import json
import os
import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError
from starlette.responses import FileResponse, JSONResponse, Response

from seod.config.errors import ConfigErrors
from seod.config.load import load_rig
from seod.config.redact import redacted, secrets
from seod.config.schema import rig_schema
from seod.config.tokens import is_filled
from seod.data.recording import read
from seod.data.source import ReadError
from seod.panel.jobs import FILES, Asked, JobError, Jobs

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.requests import Request

    from seod.data.recording import Recording
    from seod.panel.panel import Panel
    from seod.panel.sessions import Session

BODY_BYTES: Final = 1 << 20
SHOWN_ROWS: Final = 200_000
"""Rows of a recording that a page gets to replay."""
SUFFIXES: Final = (".mcap", ".csv", ".gz", ".parquet", ".mat", ".mf4")
REPORT_POLICY: Final = "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-hashes' {styles}"
"""Of a report: a page of nobody, without scripts, whose own styles are named by their hashes."""
_STYLES: Final = re.compile(r"<style>(.*?)</style>|style=\"([^\"]*)\"", re.DOTALL)


class Files:
    """Answers requests about files and jobs.

    Args:
        panel: What the clients share.
        who: Tells the session of a request, if it may read.
        is_ours: Whether a request that changes something comes from our page in that session.
    """

    def __init__(
        self,
        panel: Panel,
        who: Callable[[Request], Session | None],
        is_ours: Callable[[Request, Session], bool],
    ) -> None:
        self._panel, self._who, self._is_ours = panel, who, is_ours
        self.jobs = Jobs(panel)

    # ---- recordings

    def _folder(self) -> Path | None:
        folder = self._panel.config.record.folder
        return None if folder is None else self._panel.rig_file.parent / folder

    def _recording(self, name: str) -> Path | None:
        """A recording by its name; None if there is none, or it is not in the folder."""
        folder = self._folder()
        if folder is None or "/" in name or name.startswith(".") or not name.endswith(SUFFIXES):
            return None
        path = folder / name
        return path if path.is_file() and not path.is_symlink() else None

    async def recordings(self, request: Request) -> Response:
        """What there is, newest first."""
        if self._who(request) is None:
            return refused()
        folder = self._folder()
        if folder is None:
            return JSONResponse({"error": "the rig file names no folder for recordings: set record.folder"})
        paths = list(folder.iterdir()) if folder.is_dir() else []
        found = [(path, path.stat()) for path in paths if self._recording(path.name) is not None]
        found.sort(key=lambda each: -each[1].st_mtime)
        told = [{"name": path.name, "bytes": stat.st_size, "changed": stat.st_mtime} for path, stat in found]
        return JSONResponse({"recordings": told})

    async def recording(self, request: Request) -> Response:
        """One of them, to keep."""
        path = self._recording(request.path_params["name"])
        if self._who(request) is None:
            return refused()
        if path is None:
            return JSONResponse({"error": "no such recording"}, 404)
        return FileResponse(path, filename=path.name, media_type="application/octet-stream")

    async def rows(self, request: Request) -> Response:
        """Its rows, to replay on the page: t from 0 [s], y and u in SI."""
        path = self._recording(request.path_params["name"])
        if self._who(request) is None:
            return refused()
        if path is None:
            return JSONResponse({"error": "no such recording"}, 404)
        axis = request.query_params.get("axis")
        try:
            found = await asyncio.to_thread(read, path, axis=axis, of_rig=True)
        except ReadError as error:
            return JSONResponse({"error": str(error)}, 422)
        return JSONResponse(shown(found))

    # ---- jobs

    async def begin_job(self, request: Request) -> Response:
        """Start one; one that drives the rig needs the right to command, and to be the commander."""
        session = self._who(request)
        if session is None or not self._is_ours(request, session):
            return refused()
        try:
            asked = Asked.model_validate_json(await whole_body(request))
            number = self.jobs.begin(asked, session, self._asked_recording(asked))
        except ValidationError as error:
            return JSONResponse({"error": "; ".join(each["msg"] for each in error.errors())}, 422)
        except JobError as error:
            return JSONResponse({"error": str(error)}, 409)
        return JSONResponse({"job": number})

    def _asked_recording(self, asked: Asked) -> Path | None:
        """The recording that a job is about.

        Raises:
            JobError: There is none of that name.
        """
        recording = None if asked.recording is None else self._recording(asked.recording)
        if asked.recording is not None and recording is None:
            raise JobError("no such recording")
        return recording

    async def job(self, request: Request) -> Response:
        """How far it is, or its answer."""
        job = self.jobs.find(request.path_params["number"])
        if self._who(request) is None:
            return refused()
        return JSONResponse({"error": "no such job"}, 404) if job is None else JSONResponse(job.state())

    async def cancel_job(self, request: Request) -> Response:
        """End it."""
        session = self._who(request)
        if session is None or not self._is_ours(request, session):
            return refused()
        job = self.jobs.find(request.path_params["number"])
        if job is not None:
            job.cancel()
        return JSONResponse({"ok": job is not None})

    async def job_file(self, request: Request) -> Response:
        """What it has left: the report to look at, the rest to keep."""
        job, name = self.jobs.find(request.path_params["number"]), request.path_params["name"]
        if self._who(request) is None:
            return refused()
        if job is None or name not in FILES or not (job.folder / name).is_file():
            return JSONResponse({"error": "no such file"}, 404)
        if name == "report.html":
            text = (job.folder / name).read_text()
            policy = REPORT_POLICY.format(styles=" ".join(style_hashes(text)))
            return Response(text, media_type="text/html", headers={"content-security-policy": policy})
        return FileResponse(job.folder / name, filename=name, media_type="application/octet-stream")

    # ---- the rig file

    async def rig_file(self, request: Request) -> Response:
        """Its text without tokens, its schema, and a stamp of what was read."""
        if self._who(request) is None:
            return refused()
        try:
            text = self._panel.rig_file.read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            return JSONResponse({"error": f"{self._panel.rig_file}: {error}"}, 500)
        told = {"path": str(self._panel.rig_file), "text": redacted(text), "stamp": stamp_of(text)}
        return JSONResponse({**told, "schema": rig_schema()})

    async def check_rig(self, request: Request) -> Response:
        """What is wrong with a text as a rig file."""
        session = self._who(request)
        if session is None or not self._is_ours(request, session):
            return refused()
        asked = await json_body(request)
        if not isinstance(asked.get("text"), str):
            return JSONResponse({"error": "text: required"}, 422)
        return JSONResponse({"errors": await asyncio.to_thread(self._checked, asked["text"])})

    async def save_rig(self, request: Request) -> Response:
        """Replace the rig file, if the text is right and nobody else has changed it meanwhile."""
        session = self._who(request)
        if session is None or not session.command or not self._is_ours(request, session):
            return refused()
        asked = await json_body(request)
        path = self._panel.rig_file
        now = path.read_text("utf-8-sig")
        if not isinstance(asked.get("text"), str) or asked.get("stamp") != stamp_of(now):
            return JSONResponse({"error": "the file was changed meanwhile: load it again"}, 409)
        text = with_secrets(asked["text"], now)
        errors = await asyncio.to_thread(self._checked, text)
        if errors:
            return JSONResponse({"errors": errors})
        replace_text(path, text)
        return JSONResponse({"errors": [], "stamp": stamp_of(text)})

    def _checked(self, text: str) -> list[str]:
        """Read it as the daemon would, from the rig file's own folder, for it names files beside it."""
        path = self._panel.rig_file
        text = with_secrets(text, path.read_text("utf-8-sig"))
        with tempfile.NamedTemporaryFile("w", suffix=".yaml", dir=path.parent, prefix=".check-") as file:
            file.write(text)
            file.flush()
            try:
                load_rig(Path(file.name))
            except ConfigErrors as errors:
                return [str(each).replace(file.name, path.name) for each in errors.errors]
        return []


def refused() -> Response:
    """Who asks may not."""
    return JSONResponse({"error": "log in with a token that may do this, from the panel's own page"}, 403)


def shown(recording: Recording) -> dict[str, Any]:
    """Rows of a recording for the page; a long one is cut off."""
    cut = slice(0, SHOWN_ROWS)
    t, y, u = recording.t[cut], recording.y[cut], recording.u[cut]
    start = float(t[0]) if len(t) else 0.0
    columns = {"t": t - start, "y": y, "u": u}
    return {name: [v if v == v else None for v in values.tolist()] for name, values in columns.items()}  # noqa: PLR0124 - nan


def style_hashes(page: str) -> list[str]:
    """The styles in a page, as a content security policy names them."""
    found = {html.unescape(match[1] or match[2] or "") for match in _STYLES.finditer(page)}
    digests = (hashlib.sha256(style.encode()).digest() for style in sorted(found))
    return [f"'sha256-{base64.b64encode(each).decode()}'" for each in digests]


def stamp_of(text: str) -> str:
    """Tells one text from another."""
    return hashlib.sha256(text.encode()).hexdigest()


def with_secrets(text: str, now: str) -> str:
    """A text that was shown without its tokens, with those of the file where it still has `x` for them.

    Args:
        text: As the page sends it.
        now: The file.
    """
    for secret in secrets(now):
        shown_as = redacted(now)[secret.start : secret.end]
        if is_filled(shown_as):
            text = text.replace(shown_as, now[secret.start : secret.end], 1)
    return text


def replace_text(path: Path, text: str) -> None:
    """Write a file anew, whole or not at all, with the rights it has."""
    mode = path.stat().st_mode
    with tempfile.NamedTemporaryFile("w", dir=path.parent, prefix=".new-", delete=False) as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    written = Path(file.name)
    written.chmod(mode)
    written.replace(path)


async def whole_body(request: Request) -> bytes:
    """A request's body, as far as it is not too long."""
    data = b""
    async for chunk in request.stream():
        data += chunk
        if len(data) > BODY_BYTES:
            return b""
    return data


async def json_body(request: Request) -> dict[str, Any]:
    """An object; an empty one for anything else."""
    try:
        found = json.loads(await whole_body(request))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
