"""`.ci/release` in a copy of this checkout: what it makes, and that it leaves nothing where it fails."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPO = Path(__file__).parents[1]
VERSION = "9.8.7"
NOT_COPIED = (".git", ".venv", "build", "dist", "mutants", "__pycache__", ".*_cache", ".hypothesis")

pytestmark = pytest.mark.timeout(600)


def git(clone: Path, *words: str) -> str:
    """What git says in a clone."""
    name = ["-c", "user.name=nobody", "-c", "user.email=nobody@localhost"]
    done = subprocess.run(["git", *name, *words], cwd=clone, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """This checkout as it is now, committed anew, with this environment."""
    there = tmp_path / "seod"
    shutil.copytree(REPO, there, ignore=shutil.ignore_patterns(*NOT_COPIED))
    git(there, "init", "-q")
    git(there, "add", "-A")
    git(there, "commit", "-q", "-m", "as it is")
    (there / ".venv").symlink_to(sys.prefix)
    for name in ("requirements.lock", "requirements-run.lock", "pyproject.toml"):  # the environment is newer
        os.utime(there / name, (0, 0))
    with (there / ".git" / "info" / "exclude").open("a") as excluded:
        excluded.write(".venv\n")
    return there


def release(clone: Path, version: str = VERSION, **more: str) -> subprocess.CompletedProcess[str]:
    """Run it without the checks: those are this very run."""
    who = {f"GIT_{role}_{what}": "nobody" for role in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    environment = os.environ | who | {"CHECKED": "1", "SOURCE_DATE_EPOCH": ""} | more
    return subprocess.run(
        ["bash", ".ci/release", version],
        cwd=clone,
        env=environment,
        check=False,
        capture_output=True,
        text=True,
    )


def test_a_release_has_wheel_sbom_sums_changelog_and_tag(clone: Path) -> None:
    done = release(clone)
    assert done.returncode == 0, done.stdout + done.stderr
    assert git(clone, "describe", "--exact-match") == f"v{VERSION}"
    assert git(clone, "status", "--porcelain") == ""
    changelog = (clone / "CHANGELOG.md").read_text("utf-8")
    assert changelog.index("## [Unreleased]") < changelog.index(f"## [{VERSION}] - 2")
    assert sorted(p.name for p in (clone / "tests" / "releases" / VERSION).glob("can.*")) == ["can.yaml"]
    made = clone / "build" / "release"
    (wheel,) = made.glob("*.whl")
    text = zipfile.ZipFile(wheel).read(f"seod-{VERSION}.dist-info/METADATA").decode()
    assert f"\nVersion: {VERSION}\n" in text
    component = json.loads((made / "sbom.json").read_text("utf-8"))["metadata"]["component"]
    assert (component["name"], component["version"]) == ("seod", VERSION)
    subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=made, check=True)
    assert len((made / "SHA256SUMS").read_text().splitlines()) == 3
    again = release(clone)
    assert again.returncode == 1
    assert "exists already" in again.stderr


def test_what_is_signed_off_already_is_tagged_as_it_is(clone: Path) -> None:
    assert release(clone).returncode == 0
    git(clone, "tag", "-d", f"v{VERSION}")
    before = git(clone, "rev-parse", "HEAD")
    assert release(clone).returncode == 0
    assert git(clone, "rev-parse", "HEAD", f"v{VERSION}^{{commit}}").split() == [before, before]


@pytest.mark.parametrize("damage", ["the SBOM fails", "a dirty checkout"])
def test_a_release_that_fails_leaves_the_checkout_as_before(damage: str, clone: Path) -> None:
    before, more = git(clone, "rev-parse", "HEAD"), {}
    if damage == "a dirty checkout":
        (clone / "new.txt").write_text("not committed\n")
    else:
        more = {"PYTHON": "no-such-python", "MAKEFLAGS": "BIN=/nowhere"}
    done = release(clone, **more)
    assert done.returncode != 0
    assert git(clone, "rev-parse", "HEAD") == before
    assert git(clone, "tag", "--list", f"v{VERSION}") == ""
    assert ("as before" if more else "not clean") in done.stderr
