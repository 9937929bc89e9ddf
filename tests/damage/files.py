"""Small sound files of every format that is read, by the writers of the libraries and of this program."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import can
import cantools
import numpy as np
import scipy.io
from mcap.writer import CompressionType, Writer

from seod.data.export import export
from seod.data.source import Column, Group, Table
from seod.record.csv_recorder import CsvLines, header
from seod.record.mcap_file import McapFile
from tests.unit.record_rows import about, rows, write_recording

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DBC = Path(__file__).parents[2] / "configs" / "motor.dbc"
ROWS = 400
T = np.arange(ROWS) * 0.01
U = np.sign(np.sin(7.0 * T))
Y = np.cos(3.0 * T) * 0.1 + 1e-4 * np.sin(977.0 * T)
CAN_COLUMNS = "y=angle,u=voltage,ps=pressure,temperature=Supply.temperature"


@dataclass(frozen=True)
class Sound:
    """A kind of file.

    Attributes:
        suffix: Of its name.
        make: Writes one.
        columns: For `--columns`.
        use: `columns` for info, export and read; `replay` for these and for a replay; `dbc`: the file itself
            is the DBC of a log beside it.
        frames: It is a CAN log.
    """

    suffix: str
    make: Callable[[Path], None]
    columns: str = ""
    use: str = "columns"
    frames: bool = False


def _csv(
    path: Path, line: str = "{:.4f},{:g},{:.9f}\n", head: str = "t,u,y\n", encoding: str = "utf-8"
) -> None:
    text = head + "".join(line.format(*row) for row in zip(T, U, Y, strict=True))
    path.write_bytes(text.encode(encoding))


def _csv_of_others(path: Path) -> None:
    text = "# logger 7\nstation;12\n\ntime [ms];cmd [mV];pos [deg];state\n" + "".join(
        f"{1000 * t:.1f};{1000 * u:g};{y:.9f};on\n".replace(".", ",") for t, u, y in zip(T, U, Y, strict=True)
    )
    path.write_text(text, "utf-8-sig")


def _csv_own(path: Path) -> None:
    path.write_text(header(("motor",)) + CsvLines(1).lines(rows(ROWS)))


def _csv_gz(path: Path) -> None:
    _csv(path)
    path.write_bytes(gzip.compress(path.read_bytes(), mtime=0))


def _table(path: Path, kind: str) -> None:
    columns = (Column("t", "s"), Column("u", "V"), Column("y", "deg"), Column("state", text=True))
    arrays = {"t": T, "u": U, "y": Y, "state": np.array(["on", "off"] * (ROWS // 2), object)}
    export(Table(Path("-"), "", (Group("", columns, "t"),), {"": arrays}), kind, path, overwrite=True)


def _parquet(path: Path, compression: str, dictionary: bool) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    table = pa.table({"t": T, "u": U.astype("i1"), "y [deg]": Y, "state": ["on", "off"] * (ROWS // 2)})
    parquet.write_table(table, path, compression=compression, use_dictionary=dictionary, row_group_size=150)


def _mat(path: Path, version: str, compress: bool) -> None:
    content = {"t": T, "u": U, "y": Y} if version == "4" else {"run": {"t": T, "u": U, "y": Y}, "name": "x"}
    scipy.io.savemat(path, content, False, version, do_compression=compress, oned_as="column")


def _mat_73(path: Path) -> None:
    path.write_bytes(
        b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM".ljust(388, b"\0") + b"\x89HDF\r\n\x1a\n" * 99
    )


def _mdf(path: Path, version: str, compression: int) -> None:
    from asammdf import MDF, Signal

    with MDF(version=version) as mdf:
        mdf.append([Signal(U, T, name="u", unit="V"), Signal(Y, T, name="y", unit="deg")], comment="fast")
        mdf.append([Signal(7e6 + T[::10], T[::10], name="ps", unit="Pa")])
        mdf.save(path, overwrite=True, compression=compression)


def _mcap_own(path: Path) -> None:
    with path.open("wb") as stream:
        file = McapFile(stream, about(("pitch", "roll")), 1)  # type: ignore[arg-type] - takes the same bytes
        for at in range(0, ROWS, 100):
            file.rows(rows(100, 2, at))
            file.note("/events", 100.0 + at, {"t": 100.0 + at, "event": "state", "values": {"e_a": 1.5}})
            file.end_chunk()
        file.finish()


def _mcap_replay(path: Path) -> None:
    write_recording(path, rows(ROWS))


def _mcap_json(path: Path, compression: CompressionType, crcs: bool) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, 4000, compression, enable_crcs=crcs, enable_data_crcs=crcs)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b'{"properties": {"u": {"type": "number"}}}')
        channel = writer.register_channel("/axis", "json", schema)
        other = writer.register_channel("/tf", "protobuf", 0)
        for t, u, y in zip(T.tolist(), U.tolist(), Y.tolist(), strict=True):
            data = json.dumps({"u": u, "pos": {"y": y}}).encode()
            writer.add_message(channel, round(t * 1e9), data, round(t * 1e9))
        writer.add_message(other, 0, b"\0", 0)
        writer.finish()


def frames() -> Iterator[can.Message]:
    """Encoder each 10 ms, valve 2 ms later, supply each 100 ms."""
    database = cantools.database.load_file(DBC)
    for k, (t, u, y) in enumerate(zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)):
        sent = [("Encoder", t, {"angle": y, "run_enable": 1}), ("Valve", t + 0.002, {"voltage": u})]
        if k % 10 == 0:
            sent.append(("Supply", t + 0.004, {"pressure": 7e6 + 1000 * k, "temperature": 40}))
        for name, at, content in sent:
            message = database.get_message_by_name(name)
            spare = dict.fromkeys((s.name for s in message.signals), 0)
            data = message.encode(spare | content)
            yield can.Message(at, message.frame_id, message.is_extended_frame, data=data, channel=0)


def _can(path: Path) -> None:
    options = {"max_container_size": 4000} if path.suffix == ".blf" else {}
    with can.Logger(path, **options) as log:
        for frame in frames():
            log.on_message_received(frame)


def _dbc(path: Path) -> None:
    path.write_bytes(DBC.read_bytes())


def log_beside(folder: Path) -> Path:
    """A sound log for a DBC that is damaged."""
    path = folder / "sound.log"
    if not path.exists():
        _can(path)
    return path


def sound_files() -> dict[str, Sound]:
    """Every kind, by name."""
    names = "t=run.t,u=run.u,y=run.y"
    others = "t=time,u=cmd,y=pos"
    found = {
        "csv": Sound(".csv", _csv),
        "csv-own": Sound(".csv", _csv_own),
        "csv-others": Sound(".csv", _csv_of_others, others),
        "csv-utf16": Sound(".csv", lambda p: _csv(p, encoding="utf-16")),
        "csv-spaces": Sound(".txt", lambda p: _csv(p, "{:.3f}  {:g}  {:.6f}\n", ""), "t=1,u=2,y=3"),
        "csv-gz": Sound(".csv.gz", _csv_gz),
        "parquet": Sound(".parquet", lambda p: _table(p, "parquet")),
        "parquet-plain": Sound(".parquet", lambda p: _parquet(p, "none", False)),
        "parquet-zstd": Sound(".parquet", lambda p: _parquet(p, "zstd", True)),
        "mat5": Sound(".mat", lambda p: _mat(p, "5", False), names),
        "mat5-packed": Sound(".mat", lambda p: _mat(p, "5", True), names),
        "mat5-own": Sound(".mat", lambda p: _table(p, "mat")),
        "mat4": Sound(".mat", lambda p: _mat(p, "4", False)),
        "mat7.3": Sound(".mat", _mat_73),
        "mf4": Sound(".mf4", lambda p: _mdf(p, "4.10", 0)),
        "mf4-packed": Sound(".mf4", lambda p: _mdf(p, "4.10", 2)),
        "mf4-own": Sound(".mf4", lambda p: _table(p, "mdf")),
        "mdf3": Sound(".mdf", lambda p: _mdf(p, "3.30", 0)),
        "mcap-own": Sound(".mcap", _mcap_own, "t=roll.t,u=roll.u,y=roll.y"),
        "mcap-replay": Sound(".mcap", _mcap_replay, use="replay"),
        "mcap-json": Sound(".mcap", lambda p: _mcap_json(p, CompressionType.NONE, False), "y=pos.y"),
        "mcap-lz4": Sound(".mcap", lambda p: _mcap_json(p, CompressionType.LZ4, False), "y=pos.y"),
        "mcap-zstd": Sound(".mcap", lambda p: _mcap_json(p, CompressionType.ZSTD, True), "y=pos.y"),
        "dbc": Sound(".dbc", _dbc, CAN_COLUMNS, use="dbc"),
    }
    logs = {
        f"can-{suffix}": Sound(f".{suffix}", _can, CAN_COLUMNS, frames=True)
        for suffix in ("blf", "asc", "log", "trc", "mf4")
    }
    return found | logs
