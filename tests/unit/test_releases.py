"""What a release gave people goes on working: its rig files are read, or upgraded, by this version.

`.ci/release` puts the rig files of each release into `tests/releases/VERSION`, with the DBCs that they name.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from packaging.version import Version

import seod
from seod.config.load import load_text
from seod.config.model import CONFIG_VERSION
from seod.config.upgrade import upgraded

RELEASES = Path(__file__).parents[1] / "releases"
RIG_FILES = sorted(RELEASES.glob("*/*.yaml"))


def test_this_version_is_the_newest_release_or_comes_after_it() -> None:
    """Between two releases the version is that of the last one."""
    kept = max(Version(folder.name) for folder in RELEASES.iterdir())
    assert Version(seod.__version__) >= kept


@pytest.mark.parametrize("path", RIG_FILES, ids=[f"{path.parent.name}-{path.stem}" for path in RIG_FILES])
def test_rig_files_of_each_release_are_read_or_upgraded(path: Path) -> None:
    text = path.read_text("utf-8")
    now = upgraded(text, path.name, path.parent) or text
    assert load_text(now, path.name, path.parent).version == CONFIG_VERSION
