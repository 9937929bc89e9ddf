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
from tests import wheels

REPO = Path(__file__).parents[1]

SHIPPED = {
    "configs": ["virtual.yaml", "can.yaml", "motor.dbc", "seod-rig.schema.json"],
    "systemd": ["seod@.service", "seod-can@.service", "serial.conf", "install.py"],
}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built wheel."""
    return wheels.built(tmp_path_factory.mktemp("dist"))


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


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_pipx_installs_it_for_one_user(wheel: Path, tmp_path: Path) -> None:
    """Dependencies are this environment's: only pipx's own pip comes from the index."""
    own = wheels.with_these_packages(tmp_path / "wheels", wheel)
    folders = {"PIPX_HOME": "pipx", "PIPX_BIN_DIR": "bin", "PIPX_MAN_DIR": "man"}
    environment = os.environ | {name: str(tmp_path / folder) for name, folder in folders.items()}
    environment.pop("PYTHONPATH", None)
    pipx = [sys.executable, "-m", "pipx"]
    subprocess.run([*pipx, "upgrade-shared"], env=environment, check=True)
    offline = environment | {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(own.parent)}
    words = [*pipx, "install", "--backend", "pip", "--python", sys.executable, str(own)]
    subprocess.run(words, env=offline, cwd=tmp_path, check=True)
    command = tmp_path / "bin" / "seod"
    assert seod.__version__ in run([command, "--version"], tmp_path)
    (tmp_path / "run.csv").write_text(recording())
    assert "omega_n" in run([command, "identify", "run.csv", "--units", "y=rad", "--json"], tmp_path)


def recording() -> str:
    """Two seconds of an oscillation under a relay, as a logger writes them."""
    made = seod.simulate(seod.RigFile.shipped(), duration=2.0, seed=1).to_columns()
    rows = zip(made["t"], made["u"], made["y"], strict=True)
    return "t,u,y\n" + "".join(f"{t},{u},{y}\n" for t, u, y in rows)


@pytest.mark.parametrize("name", ["drivers", "sim"])
@pytest.mark.parametrize("place", ["path", "folder"])
def test_another_projects_packages_are_told_and_left_alone(
    name: str, place: str, installed: Path, tmp_path: Path
) -> None:
    other = tmp_path / name / "__init__.py"
    other.parent.mkdir()
    other.write_text("raise SystemExit('imported')\n")
    told = f"seod's package {name!r} is hidden by another ({other})"
    environment = {"PATH": os.defpath, "HOME": str(tmp_path)}
    words: list[str | Path] = [installed / "seod", "--version"]
    if place == "path":
        environment["PYTHONPATH"] = str(tmp_path)
    else:
        words = [installed / "python", "-m", "seod.cli", "--version"]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith(f"seod: {told}: give seod an environment of its own, as pipx does")
    code = "import seod; seod.identify('run.csv')"
    words = [installed / "python", "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1].startswith(f"ImportError: {told}")


@pytest.mark.parametrize("name", ["virtual.yaml", "can.yaml"])
def test_installed_rig_files_are_valid(name: str, installed: Path, tmp_path: Path) -> None:
    run([installed / "seod", "check", installed.parent / "share" / "seod" / "configs" / name], tmp_path)
