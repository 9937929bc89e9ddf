"""`--axis`: a name that is not there is told, with those that are, by every command."""

from __future__ import annotations

import pytest
from record_rows import rows, write_recording
from test_cli import invoke

from seod.files.shipped import configs_dir

VIRTUAL, SEAT = configs_dir() / "virtual.yaml", configs_dir() / "seat-virtual.yaml"


@pytest.fixture
def files(tmp_path):
    """Recordings: of one axis by the daemon, columns without an axis, columns with two."""
    paths = {name: tmp_path / name for name in ("one.mcap", "plain.csv", "two.csv", "none.csv")}
    write_recording(paths["one.mcap"], rows(500))
    lines = [f"{k / 100},{k % 2},{k % 7}" for k in range(300)]
    paths["plain.csv"].write_text("t,u,y\n" + "\n".join(lines) + "\n")
    names = ",".join(f"{axis}.{role}" for axis in ("pitch", "roll") for role in "tuy")
    paths["two.csv"].write_text(f"{names}\n" + "\n".join(f"{line},{line}" for line in lines) + "\n")
    return paths


@pytest.mark.parametrize(
    ("file", "told"),
    [
        ("one.mcap", "known axes: motor"),
        ("plain.csv", "its columns name no axis: leave it out"),
        ("two.csv", "known axes: pitch, roll"),
    ],
)
@pytest.mark.parametrize(
    "words",
    [
        "identify",
        "identify --method wave --gain 17",
        "diagnose",
        "response --period 0.1",
        "export --to csv --force",
    ],
)
def test_an_axis_that_a_recording_does_not_have(words, file, told, files, tmp_path):
    command, *rest = words.split()
    out = ["--out", tmp_path / "out.csv"] if command == "export" else []
    code, said, err = invoke(command, files[file], *rest, *out, "--axis", "nope")
    assert (code, said) == (1, "")
    assert err == f"seod: {files[file]}: no axis 'nope'; {told}\n"
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    "words",
    ["identify {0} --config {1}", "diagnose {0} --config {1}", "simulate {1} --out x.csv", "calibrate {1}"],
)
@pytest.mark.parametrize("config", [VIRTUAL, SEAT], ids=["one axis", "two axes"])
def test_an_axis_that_a_rig_file_does_not_have(words, config, files):
    code, said, err = invoke(*words.format(files["plain.csv"], config).split(), "--axis", "nope")
    assert (code, said) == (1, "")
    assert "no axis 'nope'" in err
    assert "motor" in err if config == VIRTUAL else "pitch, roll" in err


@pytest.mark.parametrize("data", [[], ["{plain}"]], ids=["on the rig", "from a recording"])
def test_response_with_a_rig_file(data, files):
    given = [word.format(plain=files["plain.csv"]) for word in data]
    code, said, err = invoke("response", *given, "--config", SEAT, "--axis", "nope")
    assert (code, said) == (1, "")
    assert "no axis 'nope': --axis takes one of pitch, roll" in err


def test_columns_without_an_axis_are_those_of_the_axis_of_the_rig_file(files, tmp_path):
    code, _, err = invoke("identify", files["plain.csv"], "--config", SEAT, "--axis", "roll")
    assert "no axis" not in err
    code, _, err = invoke(
        "export", files["one.mcap"], "--to", "csv", "--out", tmp_path / "o.csv", "--axis", "motor"
    )
    assert (code, err) == (0, "") or "no axis" not in err
