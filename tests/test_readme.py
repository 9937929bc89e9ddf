"""What the README shows works as it stands there."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.peers import Program, port_of, port_open, until, write_rig_file
from tests.scripts import loaded

if TYPE_CHECKING:
    from collections.abc import Iterator

REPO = Path(__file__).parents[1]
README = (REPO / "README.md").read_text()


def blocks(language: str) -> list[str]:
    """The README's code blocks in one language."""
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def headings(page: Path) -> set[str]:
    """Places in a page that a link may name."""
    lines = re.findall(r"^#+ (.*)", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", line.lower()).replace(" ", "-") for line in lines}


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Where a daemon on the virtual rig listens, excited as by `make run`."""
    folder = tmp_path_factory.mktemp("daemon")
    config = write_rig_file(folder)
    number = port_of(config)
    program = Program(folder / "log", "run", config, "--start")
    until("the port", lambda: port_open(number) or program.process.poll() is not None)
    yield number
    program.stop()


@pytest.mark.processes
def test_the_python_client(port: int) -> None:
    (code,) = [block for block in blocks("python") if "Client" in block]
    assert len(code.strip().splitlines()) == 5
    code = code.replace("Client()", f"Client(port={port})").replace("timeout=10", "timeout=6")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert any(re.fullmatch(r"ok 0\.2\d+ 11\d\.\d+", line) for line in done.stdout.splitlines()), done.stdout


@pytest.mark.processes
def test_the_raw_client(port: int) -> None:
    (code,) = [block for block in blocks("sh") if "/dev/tcp" in block]
    code = code.replace("7600", str(port))
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
    assert '"axis":"motor"' in done.stdout


@pytest.mark.timeout(600)  # it may have to compile the kernel first
def test_the_simulated_recording(tmp_path: Path) -> None:
    (line,) = [
        line
        for block in blocks("sh")
        for line in block.splitlines()
        if "seod simulate" in line and "truth.csv" in line
    ]
    words = line.replace("configs/", f"{REPO}/configs/").split()
    done = subprocess.run(
        [sys.executable, "-m", "seod.cli", *words[1:]], cwd=tmp_path, capture_output=True, check=True
    )
    assert json.loads(done.stdout)["truth"]["effects"]["valve_deadband"] == {"half_width": 0.05}
    assert (tmp_path / "truth.csv").read_text().startswith("t,u,y [rad],t_u\n")


@pytest.mark.timeout(600)
def test_what_commands_print_is_what_the_pages_show() -> None:
    outputs = loaded(REPO / "docs" / "outputs.py")
    shown = [(page, found) for page in outputs.PAGES for found in outputs.SHOWN.finditer(page.read_text())]
    assert any(page.name == "recording.md" for page, _ in shown)
    for page, found in shown:
        now, then = (
            _words_and_numbers(text) for text in (outputs.printed(found["commands"]), found["output"])
        )
        assert now[0] == then[0], f"{page}: make outputs"
        assert [text for text, told in zip(now[1], then[1], strict=True) if not _alike(text, told)] == [], (
            page
        )


def test_another_layout_reads_alike_but_another_word_or_number_does_not() -> None:
    shown = " ─────────\n error   2.3 %   0.029   11 %\n"
    words, numbers = _words_and_numbers(shown)
    assert _words_and_numbers("──────── error 2.31 % 0.0288 12 %")[0] == words
    assert all(map(_alike, numbers, ["2.31", "0.0288", "12 %"]))
    assert _words_and_numbers(shown.replace("error", "noise"))[0] != words
    assert not any(map(_alike, numbers, ["2.5", "0.031", "13 %"]))
    assert not _alike("2", "3")


RULES = re.compile(r"[\u2500-\u257f]+")
"""Lines of tables: as long as their columns are wide."""
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?(?: %)?")


def _words_and_numbers(text: str) -> tuple[list[str], list[str]]:
    """Of a printed text, whatever its layout: another processor may round the last digit otherwise."""
    plain = " ".join(RULES.sub(" ", text).split())
    return NUMBER.sub("#", plain).split(), NUMBER.findall(plain)


def _alike(one: str, other: str) -> bool:
    """Whether two numbers differ by 2 % or the last digit shown at most; counts by nothing."""
    if one.isdigit() and other.isdigit():
        return one == other
    a, b = (text.removesuffix(" %") for text in (one, other))
    digit = 10.0 ** -min(len(text.partition(".")[2]) for text in (a, b))
    return float(a) == pytest.approx(float(b), rel=0.02, abs=1.001 * digit)


def test_its_files_and_make_targets_exist() -> None:
    texts = README + (REPO / "docs" / "development.md").read_text()
    for path, heading in re.findall(r"\]\((?!http)([^)#]+)#?([^)]*)\)", README):
        assert (REPO / path).exists(), path
        assert not heading or heading in headings(REPO / path), (path, heading)
    targets = re.findall(r"^([a-z]+):", (REPO / "Makefile").read_text(), re.MULTILINE)
    assert set(re.findall(r"^make ([a-z]+)", texts, re.MULTILINE)) <= set(targets)


def test_it_is_short_and_shows_both_pictures() -> None:
    assert len(README.splitlines()) < 120
    assert re.findall(r"!\[[^]]*\]\(([^)]+)\)", README) == ["docs/img/watch.svg", "docs/img/report.png"]


def test_its_commands_exist() -> None:
    from seod.cli import app

    known = {command.name or command.callback.__name__.rstrip("_") for command in app.registered_commands}
    shown = {word for block in blocks("sh") for word in re.findall(r"\bseod ([a-z]+)", block)}
    assert shown
    assert shown <= known
