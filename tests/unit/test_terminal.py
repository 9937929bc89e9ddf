"""What a person is asked and shown on a terminal, word for word."""

from __future__ import annotations

import io
import os
import pty
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from seod.terminal import console as consoles
from seod.terminal.progress import bar
from seod.terminal.text import figure

REPO = Path(__file__).parents[2]


def on_a_pty(*words: str | Path, answer: str) -> tuple[int, str]:
    """Exit code and all that a command shows on a terminal of its own, with this line typed beforehand."""
    ours, theirs = pty.openpty()
    os.write(ours, f"{answer}\n".encode())
    told = bytearray()
    with subprocess.Popen(
        [sys.executable, "-m", "seod.cli", *map(str, words)], stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        while True:
            try:
                told += os.read(ours, 4096)
            except OSError:  # the last one that had the terminal open is gone
                break
    os.close(ours)
    return process.returncode, told.decode()


@pytest.mark.slow
def test_the_question_before_anything_moves_shows_its_choices(tmp_path):
    folder = tmp_path / "rigs [old]" / "[red]motor[/]"
    folder.mkdir(parents=True)
    rig = shutil.copy(REPO / "configs" / "virtual.yaml", folder / "rig[1].yaml")
    code, told = on_a_pty("calibrate", rig, answer="n")
    assert "motor will move, up and down through 60 % of the travel. Go on? [y/N]" in " ".join(told.split())
    assert "not wanted" in told
    assert code != 0


def test_figures_of_a_table_keep_their_digits():
    values = 2.3, 2.31, 157.2, 1571.0, 0.029, 0.0, -0.5
    assert [figure(each, 3) for each in values] == [
        "2.30", "2.31", "157", "1.57e+03", "0.0290", "0.00", "-0.500",
    ]  # fmt: skip


def test_words_with_brackets_and_colons_are_printed_as_they_are():
    page = io.StringIO()
    consoles.console(page).print("[red]run[/].csv :smile: [y/N] [/]")
    assert page.getvalue() == "[red]run[/].csv :smile: [y/N] [/]\n"


def test_a_table_keeps_brackets_in_titles_and_cells():
    table = Table("omega_n [rad/s]")
    table.add_row("[bold]2.3[/] [95 %]")
    told = consoles.as_text(table, width=60)
    assert "omega_n [rad/s]" in told
    assert "[bold]2.3[/] [95 %]" in told


def test_a_bar_keeps_the_name_of_a_file_with_brackets():
    talk = Console(file=io.StringIO(), force_terminal=True, width=100)
    with bar(talk) as show:
        show("run[/]2[red].csv", 0.5)
    assert "run[/]2[red].csv" in talk.file.getvalue()
    assert "50%" in talk.file.getvalue()


def test_nothing_else_makes_a_console_that_reads_markup():
    sources = [path for folder in ("seod", "sim", "drivers") for path in (REPO / folder).rglob("*.py")]
    made = {path.relative_to(REPO).as_posix() for path in sources if " Console(" in path.read_text()}
    assert made == {"seod/terminal/console.py"}
