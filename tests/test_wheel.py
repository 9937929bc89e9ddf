"""The wheel as users install it: far from the checkout, with nothing but its own files."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

import seod

REPO = Path(__file__).parents[1]

SHIPPED = {
    "configs": ["virtual.yaml", "can.yaml", "motor.dbc", "seod-rig.schema.json"],
    "systemd": ["seod@.service", "seod-can@.service", "serial.conf", "install.py"],
}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built wheel."""
    out = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(REPO)]
    subprocess.run(build, check=True, capture_output=True)
    (path,) = out.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`bin` of an environment that has the wheel; the dependencies are those of this environment."""
    home = tmp_path_factory.mktemp("installed")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(python)]
    subprocess.run([*pip, "install", "--quiet", "--no-deps", "--no-index", str(wheel)], check=True)
    (packages,) = home.glob("lib/python*/site-packages")
    # A path, not a site folder: the editable install of the checkout is not looked at.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return home / "bin"


def run(command: list[str | Path], cwd: Path) -> str:
    """Standard output of a command that must succeed; nothing of the checkout is in its environment."""
    environment = {"PATH": os.defpath, "HOME": str(cwd), "PYTHONWARNINGS": "error"}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_built_again_it_has_the_same_bytes(wheel: Path, tmp_path: Path) -> None:
    """As `make wheelhouse` builds it: the time is that of the commit, not of the clock."""
    built = []
    for name in ("a", "b"):
        words = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path / name)]
        environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
        subprocess.run([*words, str(REPO)], check=True, capture_output=True, env=environment)
        built.append((tmp_path / name / wheel.name).read_bytes())
    assert built[0] == built[1]


def test_top_level_names(wheel: Path) -> None:
    names = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    version = f"seod-{seod.__version__}"
    assert names == {"seod", "drivers", "sim", f"{version}.dist-info", f"{version}.data"}


def test_typed_and_licensed(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {"seod/py.typed", "drivers/py.typed", "sim/py.typed"} <= set(names)
    assert any(name.endswith("licenses/LICENSE") for name in names)


@pytest.mark.parametrize("folder", SHIPPED)
def test_shipped_files_are_found(folder: str, installed: Path, tmp_path: Path) -> None:
    code = f"import seod.files.shipped; print(seod.files.shipped.{folder}_dir())"
    found = Path(run([installed / "python", "-c", code], tmp_path).strip())
    assert found.is_relative_to(installed.parent)
    for name in SHIPPED[folder]:
        assert (found / name).read_bytes() == (REPO / folder / name).read_bytes()


def test_command_says_its_version(installed: Path, tmp_path: Path) -> None:
    assert seod.__version__ in run([installed / "seod", "--version"], tmp_path)


@pytest.mark.parametrize("name", ["virtual.yaml", "can.yaml"])
def test_installed_rig_files_are_valid(name: str, installed: Path, tmp_path: Path) -> None:
    run([installed / "seod", "check", installed.parent / "share" / "seod" / "configs" / name], tmp_path)
