"""The installer's calls of pip: what is locked by hash, and the wheel, which no lock knows."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from tests.scripts import loaded

PATH = Path(__file__).parents[2] / "systemd" / "install.py"


@pytest.fixture
def installer() -> Any:
    return loaded(PATH)


@pytest.mark.parametrize("locked", [False, True])
def test_a_lock_is_met_by_hash_and_the_wheel_comes_after(
    installer: Any, locked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[list[str]] = []
    monkeypatch.setattr(installer, "_run", lambda command: calls.append(command) or "")
    monkeypatch.setattr(installer, "_pip", lambda _: ["pip"])
    monkeypatch.setattr(installer.venv, "create", lambda *_, **__: None)
    house = tmp_path / "house"
    house.mkdir()
    wheel = house / "seod-1.2.3-py3-none-any.whl"
    wheel.touch()
    service = installer.Service(tmp_path / "opt", tmp_path)
    release = service._make(house, tmp_path / "lock" if locked else None)
    assert release.name == "1.2.3-1"
    offline = ["pip", "install", "--quiet", "--no-index", "--find-links", str(house)]
    lock = [[*offline, "--require-hashes", "--requirement", str(tmp_path / "lock")]] if locked else []
    assert calls == [*lock, [*offline, *(["--no-deps"] if locked else []), str(wheel)]]


def wheel(folder: Path, name: str, version: str, code: str = "") -> Path:
    """A wheel of one empty module, or of one with this code."""
    path, about = folder / f"{name}-{version}-py3-none-any.whl", f"{name}-{version}.dist-info"
    with zipfile.ZipFile(path, "w") as out:
        out.writestr(f"{name}.py", code)
        out.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        out.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        out.writestr(f"{about}/RECORD", "")
    return path


@pytest.mark.slow
def test_what_was_built_into_the_wheelhouse_is_met_by_its_own_hash(tmp_path: Path) -> None:
    wheel(tmp_path, "built_here", "1.0")
    wheel(tmp_path, "seod", "1.2.3")
    lock = tmp_path / "wheels.lock"
    lock.write_text(loaded(PATH.with_name("lock_wheelhouse.py")).locked(tmp_path))
    assert "seod" not in lock.read_text()
    words = ["install", "--no-index", "--find-links", tmp_path, "--require-hashes", "-r", lock]
    words += ["--disable-pip-version-check", "--target"]
    pip = [sys.executable, "-m", "pip", *words]
    subprocess.run([*pip, tmp_path / "there"], check=True, capture_output=True)
    assert (tmp_path / "there" / "built_here.py").exists()
    wheel(tmp_path, "built_here", "1.0", "exchanged = True")
    refused = subprocess.run([*pip, tmp_path / "not"], capture_output=True, text=True, check=False)
    assert refused.returncode != 0
    assert "DO NOT MATCH THE HASHES" in refused.stderr


def test_the_wheelhouses_own_lock_is_met_unless_another_is_given(
    installer: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[list[str]] = []
    monkeypatch.setattr(installer, "_run", lambda command: calls.append(command) or "")
    monkeypatch.setattr(installer, "_pip", lambda _: ["pip"])
    monkeypatch.setattr(installer.venv, "create", lambda *_, **__: None)
    (tmp_path / "seod-1.2.3-py3-none-any.whl").touch()
    own = tmp_path / "wheels.lock"
    own.touch()
    for given, met in ((None, own), (tmp_path / "other.lock", tmp_path / "other.lock")):
        calls.clear()
        installer.Service(tmp_path / "opt", tmp_path)._make(tmp_path, given)
        assert calls[0][-1] == str(met)
