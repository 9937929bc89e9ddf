"""The container file: built and run where there is a builder, else linted, and its steps done without one."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import zipfile
from fnmatch import fnmatch
from pathlib import Path

import pytest
from dockerfile_parse import DockerfileParser

from tests import wheels

REPO = Path(__file__).parents[1]
HOME = "/opt/seod"
"""The environment in the image."""


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, str]]:
    """Instructions with their values; the parser would write beside the file."""
    copy = tmp_path_factory.mktemp("container") / "Dockerfile"
    copy.write_text((REPO / "Dockerfile").read_text())
    structure = DockerfileParser(str(copy)).structure
    return [(each["instruction"], each["value"]) for each in structure if each["instruction"] != "COMMENT"]


def values(steps: list[tuple[str, str]], instruction: str) -> list[str]:
    return [value for name, value in steps if name == instruction]


def commands(steps: list[tuple[str, str]]) -> list[str]:
    """What the image's making runs, a command each."""
    return [each.strip() for value in values(steps, "RUN") for each in value.split("&&")]


def copied(steps: list[tuple[str, str]]) -> dict[str, str]:
    """Where each file or folder of the checkout goes."""
    into = {}
    for value in values(steps, "COPY"):
        *sources, target = value.split()
        into |= {name: f"{target}{name}" if target.endswith("/") else target for name in sources}
    return into


def test_lint() -> None:
    hadolint = Path(sys.executable).with_name("hadolint")
    done = subprocess.run([hadolint, REPO / "Dockerfile"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_base_is_a_release_of_debian_slim(steps: list[tuple[str, str]]) -> None:
    (base,) = values(steps, "FROM")
    assert re.fullmatch(r"debian:\d+\.\d+-slim", base)


def test_all_that_is_installed_is_locked_with_hashes(steps: list[tuple[str, str]]) -> None:
    dependencies, own = [each for each in commands(steps) if "pip install" in each]
    assert dependencies.endswith("--require-hashes -r /src/requirements-run.lock")
    assert "--no-deps" in own.split()
    assert own.endswith(" /src")


def test_the_rig_runs_as_a_user_of_its_own(steps: list[tuple[str, str]]) -> None:
    (user,) = values(steps, "USER")
    (made,) = [each for each in commands(steps) if each.startswith("useradd")]
    assert user != "0"
    assert f"--uid {user}" in made
    assert made.split()[-1] in values(steps, "WORKDIR")[0].split("/")


def test_what_is_copied_is_there_and_not_ignored(steps: list[tuple[str, str]]) -> None:
    ignored = (REPO / ".dockerignore").read_text().split()
    for name in copied(steps):
        assert (REPO / name).exists(), name
        assert not [pattern for pattern in ignored if fnmatch(name, pattern)], name


def test_what_is_copied_makes_the_same_wheel(steps: list[tuple[str, str]], tmp_path: Path) -> None:
    source = tmp_path / "image"
    for name, target in copied(steps).items():
        to = source / target.lstrip("/")
        to.parent.mkdir(parents=True, exist_ok=True)
        if (REPO / name).is_dir():
            shutil.copytree(REPO / name, to, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(REPO / name, to)
    names = [
        sorted(zipfile.ZipFile(wheels.built(tmp_path / out, tree)).namelist())
        for out, tree in (("a", source / "src"), ("b", REPO))
    ]
    assert names[0] == names[1]


def here(word: str) -> str:
    """A path of the image's environment as it is in this checkout."""
    return word.replace(f"{HOME}/share/seod", str(REPO)).replace(
        f"{HOME}/bin", str(Path(sys.executable).parent)
    )


def test_the_step_that_compiles_runs(steps: list[tuple[str, str]], tmp_path: Path) -> None:
    (step,) = [value for value in values(steps, "RUN") if "seod simulate" in value]
    subprocess.run(["bash", "-ec", here(step)], cwd=tmp_path, check=True, capture_output=True)
    assert list(tmp_path.iterdir()) == []


def test_by_itself_it_runs_the_virtual_rig(steps: list[tuple[str, str]]) -> None:
    (entry,) = values(steps, "ENTRYPOINT")
    (default,) = values(steps, "CMD")
    command, rig, *options = json.loads(default)
    seod = [here(word) for word in json.loads(entry)]
    assert (command, rig, options) == ("run", f"{HOME}/share/seod/configs/virtual.yaml", ["--start"])
    checked = subprocess.run([*seod, "check", here(rig)], capture_output=True, text=True, check=True)
    assert "virtual" in checked.stdout
    told = subprocess.run([*seod, command, "--help"], capture_output=True, text=True, check=True)
    assert set(options) <= set(told.stdout.split())


def has_builder() -> bool:
    """Whether Docker's daemon answers."""
    if shutil.which("docker") is None:
        return False
    return subprocess.run(["docker", "info"], capture_output=True, check=False).returncode == 0


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.skipif(not has_builder(), reason="no container builder here: only looked at and done in steps")
def test_the_image_runs_the_rig() -> None:
    subprocess.run(["docker", "build", "-t", "seod-under-test", REPO], check=True)
    words = ["docker", "run", "--rm", "seod-under-test"]
    rig = f"{HOME}/share/seod/configs/virtual.yaml"
    done = subprocess.run(
        [*words, "run", rig, "--start", "--watch", "--for", "5"], capture_output=True, text=True, check=True
    )
    assert "zeta=" in done.stdout
