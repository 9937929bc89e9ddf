"""Builds the catalogue: reads what is new or has changed, and nothing twice.

Rows of each batch are brought to the disk at once (`staged`), and in the end to the files of their days. A
builder that is killed anywhere leaves a catalogue that holds, and the next one goes on where it was.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from seod.archive import live, reports
from seod.archive.days import Days
from seod.archive.engines import engine
from seod.archive.layout import FOLDER
from seod.archive.lock import NAME as LOCK
from seod.archive.lock import held
from seod.archive.staged import Staged
from seod.archive.store import UNFINISHED, Store, stem
from seod.archive.workers import Work, Workers

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence

    from seod.archive.store import Known

    Told = Callable[[str, float], None]

RECORDINGS: Final = ".mcap"
BATCH: Final = 512
"""Recordings whose rows come to the disk together: a killed builder reads so many again, at most."""
FEW: Final = 200
"""So few recordings are read by one process: others take a second to begin."""


@dataclass(frozen=True)
class Built:
    """What a build has done.

    Attributes:
        files: Recordings that are there.
        read: Of these, read now.
        gone: In the catalogue, and not there any more.
        problems: Recordings read now that could not be read whole, with the reason.
        days: Of what a fleet has told, read now.
    """

    files: int
    read: int
    gone: int
    problems: dict[str, str] = field(default_factory=dict)
    days: int = 0


def _silent(_step: str, _part: float) -> None:
    pass


def build(
    where: str | os.PathLike[str],
    workers: int = 1,
    identify: bool = True,
    told: Told = _silent,
) -> Built:
    """Bring the catalogue of an archive up to date.

    Args:
        where: A folder of recordings, or a URL such as `s3://bucket/prefix`.
        workers: Processes that read.
        identify: Whether excited segments of which the daemon recorded no estimate are identified.
        told: Called with the step, and the part of it that is done.

    Raises:
        ArchiveError: There is no such folder, another builder is at work, or a library is missing.
        OSError: The catalogue cannot be written.
    """
    engine("pyarrow")  # that it is missing is told before the work
    store = Store(where)
    with held(store) as renew:
        told("looking for recordings", 0.0)
        files = store.files("")
        _clean(store, files)
        recordings = [each for each in files if _is_recording(each.name)]
        days, staged = Days(store), Staged(store)
        present = {each.name for each in recordings}
        work = _to_do(recordings, files, days, staged)
        problems: dict[str, str] = {}
        with Workers(store, workers if len(work) >= FEW else 1, identify) as reading:
            for k in range(0, len(work), BATCH):
                told("reading recordings", k / len(work))
                rows = reading.rows(work[k : k + BATCH])
                staged.put(rows)
                problems |= {row["file"]: row["problem"] for row in rows if row.get("problem")}
                renew()
        _merge(days, staged, present, told, renew)
        told_days = live.catch_up(store, _step("reading what the fleet told", told, renew))
    known = set().union(*days.files.values())
    return Built(len(recordings), len(work), len(known - present), problems, told_days)


def _is_recording(name: str) -> bool:
    return name.endswith(RECORDINGS) and not name.startswith(f"{FOLDER}/")


def _clean(store: Store, files: Sequence[Known]) -> None:
    """Take away what a killed builder was writing."""
    left = [
        each.name for each in files if each.name.startswith(f"{FOLDER}/") and each.name.endswith(UNFINISHED)
    ]
    store.remove([name for name in left if name != LOCK])


def _to_do(recordings: Sequence[Known], files: Sequence[Known], days: Days, staged: Staged) -> list[Work]:
    """Recordings that are new or have changed, themselves or the reports beside them."""
    told_of = reports.by_recording([each for each in files if each.name.endswith(reports.ENDING)])
    known = days.stamps() | _stamps(staged.table())
    work = []
    for file in recordings:
        own = tuple(told_of.get(stem(file.name), ()))
        stamp = " ".join([file.stamp, *(each.file.stamp for each in own)])
        if known.get(file.name) != stamp:
            work.append(Work(file, stamp, own))
    return work


def _stamps(table: Any) -> dict[str, str]:
    return dict(zip(table["file"].to_pylist(), table["stamp"].to_pylist(), strict=True))


def _merge(days: Days, staged: Staged, present: set[str], told: Told, renew: Callable[[], None]) -> None:
    days.merge(staged.table(), present, _step("writing the catalogue", told, renew))
    staged.clear()


def _step(name: str, told: Told, renew: Callable[[], None]) -> Callable[[float], None]:
    def step(part: float) -> None:
        renew()
        told(name, part)

    return step
