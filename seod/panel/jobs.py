"""Work that takes long, as processes of the lowest priority: a diagnosis, a frequency response.

It runs the command that a person would (`seod diagnose`, `seod response`), which tells how far it is.
"""

from __future__ import annotations

import asyncio
import contextlib
import csv
import itertools
import json
import math
import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from seod.terminal.progress import PROGRESS_FD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.panel.history import AxisHistory
    from seod.panel.panel import Panel
    from seod.panel.sessions import Session

KEPT: Final = 8
"""Jobs whose answers are kept."""
MOST: Final = 2
"""Jobs at a time."""
LEAST: Final = 200
"""Samples that a diagnosis needs at least."""
LOWEST: Final = 19
ORDINARY: Final = 0
"""For what listens to the rig meanwhile."""
FILES: Final = ("report.html", "diagnosis.json", "extended.yaml")
"""What a diagnosis leaves for the page."""
SAID_BYTES: Final = 4000
"""Of what a job says of its failure."""


class JobError(Exception):
    """A job cannot be done; the message says why."""


class Asked(BaseModel):
    """What the page asks for: `diagnose` (of the last seconds, or of a recording), or `response`."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    kind: Literal["diagnose", "response"]
    axis: str
    seconds: Annotated[float, Field(ge=2, le=60)] = 20.0
    recording: str | None = None
    effort: Literal["quick", "normal", "thorough"] = "quick"
    input: Literal["multisine", "sine"] = "multisine"
    amplitude: Annotated[str, Field(pattern=r"^([0-9.][0-9.eE+-]{0,11})?$")] = ""


class Job:
    """One job, under way or done."""

    def __init__(self, folder: Path, command: Sequence[str], environment: dict[str, str], nice: int) -> None:
        self.folder = folder
        self._nice = nice
        self._command, self._environment = command, environment
        self._begun = time.monotonic()
        self._seconds: float | None = None
        self._progress: dict[str, Any] = {}
        self._process: asyncio.subprocess.Process | None = None
        self.answer: Any = None
        self.error = ""
        self.task = asyncio.create_task(self._run())

    @property
    def running(self) -> bool:
        """Whether it is under way."""
        return self._seconds is None

    async def _run(self) -> None:
        ours, theirs = os.pipe()
        try:
            self._process = await asyncio.create_subprocess_exec(
                *self._command,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                pass_fds=(theirs,),
                env={
                    **os.environ,
                    **self._environment,
                    PROGRESS_FD: str(theirs),
                    "OPENBLAS_NUM_THREADS": "1",
                },
                start_new_session=True,
            )
            with contextlib.suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, self._process.pid, self._nice)
        finally:
            os.close(theirs)
        reader = asyncio.create_task(self._read_progress(ours))
        try:
            out, said = await self._process.communicate()
            self._end(out, said)
        finally:
            if self._process.returncode is None:
                self.cancel()
                await self._process.wait()
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)
            self._seconds = time.monotonic() - self._begun

    def _end(self, out: bytes, said: bytes) -> None:
        words = said.decode(errors="replace").strip()[-SAID_BYTES:]
        if self._process is None or self._process.returncode != 0:
            self.error = words or "it was cancelled"
            return
        try:
            self.answer = json.loads(out)
        except ValueError:
            self.error = words or "it gave no answer"

    async def _read_progress(self, fd: int) -> None:
        with os.fdopen(fd, "rb", buffering=0) as pipe:
            reader = asyncio.StreamReader()
            loop = asyncio.get_running_loop()
            transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), pipe)
            try:
                while line := await reader.readline():
                    self._progress = json.loads(line)
            finally:
                transport.close()

    def cancel(self) -> None:
        """End it: what it drives comes to rest, as after ctrl-C."""
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGTERM)

    def state(self) -> dict[str, Any]:
        """For the page."""
        seconds = time.monotonic() - self._begun if self._seconds is None else self._seconds
        state = "running" if self.running else "failed" if self.error else "done"
        files = [name for name in FILES if (self.folder / name).is_file()]
        told = {"state": state, "seconds": seconds, "files": files, **self._progress}
        return told | {"answer": self.answer, "error": self.error}


class Jobs:
    """All jobs of the panel.

    Args:
        panel: Whose rows are diagnosed.
    """

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._numbers = itertools.count(1)
        self._jobs: dict[int, Job] = {}

    def find(self, number: int) -> Job | None:
        """One of them."""
        return self._jobs.get(number)

    def begin(self, asked: Asked, session: Session, recording: Path | None) -> int:
        """Start a job; returns its number.

        Raises:
            JobError: There is nothing to work on, or too much is under way.
        """
        if sum(job.running for job in self._jobs.values()) >= MOST:
            raise JobError(f"{MOST} jobs are under way: cancel one, or wait")
        if asked.kind == "response":
            self._check_commander(session)
        history = self._panel.histories.get(asked.axis)
        if history is None:
            raise JobError(f"no axis {asked.axis[:40]!r}")
        folder = Path(tempfile.mkdtemp(prefix="seod-job-"))
        try:
            command = self._command(asked, history, folder, recording)
        except JobError:
            shutil.rmtree(folder)
            raise
        token = {} if session.token is None else {"SEOD_TOKEN": session.token}
        number = next(self._numbers)
        self._jobs[number] = Job(folder, command, token, ORDINARY if asked.kind == "response" else LOWEST)
        self._forget_oldest()
        return number

    def _check_commander(self, session: Session) -> None:
        if not session.command:
            raise JobError("a frequency response needs the right to command")
        now = self._panel.commander.now
        if now is not None and now.session is not session:
            raise JobError(f"{now.name} commands at present: take over first")

    def _command(self, asked: Asked, history: AxisHistory, folder: Path, recording: Path | None) -> list[str]:
        seod, rig = [sys.executable, "-m", "seod.cli"], str(self._panel.rig_file)
        if asked.kind == "response":
            more = ["--amplitude", asked.amplitude] if asked.amplitude else []
            return [
                *seod,
                "response",
                "--config",
                rig,
                "--axis",
                asked.axis,
                "--kind",
                asked.input,
                *more,
                "--json",
            ]
        data, more = recording, ["--axis", asked.axis]
        if data is None:
            data, more = folder / "rows.csv", []
            write_rows(data, history, asked.seconds)
        more += ["--config", rig] if len(self._panel.config.axes) == 1 or recording is not None else []
        axis = self._panel.config.axes[asked.axis]
        more += ["--output", axis.mode, "--units", f"y={axis.measured_unit}"]
        return [*seod, "diagnose", str(data), *more, "--out", str(folder), "--effort", asked.effort, "--json"]

    def _forget_oldest(self) -> None:
        for number in list(self._jobs)[: max(0, len(self._jobs) - KEPT)]:
            if not self._jobs[number].running:
                shutil.rmtree(self._jobs.pop(number).folder, ignore_errors=True)

    async def close(self) -> None:
        """End what is under way, and leave no files."""
        for job in self._jobs.values():
            job.cancel()
            job.task.cancel()
        await asyncio.gather(*(job.task for job in self._jobs.values()), return_exceptions=True)
        for job in self._jobs.values():
            shutil.rmtree(job.folder, ignore_errors=True)


def write_rows(path: Path, history: AxisHistory, seconds: float) -> None:
    """The last seconds of an axis as CSV; a tick without a sample has no y.

    Raises:
        JobError: There are too few.
    """
    begin = int(np.searchsorted(history.time, history.newest_t - seconds))
    fresh = history.fresh[begin:]
    if np.count_nonzero(fresh) < LEAST:
        raise JobError(f"fewer than {LEAST} samples came in the last {seconds:g} s: a diagnosis needs more")
    begin += int(np.argmax(fresh))
    fresh, tick = history.fresh[begin:], history.time[begin:]
    columns = {
        name: history.field(name)[begin:].copy() for name in ("t", "u", "y", "t_u", "ps", "temperature")
    }
    newest = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
    columns["t"] = columns["t"][newest] + tick - tick[newest]
    columns["y"][~fresh] = np.nan
    used = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(used)
        cells = ([_cell(value) for value in values.tolist()] for values in used.values())
        writer.writerows(zip(*cells, strict=True))


def _cell(value: float) -> float | str:
    return value if math.isfinite(value) else ""
