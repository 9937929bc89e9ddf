"""Damaged files end in what could be read, or in one sentence: whatever the format, its library, the blow."""

from __future__ import annotations

import random
import resource
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from drivers.base import DriverError
from drivers.replay import ReplayDriver, ReplayOptions
from seod.cli import app
from seod.data import ReadError, open_source, read
from seod.files.damage import DamagedError, bounded, heard, library, plain
from seod.record.mcap_records import records, unpacked
from seod.record.read import RecordingError, beginning, items
from tests.command_line import CliRunner
from tests.damage.blows import BLOWS, damaged
from tests.damage.files import CAN_COLUMNS, DBC, ROWS, sound_files
from tests.damage.trial import Complaints, outcome, uses

KINDS = sound_files()


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Bytes of a sound file of each kind."""
    folder = tmp_path_factory.mktemp("sound")

    def of(kind, made={}):  # noqa: B006 - made once
        if kind not in made:
            path = folder / f"{kind}{KINDS[kind].suffix}"
            KINDS[kind].make(path)
            made[kind] = path.read_bytes()
        return made[kind]

    return of


@pytest.fixture(scope="module")
def complaints():
    found = Complaints()
    yield found
    found.close()


def kinds_of(recording):
    return {problem.kind for problem in recording.problems}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "mat7.3"])
def test_sound_files_have_no_damage(kind, sound, tmp_path):
    path = tmp_path / f"run{KINDS[kind].suffix}"
    path.write_bytes(sound(kind))
    if KINDS[kind].use == "dbc":
        return
    recording = read(path, KINDS[kind].columns, dbc=DBC if KINDS[kind].frames else None)
    assert len(recording.t) == ROWS
    assert not {"damaged", "truncated"} & kinds_of(recording)


@pytest.mark.slow
@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(kind=st.sampled_from(sorted(KINDS)), seed=st.integers(0, 10**6))
@example(kind="mcap-own", seed=11)
@example(kind="mcap-zstd", seed=7)
@example(kind="mcap-json", seed=27)
@example(kind="mcap-replay", seed=15)
@example(kind="mf4-packed", seed=0)
@example(kind="can-mf4", seed=8)
@example(kind="can-mf4", seed=15)
@example(kind="can-blf", seed=0)
@example(kind="parquet-plain", seed=5)
@example(kind="mat5-packed", seed=2)
@example(kind="mat5", seed=12)
def test_any_damage_ends_in_an_answer_or_a_sentence(kind, seed, sound, complaints, tmp_path):
    draw = random.Random(f"1 {kind} {seed}")
    path = tmp_path / f"run{KINDS[kind].suffix}"
    path.write_bytes(damaged(sound(kind), draw))
    names = str(path), str(tmp_path / "out."), str(tmp_path / "sound.log")
    for use in uses(path, KINDS[kind], tmp_path, draw.choice(("csv", "parquet", "mat", "mdf"))):
        assert outcome(use, *names) == ""
    assert complaints.taken() == []


@pytest.mark.parametrize("blow", dict.fromkeys(BLOWS), ids=lambda blow: blow.__name__)
def test_a_blow_changes_a_file(blow, sound):
    data = sound("csv")
    assert any(blow(data, random.Random(seed)) != data for seed in range(3))


def chunk_starts(data):
    """Offsets of the chunk records of an MCAP file, by walking its records."""
    at, found = 8, []
    while data[at] != 2:
        found += [at] if data[at] == 6 else []
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    return found


@pytest.mark.parametrize("length", [2**63, 2**40, 3 * 10**9, 1, 0])
def test_an_mcap_record_with_a_wrong_length_costs_itself(length, sound, tmp_path):
    path = tmp_path / "run.mcap"
    data = bytearray(sound("mcap-own"))
    struct.pack_into("<Q", data, chunk_starts(data)[1] + 1, length)
    path.write_bytes(data)
    recording = read(path, KINDS["mcap-own"].columns)
    assert len(recording.t) == ROWS - 100
    assert "damaged" in kinds_of(recording)
    if length > len(data):
        assert "truncated" not in kinds_of(recording)  # its end is there


def test_a_zeroed_part_of_an_mcap_file_costs_its_chunks(sound, tmp_path):
    path = tmp_path / "run.mcap"
    data = bytearray(sound("mcap-own"))
    start, end = chunk_starts(data)[1:3]
    data[start : end - 7] = bytes(end - 7 - start)
    path.write_bytes(data)
    assert len(read(path, KINDS["mcap-own"].columns).t) == ROWS - 100
    assert len([item for item in items(path, ("pitch", "roll")) if isinstance(item, dict)]) >= 1


def test_messages_of_a_channel_that_nothing_describes_are_left_out(tmp_path):
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, use_chunking=False, enable_crcs=False)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        for k in range(50):
            writer.add_message(channel, k, b'{"t": %d, "u": 1, "y": %d}' % (k, k), k, k)
        writer.finish()
    data = path.read_bytes()
    data = data.replace(b'"y": 8}', b'"y": 8!')
    message = b"\x05" + struct.pack("<QHI", 22 + 24, channel, 3)
    assert message in data
    path.write_bytes(data.replace(message, b"\x05" + struct.pack("<QHI", 22 + 24, 77, 3)))
    recording = read(path)
    assert recording.t.tolist() == [k for k in range(50) if k not in (3, 8)]
    told = [problem.message for problem in recording.problems if problem.kind == "damaged"]
    assert told == [
        "channel 77, which is not described: 1 messages left out",
        "/a: no JSON: 1 messages left out",
    ]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_a_chunk_that_claims_to_be_large_is_refused(compression, tmp_path):
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression)
        writer.start()
        writer.add_message(writer.register_channel("/a", "json", 0), 0, b'{"t": 0}' * 100, 0)
        writer.finish()
    with path.open("rb") as file:
        chunk = next(r for r in records(file, path.stat().st_size) if type(r).__name__ == "Chunk")
    assert len(unpacked(chunk)) == 2
    chunk.uncompressed_size = 1 << 40
    with pytest.raises(DamagedError, match="beyond what a file of its size can hold"):
        unpacked(chunk)


def test_a_damaged_row_group_of_a_parquet_file_costs_itself(sound, tmp_path):
    from pyarrow import parquet

    path = tmp_path / "run.parquet"
    path.write_bytes(sound("parquet-zstd"))
    with parquet.ParquetFile(path) as file:
        page = file.metadata.row_group(1).column(2).data_page_offset
    data = bytearray(sound("parquet-zstd"))
    data[page : page + 60] = bytes(60)
    path.write_bytes(data)
    recording = read(path)
    assert len(recording.t) == ROWS - 150
    (told,) = (p.message for p in recording.problems if p.kind == "damaged")
    assert told.startswith("row group 2 cannot be read after its row 0: ")


def test_a_damaged_group_of_an_mdf_file_leaves_the_others(sound, tmp_path):
    path = tmp_path / "run.mf4"
    data = bytearray(sound("mf4-packed"))
    block = data.index(b"##DZ")
    data[block + 60 : block + 90] = bytes(30)
    path.write_bytes(data)
    with open_source(path) as source:
        blocks = list(source.blocks({g.name: [c.name for c in g.columns] for g in source.groups}))
        assert "damaged" in {remark.kind for remark in source.remarks}
    assert sum(len(block.rows) for block in blocks) in (ROWS, ROWS // 10)


def test_frames_before_the_damage_of_a_blf_are_read(sound, tmp_path):
    path = tmp_path / "run.blf"
    data = bytearray(sound("can-blf"))
    places = [k for k in range(len(data)) if data[k : k + 4] == b"LOBJ"]
    data[places[len(places) // 2] : places[len(places) // 2] + 4] = b"XXXX"
    path.write_bytes(data)
    recording = read(path, CAN_COLUMNS, dbc=DBC)
    assert 0.2 * ROWS < len(recording.t) < 0.8 * ROWS
    assert "damaged" in kinds_of(recording)


def test_what_a_library_logs_is_a_remark_and_nothing_on_the_terminal(sound, tmp_path, capfd):
    import logging

    path = tmp_path / "run.mf4"
    path.write_bytes(sound("mf4"))
    with open_source(path) as source:
        logging.getLogger("asammdf").error("one thing\nTraceback (most recent call last):\n  and all of it")
        logging.getLogger("can").warning("another")
        logging.getLogger("can").info("nothing of interest")
        list(source.blocks({}))
    assert [remark.message for remark in source.remarks] == ["one thing", "another"]
    assert capfd.readouterr() == ("", "")


def test_what_a_library_left_half_made_ends_in_silence(sound, tmp_path, capfd):
    path = tmp_path / "run.mf4"
    data = bytearray(sound("mf4"))
    data[64:68] = b"##XX"
    path.write_bytes(data)
    for dbc in (None, DBC):
        with pytest.raises(ReadError, match=r"run\.mf4: is no "):
            read(path, CAN_COLUMNS if dbc else "", dbc=dbc)
    assert capfd.readouterr() == ("", "")


def test_a_replay_says_what_is_lost(sound, tmp_path):
    path = tmp_path / "run.mcap"
    data = bytearray(sound("mcap-replay"))
    data[chunk_starts(data)[0] + 60] ^= 0xFF
    path.write_bytes(data)
    assert [item["code"] for item in items(path, ("motor",))] == ["rows_lost"]
    path.write_bytes(sound("mcap-replay").replace(b'"channel"', b'"chanXel"'))
    options = ReplayOptions.model_validate({"kind": "replay", "file": str(path)})
    with pytest.raises(DriverError, match=r"run\.mcap: .*damaged"):
        ReplayDriver.channels(options)
    path.write_bytes(b"no recording at all")
    with pytest.raises(RecordingError, match=r"run\.mcap: is no recording of seod"):
        beginning(path)


@pytest.mark.parametrize(
    "arguments",
    [["info"], ["export", "--to", "csv"], ["identify"], ["response"], ["diagnose"]],
    ids=lambda arguments: arguments[0],
)
@pytest.mark.parametrize("kind", ["mcap-json", "parquet", "mf4", "mat5-packed", "csv-gz"])
def test_every_command_says_it_in_one_sentence(arguments, kind, sound, tmp_path, capfd):
    path = tmp_path / f"run{KINDS[kind].suffix}"
    path.write_bytes(sound(kind)[:700][::-1] if kind == "csv-gz" else sound(kind)[:90] + bytes(900))
    result = CliRunner().invoke(app, [arguments[0], str(path), *arguments[1:]])
    assert result.exit_code == 1
    assert result.exception is None or isinstance(result.exception, SystemExit)
    (line,) = [line for line in result.stderr.splitlines() if line]
    assert line.startswith(f"seod: {path}: ")


@pytest.mark.slow
def test_memory_is_bounded_inside_and_as_before_after():
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with pytest.raises(MemoryError), bounded(0), bounded(1 << 20):
        np.ones(1 << 26)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
    assert len(np.ones(1 << 25)) == 1 << 25


def test_a_failure_is_told_in_one_printable_line():
    errors = KeyError("a\x1b[31m"), MemoryError(), ValueError("one\ntwo"), OSError("x" * 999), TypeError()
    for error in errors:
        with pytest.raises(DamagedError) as told, library():
            raise error
        assert str(told.value).isprintable()
        assert 0 < len(str(told.value)) <= 200
    assert plain("µ°") == "µ°"
    with pytest.raises(ReadError, match="as it is"), library(ReadError):
        raise ReadError("as it is")


def test_only_destructors_of_libraries_are_kept_silent(monkeypatch):
    class Broken:
        def __del__(self):
            raise KeyError("half made")

    others = []
    monkeypatch.setattr("sys.unraisablehook", lambda failed: others.append(failed.exc_value))
    with heard():
        Broken()
        Broken.__del__.__module__ = "asammdf.blocks"
        Broken()
    assert [str(each) for each in others] == ["'half made'"]
