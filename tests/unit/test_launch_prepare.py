"""Before the daemon starts: the simulated plant is compiled where it is not yet, and that is said once."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.launch import daemon
from seod.launch.daemon import LaunchError, prepare
from sim import cache

if TYPE_CHECKING:
    from collections.abc import Collection


@pytest.fixture
def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Compilations that were asked for; each leaves the files that numba would leave."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(cache, "cache_folder", cache.cache_folder.__wrapped__)
    monkeypatch.setattr(daemon, "cache_folder", cache.cache_folder)
    done: list[str] = []

    def compile_plant(kinds: Collection[str]) -> None:
        assert list(kinds) == ["reduced"]
        done.append("plant")
        folder = cache.cache_folder()
        assert folder is not None
        for name in ("arrive", "look"):
            (folder / f"plant.{name}-34.py311.nbi").touch()

    monkeypatch.setattr(daemon, "compile_plant", compile_plant)
    return done


def test_a_cold_cache_is_filled_once_and_said(
    compiled: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = load_rig(configs_dir() / "virtual.yaml")
    prepare(config)
    prepare(config)
    assert compiled == ["plant"]
    assert capsys.readouterr().out == "compiling the plant (once)\n"
    assert [folder.parent for folder in tmp_path.glob("seod/kernel-*")] == [tmp_path / "seod"]


def test_a_rig_on_a_bus_needs_no_plant(compiled: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    prepare(load_rig(configs_dir() / "can.yaml"))
    assert (compiled, capsys.readouterr().out) == ([], "")


def test_without_a_folder_the_loop_compiles_and_it_is_said_how_to_mend_that(
    compiled: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("NUMBA_CACHE_DIR", "CACHE_DIRECTORY", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, "/proc/nowhere")
    prepare(load_rig(configs_dir() / "virtual.yaml"))
    assert compiled == []
    assert "set NUMBA_CACHE_DIR" in capsys.readouterr().out


def test_a_plant_that_cannot_be_compiled_is_no_traceback(
    compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_kinds: Collection[str]) -> None:
        raise subprocess.CalledProcessError(1, "python")

    monkeypatch.setattr(daemon, "compile_plant", fail)
    with pytest.raises(LaunchError, match="cannot be compiled"):
        prepare(load_rig(configs_dir() / "virtual.yaml"))


def test_the_services_own_cache_serves_where_nothing_else_is_named(
    compiled: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("CACHE_DIRECTORY", str(tmp_path / "var"))
    folder = cache.cache_folder()
    assert folder is not None
    assert folder.parent == tmp_path / "var" / "seod"


def test_a_state_of_the_sources_has_a_folder_of_its_own(
    compiled: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = cache.cache_folder()
    copies = tmp_path / "sim"
    copies.mkdir()
    for name in cache.SOURCES:
        (copies / name).parent.mkdir(exist_ok=True)
        (copies / name).write_bytes((Path(cache.__file__).parent / name).read_bytes())
    monkeypatch.setattr(cache, "__file__", str(copies / "cache.py"))
    elsewhere = cache.cache_folder()
    assert elsewhere != before  # numba shares none between folders
    (copies / "physics.py").write_text("changed")
    assert cache.cache_folder() not in (elsewhere, before)


def test_every_module_with_machine_code_is_one_of_the_sources() -> None:
    folder = Path(cache.__file__).parent
    modules = [each for each in folder.rglob("*.py") if "from sim.compiled import" in each.read_text()]
    compiled_ones = {each.relative_to(folder).as_posix() for each in modules}
    assert {"kernel.py", "plant.py", "hydraulics/motion.py"} <= compiled_ones <= set(cache.SOURCES)
