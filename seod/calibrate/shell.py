"""What `seod calibrate` asks, prints and writes."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seod.calibrate.command import as_text, changes
from seod.calibrate.command import calibrate as measure
from seod.calibrate.procedure import CalibrationError
from seod.config.edit import difference, edited, replace_file
from seod.config.load import load_text
from seod.config.redact import redacted
from seod.config.yaml_lines import parse
from seod.terminal.console import ask, console

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from seod.config.errors import KeyPath
    from seod.config.model import RigConfig


@dataclass(frozen=True, slots=True)
class Options:
    """Options of the command."""

    dry_run: bool
    yes: bool
    as_json: bool


def calibrate(config: RigConfig, path: Path, axes: list[str], pressures: int, options: Options) -> None:
    """Ask, measure, print, and write into the rig file.

    Raises:
        CalibrationError: Not wanted, or it cannot be done.
        ConfigErrors: The rig file would not load any more; it was not changed.
        OSError: It cannot be written.
    """
    talk = console()
    before = path.read_text(encoding="utf-8-sig")
    if not options.yes:
        agree(talk, f"{', '.join(axes)} will move, up and down through 60 % of the travel. Go on?")
    answers = measure(config, path, axes, pressures, talk)
    written = parse(before).value
    found: dict[KeyPath, Any] = {}
    for name in axes:
        found |= changes(name, config.axes[name], answers[name], written)
    after = edited(before, found)
    load_text(after, str(path), path.parent.resolve())
    said = [as_text(name, config.axes[name], answers[name]) for name in axes]
    text = json.dumps(answers) if options.as_json else "\n".join(said)
    sys.stdout.write(text + "\n")
    change = difference(path, redacted(before), redacted(after))
    if options.dry_run:
        (sys.stderr if options.as_json else sys.stdout).write(change)
        return
    if not options.yes:
        talk.print(change)
        agree(talk, f"Write this into {path}?")
    if path.read_text(encoding="utf-8-sig") != before:
        raise CalibrationError(f"{path} was changed meanwhile: nothing is written")
    backup = replace_file(path, after)
    talk.print(f"{path} is written, {backup} is what it was; restart the daemon to use it")


def agree(talk: Console, question: str) -> None:
    """Go on only with a yes.

    Raises:
        CalibrationError: It was something else.
    """
    if not sys.stdin.isatty():
        raise CalibrationError("nobody can be asked here: `--yes` agrees beforehand")
    if ask(talk, f"{question} [y/N] ").lower() not in ("y", "yes"):
        raise CalibrationError("not wanted: nothing is written")
