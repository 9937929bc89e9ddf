"""Words and sentences of the documents: `python docs/prose.py`, part of `make lint`.

Prints the 95th percentile of words in a sentence, page by page. Fails where one is above `LONGEST`, or
where a page has a house word in place of an engineer's. Tables, code, and pages made by programs do not
count. Decisions and the changelog say what was said at their time: they are reported only.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from typing import Final, NamedTuple

REPO: Final = Path(__file__).parents[1]
LONGEST: Final = 30
"""Words of the sentence that 95 % of a page's are not longer than: what is read once and understood."""
FEWEST: Final = 10
"""Sentences below which a page has no 95th percentile: there its longest sentence is reported."""
MADE: Final = {"docs/accuracy-tables.md", "docs/league-tables.md"}
PUBLIC: Final = ("seod/api", "seod/client", "seod/testing", "seod/data/recording.py", "drivers/base.py")
"""Whose docstrings are pages too: what a user of the Python interface, or the author of a driver, reads."""


class Rule(NamedTuple):
    """A word that is not ours to use so.

    Attributes:
        misused: What is looked for, in a text on one line, without code and tables.
        instead: What engineers say.
        wrong: A sentence that it finds.
        right: One with the same word that it leaves alone.
    """

    misused: str
    instead: str
    wrong: str
    right: str


RULES: Final = (
    Rule(
        r"(?<!to )(?<!can )\bplay\b(?! operator)",
        "backlash",
        "the gear has play",
        "a play operator, which others can play",
    ),
    Rule(
        r"\b(?:can|cannot|could|may|might) (?:not |hardly |only |then )*be told\b",
        "identified, identifiable, distinguished",
        "the lag cannot be told from a delay",
        "the delay is told by the driver",
    ),
    Rule(r"\b(?:kept|put|set|laid) aside\b", "held out", "windows kept aside", "aside from that"),
    Rule(
        r"\b(?:a|an|its|the|of) swing\b",
        "peak to peak, oscillation",
        "the swing of the cylinder",
        "the plant swings about its reference",
    ),
    Rule(r"\bstretch(?:es)?\b", "segment", "a stretch of the recording", "a segment of the recording"),
    Rule(
        r"\bpieces? of (?:the |a |one )?(?:record|recording|data|log)s?\b",
        "segment",
        "a piece of the recording",
        "a piece of iron",
    ),
    Rule(r"\bwish(?:es)?\b", "options", "the user's wishes", "the user's options"),
    Rule(
        r"\b(?:what|% (?:of \w+ )?|nothing|something) ?(?:is|are) left\b(?! (?:out|of|to)\b)",
        "residual",
        "noise is in what is left; 4 % are left",
        "what is left out of the file",
    ),
    Rule(
        r"\bbristles? (?:friction|model)\b", "LuGre", "the bristle model", "the bristles of the LuGre model"
    ),
    Rule(
        r"\b(?:valve's overlap|overlap of the valve|behind an overlap|flat of the valve|valve's flat)\b",
        "deadband",
        "the valve's overlap is 0.1 V",
        "windows that overlap",
    ),
    Rule(
        r"\b(?:grid cells?|cells? of (?:the|a) grid)\b",
        "grid point",
        "a cell of the grid",
        "a cell of a table",
    ),
)
_RECORD: Final = re.compile(r"\brecords? \d{4,}\b")
"""Numbers of records belong into the log of the diagnosis."""
_SHORT: Final = re.compile(r"\b(Eq|Eqs|Fig|Figs|No|vs|cf|e\.g|i\.e|approx|resp|Sec|p|pp)\.")
_LINK: Final = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")


class Page(NamedTuple):
    """What a page says.

    Attributes:
        name: Its path in the repository.
        blocks: Paragraphs and items of lists, a line each, without code.
        judged: Whether the length of its sentences counts.
    """

    name: str
    blocks: list[str]
    judged: bool = True


def blocks(markdown: str) -> list[str]:
    """Paragraphs and items of lists of a page, a line each; code of a line counts as one word."""
    text = re.sub(r"<!--.*?-->", "", markdown, flags=re.DOTALL)
    text = re.sub(r"^([ \t]*)(```|~~~).*?^\1\2[ \t]*$", "\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"`+[^`\n]*(?:\n[^`\n]+)?`+", "CODE", text)
    found = [""]
    for line in text.splitlines():
        said = line.strip().lstrip(">").strip()
        item = re.match(r"(?:[-*+]|\d+\.) +(?=\S)", said)
        if not said or item or said.startswith(("#", "|", "!!!", "---")) or _is_code(line, found[-1]):
            found.append("")
        if said.startswith(("#", "|", "!!!", "---")) or _is_code(line, found[-1]):
            continue
        found[-1] += " " + (said[item.end() :] if item else said)
    return [_LINK.sub(r"\1", block).strip() for block in found if block.strip()]


def _is_code(line: str, before: str) -> bool:
    """Whether a line is code by its indent: that of a paragraph or an item goes on."""
    return line.startswith("    ") and not before and not re.match(r"\s+(?:[-*+]|\d+\.) ", line)


def docstrings(source: str) -> list[str]:
    """Paragraphs of all public docstrings of a module; what is said of an argument is one each."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if getattr(node, "name", "").startswith("_"):
            continue
        text = ast.get_docstring(node) or ""
        text = re.sub(r"^( {4,})(\w+): ", r"\n- ", text, flags=re.MULTILINE)
        text = re.sub(
            r"^(Args|Returns|Raises|Yields|Attributes|Note|Example):$", "", text, flags=re.MULTILINE
        )
        found += blocks(re.sub(r"\n {8,}", "\n", text))
    return found


def sentences(block: str) -> list[str]:
    """Sentences of a paragraph."""
    whole = _SHORT.sub(r"\1", block)
    return [part for part in re.split(r"(?<=[.!?])[)\"*_]*\s+(?=[^a-z])", whole) if part.strip()]


def words(sentence: str) -> int:
    """How many words a sentence has; a formula's signs are none."""
    return sum(any(sign.isalnum() for sign in word) for word in sentence.split())


def length(page: Page) -> int:
    """Words of the sentence that 95 % of a page's are not longer than; of its longest where it has few."""
    counts = sorted(words(each) for block in page.blocks for each in sentences(block))
    if not counts:
        return 0
    return counts[-1] if len(counts) < FEWEST else counts[int(0.95 * (len(counts) - 1))]


def misused(page: Page) -> list[str]:
    """House words of a page: what stands there, and what should."""
    told = []
    for block in page.blocks:
        for rule in RULES:
            told += [
                f"{page.name}: {found.group()!r}, better: {rule.instead} (in: {_around(block, found)})"
                for found in re.finditer(rule.misused, block, re.IGNORECASE)
            ]
        if page.name != "docs/diagnosis-log.md":
            told += [f"{page.name}: {number}: a record's number" for number in _RECORD.findall(block)]
    return told


def _around(block: str, found: re.Match[str]) -> str:
    return "…" + block[max(0, found.start() - 30) : found.end() + 30] + "…"


def pages() -> list[Page]:
    """All that is read: documents, and docstrings of what is public."""
    paths = [REPO / "README.md", REPO / "SECURITY.md", *sorted((REPO / "docs").rglob("*.md"))]
    apart = [path for path in paths if path.parent.name == "decisions"]
    found = []
    for path in [*(each for each in paths if each not in apart), *apart, REPO / "CHANGELOG.md"]:
        name = path.relative_to(REPO).as_posix()
        if name not in MADE:
            judged = path not in apart and name != "CHANGELOG.md"
            found.append(Page(name, blocks(path.read_text()), judged))
    for public in PUBLIC:
        path = REPO / public
        sources = [path] if path.suffix else sorted(path.glob("*.py"))
        found += [Page(each.relative_to(REPO).as_posix(), docstrings(each.read_text())) for each in sources]
    return found


def main() -> None:
    """Report all pages; exit with 1 where one is hard to read."""
    wrong: list[str] = []
    for page in pages():
        long = length(page)
        print(f"{long:3d} words  {page.name}{'' if page.judged else '  (reported only)'}")
        if not page.judged:
            continue
        wrong += misused(page)
        if long > LONGEST:
            wrong.append(f"{page.name}: 95 % of its sentences are up to {long} words long, not {LONGEST}")
    print(*wrong, sep="\n", file=sys.stderr)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
