"""Errors of the system name their file; recordings have a known ending and are files."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import invoke

from seod.files.shipped import configs_dir

VIRTUAL = configs_dir() / "virtual.yaml"
# what the fixture has compiled: a limited process could not keep machine code
WORDS = ["--excitation", "multisine", "--period", "0.5", "--duration", "3"]
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), -1))
sys.argv = ["seod", *sys.argv[2:]]
from seod.cli import main
main()
"""


def limited(size, *words, cwd):
    """`seod ARGS` in a process whose files can grow to so many bytes: the kernel refuses the rest."""
    command = [sys.executable, "-c", LIMITED, str(size), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize("words", ["--help", f"check {VIRTUAL}"])
def test_closed_streams_are_no_error(tmp_path, closed, words):
    command = f"{sys.executable} -m seod.cli {words} {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "run.csv"
    code, *_ = invoke("simulate", VIRTUAL, "--out", path, *WORDS)
    assert code == 0
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "file"),
    [
        (f"simulate {{rig}} --out out.csv {' '.join(WORDS)}", "out.csv"),
        (f"simulate {{rig}} --out out.csv.gz {' '.join(WORDS)}", "out.csv.gz"),
        ("export {csv} --to csv --out out.csv", "out.csv"),
        ("export {csv} --to parquet --out out.parquet", "out.parquet"),
        ("export {csv} --to mat --out out.mat", "out.mat"),
        ("export {csv} --to mdf --out out.mf4", "out.mf4"),
        ("info {csv} --plot out.png", "out.png"),
        ("identify {csv} --plot out.png", "out.png"),
    ],
)
def test_a_full_disk_is_told_with_its_file(words, file, recording, tmp_path):
    code, err = limited(4096, *words.format(rig=VIRTUAL, csv=recording).split(), cwd=tmp_path)
    assert code == 1
    assert err.splitlines()[-1] in (
        f"seod: {file}: File too large",
        f"seod: {tmp_path / file}: File too large",
    )
    assert "Errno" not in err
    assert "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "file"),
    [
        ("response {csv} --period 0.5 --gain 17 --plot out.png", "out.png"),
        ("diagnose {csv} --units y=rad --out found", "found/report.html"),
    ],
)
def test_a_full_disk_is_told_with_its_file_by_slow_commands(words, file, recording, tmp_path):
    test_a_full_disk_is_told_with_its_file(words, file, recording, tmp_path)


@pytest.mark.slow
def test_a_folder_that_is_not_there_is_told(recording, tmp_path):
    for words in (["export", recording, "--to", "csv", "--out"], ["info", recording, "--plot"]):
        code, err = limited(
            1 << 30, *words, tmp_path / "none" / "out", cwd=tmp_path
        )  # a process: fonts stay open
        assert (code, err) == (1, f"seod: {tmp_path}/none/out: No such file or directory\n")


def test_an_output_that_is_full_is_told(recording):
    with Path("/dev/full").open("w") as full:
        words = [sys.executable, "-m", "seod.cli", "info", recording]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "seod: standard output: No space left on device\n")


@pytest.mark.parametrize("name", ["x.xyz", "x", "x.mcap.gz", "x.parquet", ".csv"])
@pytest.mark.parametrize("more", [[], ["--start"]])
def test_a_recording_of_unknown_ending_is_refused_before_anything_starts(name, more, tmp_path):
    code, out, err = invoke("run", VIRTUAL, "--record", tmp_path / name, *more)
    assert (code, out) == (1, "")
    assert err == f"seod: --record {tmp_path / name}: the name must end in .mcap or .csv\n"


def test_a_recording_into_a_folder_or_a_pipe_is_refused_before_anything_starts(tmp_path):
    (tmp_path / "a.mcap").mkdir()
    assert invoke("run", VIRTUAL, "--record", tmp_path / "a.mcap") == (
        1,
        "",
        f"seod: --record {tmp_path}/a.mcap: is a folder, not a file\n",
    )
    code, _, err = invoke("run", VIRTUAL, "--record", tmp_path / "none" / "a.mcap")
    assert (code, err) == (1, f"seod: --record {tmp_path}/none/a.mcap: there is no folder {tmp_path}/none\n")


def test_a_bus_log_of_unknown_ending_is_a_mistake_of_the_rig_file(tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text(VIRTUAL.read_text() + "\nrecord: {bus_log: bus.xyz}\n")
    code, _, err = invoke("check", rig)
    assert code == 1
    assert "record.bus_log: must end in .asc, .blf, .csv, .log, .mf4 or .trc" in err
