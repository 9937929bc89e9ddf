"""Where recordings and catalogue are: a folder, or a prefix of an object store, by fsspec."""

from __future__ import annotations

import io
import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

from seod.archive.engines import ArchiveError, engine
from seod.files.user_files import named

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

UNFINISHED: Final = ".unfinished"
"""Ending of a file that is being written; what a killed builder left of that kind is taken away."""
IN_MEMORY: Final = 64 << 20
"""Recordings of an object store up to this size are fetched in one go [bytes]; larger ones by blocks."""
_EXTRAS: Final = {"s3": "s3"}
"""Extra that brings a protocol's library."""


class Known(NamedTuple):
    """A file of the store.

    Attributes:
        name: Relative to the store's root, with `/`.
        size: In bytes.
        stamp: Changes with the content: size with the time of change, or the store's own ETag.
    """

    name: str
    size: int
    stamp: str


class Store:
    """A folder or a URL such as `s3://bucket/prefix`, `memory://archive`.

    Raises:
        ArchiveError: Its library is missing, or there is no such folder.
    """

    def __init__(self, where: str | os.PathLike[str]) -> None:
        self.where = os.fspath(where)
        protocol, marked, rest = self.where.partition("://")
        self.is_local = not marked or protocol in ("file", "local")
        fsspec = engine("fsspec")
        if self.is_local:
            self.root = str(Path(rest if marked else self.where).absolute())
            if not Path(self.root).is_dir():
                raise ArchiveError(f"{self.where}: there is no such folder")
            self.fs: Any = fsspec.filesystem("file")
            return
        try:
            self.fs, self.root = fsspec.core.url_to_fs(self.where)
        except ImportError as error:
            extra = _EXTRAS.get(protocol)
            hint = f"pip install 'seod[{extra}]'" if extra else f"install what fsspec needs for {protocol}://"
            raise ArchiveError(f"{self.where}: {hint} ({error})") from error
        except ValueError as error:
            raise ArchiveError(f"{self.where}: {error}") from error
        self.root = self.root.rstrip("/")

    def path(self, name: str) -> str:
        """The path of a file by its name, as the file system takes it."""
        return f"{self.root}/{name}"

    def files(self, ending: str, under: str = "") -> list[Known]:
        """Files whose names end so, sorted by name; none where there is no such folder.

        Raises:
            ArchiveError: The store does not answer.
        """
        top = self.path(under) if under else self.root
        try:
            self.fs.invalidate_cache()
            found = self.fs.find(top, detail=True)
        except FileNotFoundError:
            return []
        except Exception as error:
            raise self.failed(error) from error
        known = [
            Known(self._name(path), int(info.get("size") or 0), _stamp(info)) for path, info in found.items()
        ]
        return sorted(each for each in known if each.name.endswith(ending))

    def _name(self, path: str) -> str:
        return path.replace("\\", "/").removeprefix(self.root.replace("\\", "/")).lstrip("/")

    def read(self, name: str) -> bytes:
        """The content of a file.

        Raises:
            OSError: It cannot be read.
        """
        content: bytes = self.fs.cat_file(self.path(name))
        return content

    def open(self, known: Known) -> IO[bytes]:
        """A recording, to be read from any place in it.

        Raises:
            OSError: It cannot be read.
        """
        if self.is_local:
            return Path(self.path(known.name)).open("rb")
        if known.size <= IN_MEMORY:
            return io.BytesIO(self.read(known.name))
        opened: IO[bytes] = self.fs.open(self.path(known.name), "rb")
        return opened

    def write(self, name: str, content: bytes) -> None:
        """Put a file there, whole or not at all.

        Raises:
            OSError: It cannot be written.
        """
        if not self.is_local:
            self.fs.pipe_file(self.path(name), content)
            return
        path = Path(self.path(name))
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f"{path.name}{UNFINISHED}")
        with named(path, part), part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        with named(path, part):
            part.replace(path)
        _sync_folder(path.parent)

    def remove(self, names: Sequence[str]) -> None:
        """Take files away; one that is not there is no error."""
        for name in names:
            with suppress(FileNotFoundError):
                self.fs.rm_file(self.path(name))

    def failed(self, error: Exception) -> ArchiveError:
        """What a store's library raised, as a sentence."""
        return ArchiveError(f"{self.where}: {type(error).__name__}: {error}")

    @contextmanager
    def here(self, names: Sequence[str]) -> Iterator[str]:
        """A folder of this machine in which files are by their names; of an object store copies, for a time.

        Arrow's threads read them without any Python object: one that still holds one when the interpreter
        ends aborts the process (apache/arrow#34314).

        Raises:
            ArchiveError: The store does not answer.
        """
        if self.is_local:
            yield self.root
            return
        with tempfile.TemporaryDirectory() as folder:
            if names:
                copies = [f"{folder}/{name}" for name in names]
                try:
                    self.fs.get([self.path(name) for name in names], copies)
                except Exception as error:
                    raise self.failed(error) from error
            yield folder


def _sync_folder(folder: Path) -> None:
    """Bring a rename to the disk, where the system can."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _stamp(info: Any) -> str:
    """By which a change is seen: the store's ETag; else size and time."""
    tag = info.get("ETag") or info.get("etag")
    if tag:
        return str(tag).strip('"')
    changed = next((info[key] for key in ("mtime", "LastModified", "created") if info.get(key)), "")
    return (
        f"{info.get('size')}:{changed!r}" if isinstance(changed, float) else f"{info.get('size')}:{changed}"
    )


def stem(name: str) -> str:
    """A file's name without its ending: `bench/run.mcap` -> `bench/run`."""
    return str(PurePosixPath(name).with_suffix(""))
