"""`seod scrub`: tokens leave old recordings, and nothing else does."""

from __future__ import annotations

import dataclasses
import gzip
import json
import os
import random
import stat

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from record_rows import Content, about, rows
from test_cli import invoke
from zstandard import ZstdDecompressor

from seod.files.shipped import configs_dir
from seod.record.series import Note, Rotation, Series

READ, COMMAND = "r34d-Nbq7XkZs1vLw", 'c0mm4nd-ü€-Pd2hGe"'
ESCAPED = COMMAND.replace('"', '\\"')
VIRTUAL = (configs_dir() / "virtual.yaml").read_text()
RIG_TEXT = VIRTUAL.replace(
    "server:\n", f"server:\n  read_token: {READ}  # {READ}\n  command_token: '{COMMAND}'\n"
)
RIG_JSON = json.dumps(
    {"rig": "a", "server": {"read_token": READ, "command_token": COMMAND}}, ensure_ascii=False
)
FORMS = [form.encode() for form in (READ, COMMAND, ESCAPED, json.dumps(COMMAND)[1:-1])]


def old_recording(path, events=(), rig_json=RIG_JSON):
    """As it was written before tokens were kept out of it: several chunks."""
    told = dataclasses.replace(about(), rig_text=RIG_TEXT, rig_json=rig_json)
    series = Series(path, told, Rotation(), dict, 0.0)
    for first in (0, 500):
        series.put([*events, rows(500, first=first)], float(first))
    series.finish(0.0)
    path.chmod(0o644)
    return path


def whole(path):
    """The bytes as they are and unpacked."""
    data = path.read_bytes()
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                data += ZstdDecompressor().decompress(record.data, record.uncompressed_size)
    return data


def shows_a_token(data):
    return [form for form in FORMS if form in data]


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_an_old_recording_loses_its_tokens_and_nothing_else(tmp_path):
    path = old_recording(tmp_path / "a.mcap")
    os.utime(path, ns=(10**18, 1_600_000_000_123_456_789))
    before, content = path.read_bytes(), Content(path)
    assert shows_a_token(before)
    assert invoke("scrub", path) == (0, f"{path}: 2 tokens taken out\n", "")
    after = path.read_bytes()
    assert shows_a_token(whole(path)) == []
    assert mode(path) == 0o640
    assert path.stat().st_mtime_ns == 1_600_000_000_123_456_789
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]
    # Only the attachments' texts and checksums differ: what stands behind them is the same bytes.
    assert len(after) == len(before)
    differing = np.flatnonzero(np.frombuffer(before, np.uint8) != np.frombuffer(after, np.uint8))
    chunks = before.index(b"zstd")
    assert len(differing)
    assert differing[-1] < chunks
    again = Content(path)  # with all checksums
    assert again.messages == content.messages
    assert again.ended
    assert again.metadata == content.metadata
    assert json.loads(again.attachments["rig.json"])["rig"] == "a"
    with path.open("rb") as file:
        assert len(list(make_reader(file).iter_attachments())) == 2
    assert invoke("info", path)[0] == 0


def test_it_is_found_clean_the_second_time(tmp_path):
    path = old_recording(tmp_path / "a.mcap")
    invoke("scrub", path)
    after, state = path.read_bytes(), path.stat().st_ino
    path.chmod(0o644)
    assert invoke("scrub", path) == (0, f"{path}: shows no token\n", "")
    assert path.read_bytes() == after
    assert path.stat().st_ino == state
    assert mode(path) == 0o640


def test_tokens_that_only_the_text_or_only_the_json_tells(tmp_path):
    path = old_recording(tmp_path / "a.mcap", rig_json=json.dumps({"rig": COMMAND}))
    code, _, err = invoke("scrub", path)  # in a place where no token is known to stand
    assert (code, err) == (1, f"seod: {path}: a token is in other places of it too: not touched\n")
    assert COMMAND.encode() in path.read_bytes()
    path = old_recording(tmp_path / "b.mcap", rig_json=json.dumps({"server": {"command_token": COMMAND}}))
    assert invoke("scrub", path)[0] == 0
    assert shows_a_token(whole(path)) == []


def test_a_token_in_a_compressed_message_is_not_overlooked(tmp_path):
    path = old_recording(tmp_path / "a.mcap", [Note("/events", 100.0, {"t": 1.0, "why": f"wrong: {READ}"})])
    before = path.read_bytes()
    code, _, err = invoke("scrub", path)
    assert (code, err) == (
        1,
        f"seod: {path}: its messages hold a token too, and those stay as they are: not touched\n",
    )
    assert path.read_bytes() == before


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_recording_with_a_checksum_of_its_data(compression, tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, enable_data_crcs=True)
        writer.start("seod", "x")
        writer.add_attachment(1, 2, "rig.json", "application/json", RIG_JSON.encode())
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for k in range(100):
            writer.add_message(channel, k, b'{"k": 1}', k)
        writer.finish()
    assert invoke("scrub", path)[0] == 0
    assert shows_a_token(path.read_bytes()) == []
    assert invoke("scrub", path)[:2] == (0, f"{path}: shows no token\n")  # whose checksums were held again
    assert len(Content(path).messages) == 100


def damaged(data, how):
    number = random.Random(how)
    if isinstance(how, str):
        return {"cut": data[: len(data) // 2], "no end": data[:-8], "longer": data + b"x", "empty": b""}[how]
    at = number.randrange(8, len(data))
    return data[:at] + bytes([data[at] ^ (1 << number.randrange(8))]) + data[at + 1 :]


@pytest.mark.parametrize("how", ["cut", "no end", "longer", "empty", *range(60)])
def test_a_damaged_recording_is_refused_with_a_sentence_or_cleaned_in_full(how, tmp_path):
    path = old_recording(tmp_path / "a.mcap")
    hurt = damaged(path.read_bytes(), how)
    path.write_bytes(hurt)
    code, out, err = invoke("scrub", path)
    if code:
        assert path.read_bytes() == hurt
        assert err.startswith(f"seod: {path}: ")
        assert err.count("\n") == 1
        assert out == ""
    else:  # the bit stood where no checksum and no reader looks
        assert shows_a_token(path.read_bytes()) == []
    if isinstance(how, str):
        assert code == 1
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


def test_one_that_is_still_recorded_to_is_refused(tmp_path):
    path = tmp_path / "a.mcap"
    told = dataclasses.replace(about(), rig_text=RIG_TEXT)
    series = Series(path, told, Rotation(), dict, 0.0)
    series.put([rows(500)], 0.0)
    code, _, err = invoke("scrub", path)
    assert code == 1
    assert "is not ended: it was cut off, or is still recorded to: not touched" in err
    series.finish(0.0)
    assert invoke("scrub", path)[0] == 0


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
def test_a_csv_file_in_whose_head_a_rig_file_stands(name, tmp_path):
    path = tmp_path / name
    opened = gzip.open if name.endswith("gz") else open
    text = f"# server:\n#   read_token: {READ}\n#   port: 7600\nt,u,y,note\n1,2,3,{READ}\n2,3,4,ü\n"
    with opened(path, "wt", encoding="utf-8") as file:
        file.write(text)
    path.chmod(0o644)
    assert invoke("scrub", path) == (0, f"{path}: 1 token taken out\n", "")
    with opened(path, "rt", encoding="utf-8") as file:
        assert file.read() == text.replace(READ, "x" * len(READ))
    assert mode(path) == 0o640
    assert invoke("scrub", path) == (0, f"{path}: shows no token\n", "")


def test_a_damaged_gzip_file_is_refused(tmp_path):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(
        gzip.compress(b"# read_token: " + READ.encode() + b"\nt,u,y\n" + b"1,2,3\n" * 5000)[:-20]
    )
    code, _, err = invoke("scrub", path)
    assert (code, err.startswith(f"seod: {path}: is cut off or damaged")) == (1, True)


def test_several_files_some_of_which_cannot_be_cleaned(tmp_path):
    good = old_recording(tmp_path / "a.mcap")
    rig, none = tmp_path / "rig.yaml", tmp_path / "none.mcap"
    rig.write_text(RIG_TEXT)
    code, out, err = invoke("scrub", none, rig, good)
    assert (code, out) == (1, f"{good}: 2 tokens taken out\n")
    assert err.splitlines() == [
        f"seod: {none}: No such file or directory",
        f"seod: {rig}: is a rig file, no recording: take the tokens out of a copy by hand",
    ]
    assert rig.read_text() == RIG_TEXT


def test_links(tmp_path):
    path = old_recording(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").symlink_to(path)
    (tmp_path / "c.mcap").hardlink_to(path)
    code, out, _ = invoke("scrub", tmp_path / "b.mcap")
    assert code == 0
    assert "1 hard links still lead to the old file" in out
    assert (tmp_path / "b.mcap").is_symlink()
    assert shows_a_token(path.read_bytes()) == []
    assert shows_a_token((tmp_path / "c.mcap").read_bytes())


def test_a_full_disk_leaves_the_recording_as_it_was(tmp_path, monkeypatch):
    path = old_recording(tmp_path / "a.mcap")
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("seod.scrub.command.shutil.copyfile", full)
    assert invoke("scrub", path) == (1, "", f"seod: {path}: No space left on device\n")
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.slow
def test_what_others_have_exported_is_looked_at(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,u,y\n" + "".join(f"{k},{k},{k}\n" for k in range(100)))
    out = tmp_path / "a.parquet"
    invoke("export", path, "--to", "parquet", "--out", out)
    assert invoke("scrub", out) == (0, f"{out}: shows no token (parquet files hold no rig file)\n", "")
    out.write_bytes(out.read_bytes() + b"read_token")
    assert invoke("scrub", out)[0] == 1
