"""The wheel as users install it: far from the checkout, with nothing but its own files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

import seod

REPO = Path(__file__).parents[1]

SHIPPED = [
    "configs/virtual.yaml",
    "configs/can.yaml",
    "configs/motor.dbc",
    "configs/seod-rig.schema.json",
    "systemd/seod@.service",
]


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


def test_top_level_names(wheel: Path) -> None:
    names = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    version = f"seod-{seod.__version__}"
    assert names == {"seod", "drivers", "sim", f"{version}.dist-info", f"{version}.data"}


def test_typed_and_licensed(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {"seod/py.typed", "drivers/py.typed", "sim/py.typed"} <= set(names)
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_shipped_files_are_found(installed: Path, tmp_path: Path) -> None:
    code = "import json, sys, seod.paths as p; print(json.dumps([str(p.data_file(n)) for n in sys.argv[1:]]))"
    found = json.loads(run([installed / "python", "-c", code, *SHIPPED], tmp_path))
    for name, path in zip(SHIPPED, found, strict=True):
        assert Path(path).is_relative_to(installed.parent)
        assert Path(path).read_bytes() == (REPO / name).read_bytes()


def test_found_in_a_checkout_too() -> None:
    from seod.paths import data_file

    assert [data_file(name) for name in SHIPPED] == [REPO / name for name in SHIPPED]
    with pytest.raises(FileNotFoundError, match=r"configs/none\.yaml"):
        data_file("configs/none.yaml")


def test_command_says_its_version(installed: Path, tmp_path: Path) -> None:
    assert seod.__version__ in run([installed / "seod", "--version"], tmp_path)


@pytest.mark.parametrize("name", ["virtual.yaml", "can.yaml"])
def test_installed_rig_files_are_valid(name: str, installed: Path, tmp_path: Path) -> None:
    run([installed / "seod", "check", installed.parent / "share" / "seod" / "configs" / name], tmp_path)
