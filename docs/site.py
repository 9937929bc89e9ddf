"""What MkDocs adds: reference pages made from the program, and links that leave the documents.

A file of the repository that is no page, such as `../configs/virtual.yaml`, is named and not linked.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File
from typer.testing import CliRunner

from seod.cli import app
from seod.commands.common import names
from sim.effects import EFFECTS

REPO = Path(__file__).parents[1]
SHOWN = {".md", ".png", ".svg"}
"""What the site has of the folder: pages and pictures."""
_OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+((?!docs/)[^)\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made."""
    for name, make in PAGES.items():
        files.append(File.generated(config, name, content=make()))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to files that are not pages become their names; folders of pages their first one."""
    here = Path(page.file.src_uri).parent

    def link(found: re.Match[str]) -> str:
        text, target = found[1], found[2]
        inside = (REPO / "docs" / here / found[0].rpartition("(")[2].rstrip(")")).resolve()
        if inside.is_relative_to(REPO / "docs") and inside.suffix in SHOWN:
            return found[0]
        return f"{text.strip('`')} (`{target}`)" if text.strip("`") != target else f"`{target}`"

    markdown = _OUTSIDE.sub(link, markdown)
    return re.sub(r"\]\((\.\./)?decisions\)", r"](\1decisions/index.md)", markdown)


EXIT_CODES = [
    "| exit code | means |",
    "| --- | --- |",
    "| 0 | done |",
    "| 1 | refused or failed; stderr has the reason, in a sentence |",
    "| 2 | wrong usage |",
    "| 78 | `seod run`: the rig file is wrong |",
    "| 130 | ended by Ctrl-C |",
    "| 141 | the reader of a pipe left, such as `head`: ended by SIGPIPE, without a message |",
    "",
    "`seod archive` has [its own](../archive.md).",
    "",
]


def commands() -> str:
    """Every command with its options, as `--help` tells them."""
    lines = ["# Commands", "", "Options that are numbers take a unit: `0.5`, `400 mV`, `4 ms`.", ""]
    lines += EXIT_CODES
    for name in names():
        text = CliRunner().invoke(app, [*name.split(), "--help"], prog_name="seod").stdout
        lines += [f"## seod {name}", "", "```text", text.strip(), "```", ""]
    return "\n".join(lines)


def rig_file() -> str:
    """The rig file's sections and keys, from its schema."""
    schema = json.loads((REPO / "configs" / "seod-rig.schema.json").read_text())
    lines = [
        "# Rig file",
        "",
        "Made from `configs/seod-rig.schema.json`, by which editors complete rig files.",
        "",
    ]
    definitions = schema.get("$defs", {})
    for title, section in {"Top level": schema, **definitions}.items():
        keys = section.get("properties")
        if not keys:
            continue
        lines += [f"## {title}", "", _cell(section.get("description", "")), "", "| key | default | means |"]
        lines += ["| --- | --- | --- |"]
        needed = set(section.get("required", ()))
        for key, each in keys.items():
            default = "required" if key in needed else _default(each)
            lines.append(f"| `{key}` | {default} | {_cell(each.get('description', ''))} |")
        lines.append("")
    return "\n".join(lines)


def _default(each: dict[str, Any]) -> str:
    value = each.get("default")
    return "" if value is None else f"`{json.dumps(value)}`"


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").replace("<", "&lt;")


def causes() -> str:
    """What a diagnosis can name, with its physics and its parameters."""
    lines = [
        "# Causes and effects",
        "",
        "Names that `seod diagnose` gives to causes, and that `seod simulate --effect` switches on.",
        "Units are those of the plant. [The model](../model.md) has the equations.",
        "",
        "| name | what it is | parameters |",
        "| --- | --- | --- |",
    ]
    for effect in EFFECTS.values():
        told = ", ".join(f"`{each.name}` [{each.unit}]" for each in effect.parameters)
        lines.append(f"| `{effect.name}` | {_cell(effect.physics)} | {told} |")
    return "\n".join([*lines, ""])


def decisions() -> str:
    """A list of all decisions."""
    lines = ["# Decisions", "", "Why things are as they are, a page each.", ""]
    for path in sorted((REPO / "docs" / "decisions").glob("[0-9]*.md")):
        title = path.read_text().partition("\n")[0].lstrip("# ")
        lines.append(f"- [{title}]({path.name})")
    return "\n".join([*lines, ""])


PAGES = {
    "reference/commands.md": commands,
    "reference/rig-file.md": rig_file,
    "reference/causes.md": causes,
    "decisions/index.md": decisions,
}
