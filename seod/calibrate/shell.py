"""What `seod calibrate` asks, prints and writes."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import Console

from seod.calibrate.command import as_text, changes
from seod.calibrate.command import calibrate as measure
from seod.calibrate.procedure import CalibrationError
from seod.config.edit import difference, edited, replace_file
from seod.config.load import load_text

if TYPE_CHECKING:
    from pathlib import Path

    from seod.config.model import RigConfig


@dataclass(frozen=True, slots=True)
class Wishes:
    """Options of the command."""

    dry_run: bool
    yes: bool
    as_json: bool


def calibrate(config: RigConfig, path: Path, axes: list[str], pressures: int, wishes: Wishes) -> None:
    """Ask, measure, print, and write into the rig file.

    Raises:
        CalibrationError: Not wanted, or it cannot be done.
        ConfigErrors: The rig file would not load any more; it was not changed.
        OSError: It cannot be written.
    """
    talk = Console(stderr=True)
    before = path.read_text(encoding="utf-8-sig")
    if not wishes.yes:
        agree(talk, f"{', '.join(axes)} will move, up and down through 60 % of the travel. Go on?")
    answers = measure(config, path, axes, pressures, talk)
    found = {
        key: new for name in axes for key, new in changes(name, config.axes[name], answers[name]).items()
    }
    after = edited(before, found)
    load_text(after, str(path), path.parent.resolve())
    text = json.dumps(answers) if wishes.as_json else "\n".join(as_text(name, answers[name]) for name in axes)
    sys.stdout.write(text + "\n")
    change = difference(path, before, after)
    if wishes.dry_run:
        (sys.stderr if wishes.as_json else sys.stdout).write(change)
        return
    if not wishes.yes:
        talk.print(change, markup=False, highlight=False)
        agree(talk, f"Write this into {path}?")
    if path.read_text(encoding="utf-8-sig") != before:
        raise CalibrationError(f"{path} was changed meanwhile: nothing is written")
    backup = replace_file(path, after)
    talk.print(f"{path} is written, {backup} is what it was; restart the daemon to use it", highlight=False)


def agree(console: Console, question: str) -> None:
    """Go on only with a yes.

    Raises:
        CalibrationError: It was something else.
    """
    if not sys.stdin.isatty():
        raise CalibrationError("nobody can be asked here: `--yes` agrees beforehand")
    if console.input(f"{question} [y/N] ").strip().lower() not in ("y", "yes"):
        raise CalibrationError("not wanted: nothing is written")
