"""The installer's calls of pip: what is locked by hash, and the wheel, which no lock knows."""

from __future__ import annotations

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
