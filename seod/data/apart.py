"""A reader in a process of its own: where a damaged file makes C code crash or go round, that ends.

Memory that the reader takes is the process' too: it starts inside the limit of `seod.files.damage.bounded`.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import resource
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from seod.data.source import ReadError
from seod.files.damage import DamagedError, library

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from multiprocessing.connection import Connection

    from seod.data.source import Block, Group, Remark, Source

PATIENCE_S = 3
"""Processor time that a reader may take, whatever the file's size: a small file takes 0.05 s ..."""
PATIENCE_S_PER_MB = 10
"""... and for each megabyte; the slowest one measured took 0.1 s."""
STILL_S = 30.0
"""A reader that has used no processor for so long is ended: a disk that is asked answers before."""
_LOOK_S = 0.5
"""How often it is looked at."""
_END_S = 1.0
"""A reader that is told to end has so long."""


class _Told(NamedTuple):
    """What the reader's process answers.

    Attributes:
        answer: A block, None at the end of blocks, or what the file holds.
        failure: What went wrong instead.
        remarks, notes: All so far.
        complaints: Of the library, since the last answer.
    """

    answer: Any
    failure: DamagedError | ReadError | None
    remarks: list[Remark]
    notes: dict[str, str]
    complaints: list[str]


class Apart:
    """A `Source` whose reader runs in another process.

    Args:
        path: The file.
        opened: Opens it, there.
        complaints: Where lines come of what the library complains of; the process begins with a copy.

    Raises:
        ReadError: As the reader says.
        DamagedError: It failed, crashed, or found no end.
    """

    def __init__(self, path: Path, opened: Callable[[], Source], complaints: list[str]) -> None:
        self.path = path
        self.remarks: list[Remark] = []
        self.notes: Mapping[str, str] = {}
        self._complaints = complaints
        patience = PATIENCE_S + PATIENCE_S_PER_MB * path.stat().st_size // 1_000_000
        context = multiprocessing.get_context("fork")  # a fresh interpreter would take 0.3 s for every file
        self._pipe, theirs = context.Pipe()
        arguments = (theirs, self._pipe, opened, complaints, patience)
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        try:
            self.format: str
            self.groups: tuple[Group, ...]
            self.format, self.groups = self._hear()
        except BaseException:
            self.close()
            raise

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`."""
        block = self._ask(dict(wanted))
        while block is not None:
            yield block
            block = self._ask(None)

    def _ask(self, wanted: dict[str, Sequence[str]] | None) -> Any:
        try:
            self._pipe.send(wanted)
        except OSError:
            raise self._death() from None
        return self._hear()

    def _hear(self) -> Any:
        try:
            self._wait()
            told: _Told = self._pipe.recv()
        except (EOFError, OSError):
            raise self._death() from None
        self.remarks += told.remarks[len(self.remarks) :]
        self.notes = told.notes
        self._complaints += told.complaints
        if told.failure is not None:
            raise told.failure
        return told.answer

    def _wait(self) -> None:
        """Until it says something.

        Raises:
            DamagedError: It stands still, as a process does that was forked while another thread held a lock.
        """
        used, still = -1, 0.0
        while not self._pipe.poll(_LOOK_S):
            before, used = used, _used_ticks(self._process.pid)
            still = still + _LOOK_S if used == before else 0.0
            if still >= STILL_S:
                self._process.kill()
                raise DamagedError(f"its reader stood still for {STILL_S:g} s; try again")

    def _death(self) -> DamagedError:
        self._process.join()
        code = self._process.exitcode or 0
        if code == -signal.SIGXCPU:
            return DamagedError("its reader found no end")
        name = signal.Signals(-code).name if code < 0 else f"status {code}"
        return DamagedError(f"the library that reads it crashed ({name})")

    def close(self) -> None:
        """Close the file, and end the process."""
        self._pipe.close()
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()


def _used_ticks(pid: int | None) -> int:
    """Processor time of a process, by the system's clock ticks; 0 where it is not told."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0
    return int(fields[11]) + int(fields[12])


def _serve(
    pipe: Connection, theirs: Connection, opened: Callable[[], Source], complaints: list[str], patience: int
) -> None:
    theirs.close()
    resource.setrlimit(resource.RLIMIT_CPU, (patience, patience + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.disable()
    complaints.clear()
    source: Source | None = None
    blocks: Iterator[Block] = iter(())
    try:
        while True:
            answer: Any = None
            failure = None
            try:
                with library(ReadError):
                    if source is None:
                        source = opened()
                        answer = source.format, source.groups
                    else:
                        answer = next(blocks, None)
            except (DamagedError, ReadError) as error:
                failure = type(error)(str(error))
            known = ([], {}) if source is None else (source.remarks, dict(source.notes))
            pipe.send(_Told(answer, failure, *known, list(complaints)))
            complaints.clear()
            wanted = pipe.recv()
            if wanted is not None and source is not None:
                blocks = source.blocks(wanted)
    except (EOFError, OSError):
        pass  # nobody listens any more
