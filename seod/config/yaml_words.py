"""What the YAML parser found wrong, in plain words, at the line where the mistake stands.

The parser tells where it could not go on; the mistake often is above: an open bracket, a missing colon.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from seod.config.tokens import RIGHTS

if TYPE_CHECKING:
    from collections.abc import Callable

    import yaml

CLOSING = {"[": "]", "{": "}"}
SHOWN = 40
"""Longest piece of a line that is quoted."""
TOKEN = re.compile(rf"({'|'.join(RIGHTS)}).*")
COLON = re.compile(r":(\s|$)")


class Words(NamedTuple):
    """A mistake: its line from 1, what is wrong, what would be right."""

    line: int
    message: str
    right: str = ""


@dataclass(frozen=True)
class Failure:
    """Where and why the parser gave up.

    Attributes:
        lines: The file.
        problem: The parser's own words.
        context: What it was at.
        at: Line where it gave up, from 0; within the file.
        column: Likewise the column.
        since: Line where what it was at began, from 0.
        since_column: Likewise the column.
        long_quote: First and last line of the last quoted text that goes over several lines; None for none.
    """

    lines: list[str]
    problem: str
    context: str
    at: int
    column: int
    since: int
    since_column: int
    long_quote: tuple[int, int] | None = None

    @property
    def found(self) -> str:
        """The last thing that the parser's words quote: what it came upon."""
        quoted = re.findall(r"'([^']*)'", self.problem)
        return quoted[-1] if quoted else ""

    def text(self, line: int) -> str:
        """A line without indentation and comment, shortened; of a token no more than its key."""
        text = re.sub(r"(^|\s)#.*", "", self.lines[line]).strip()
        text = TOKEN.sub(r"\1 ...", text)
        return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."

    def before(self, line: int) -> int | None:
        """The line before it that says something."""
        return next((k for k in range(line - 1, -1, -1) if self.text(k)), None)

    def indent(self, line: int) -> int:
        """Blanks before the text of a line."""
        return len(self.lines[line]) - len(self.lines[line].lstrip(" "))


def plain(error: yaml.MarkedYAMLError, text: str, long_quote: tuple[int, int] | None) -> Words:
    """The mistake behind an error of the parser.

    Args:
        error: The error.
        text: The file.
        long_quote: As of `Failure`.
    """
    lines = text.splitlines() or [""]
    at, since = error.problem_mark or error.context_mark, error.context_mark or error.problem_mark
    failure = Failure(
        lines,
        str(error.problem or ""),
        str(error.context or ""),
        min(at.line, len(lines) - 1) if at else 0,
        at.column if at else 0,
        min(since.line, len(lines) - 1) if since else 0,
        since.column if since else 0,
        long_quote,
    )
    for sign, explain in _KINDS:
        if re.search(sign, f"{failure.context}; {failure.problem}"):
            return explain(failure)
    return Words(failure.at + 1, f"not readable as YAML: {failure.problem or failure.context}")


def _tab(f: Failure) -> Words:
    return Words(f.at + 1, "a tab, where only blanks may stand", "blanks instead of the tab")


def _open_quote(f: Failure) -> Words:
    quote = f.lines[f.since][f.since_column : f.since_column + 1]
    return Words(
        f.since + 1, f"the quote {quote} is never closed", f"a second {quote} at the end of the text"
    )


def _escape(f: Failure) -> Words:
    right = 'single quotes, in which it means itself, or "\\\\" for each'
    return Words(f.at + 1, f"\\{f.found} in double quotes means nothing: a backslash begins an escape", right)


def _brackets(f: Failure) -> Words:
    opened = f.lines[f.since][f.since_column : f.since_column + 1]
    closing = CLOSING.get(opened, "]")
    if f.found in CLOSING.values():
        return Words(
            f.at + 1, f"the {opened} of line {f.since + 1} is closed by {f.found}", f"{closing} instead"
        )
    if f.found == "<stream end>" or (f.at > f.since and f.indent(f.at) <= f.indent(f.since)):
        return Words(f.since + 1, f"the {opened} is never closed", f"a {closing} at its end")
    between = "[1, 2]" if opened == "[" else "{a: 1, b: 2}"
    return Words(f.at + 1, f"a comma is missing between two entries of {opened} {closing}", between)


def _no_colon(f: Failure, line: int | None = None) -> Words:
    line = f.since if line is None else line
    text = f.text(line)
    key, glued, value = text.partition(":")
    if glued and value:
        return Words(line + 1, f"`{text}` has no blank after its colon", f"`{key}: {value}`")
    first, _, rest = text.partition(" ")
    right = f"`{first}: {rest}`" if rest else f"`{text}:`"
    return Words(line + 1, f"`{text}` has no colon", right)


def _second_colon(f: Failure) -> Words:
    before = f.before(f.at)
    if COLON.search(f.lines[f.at][: f.column]):
        key, _, value = f.text(f.at).partition(": ")
        right = f'`{key}: "{value}"` for a text with a colon, or a line for each key'
        return Words(f.at + 1, "two keys in one line", right)
    if before is not None and not COLON.search(f.text(before)):
        return _no_colon(f, before)
    return _indented(f)


def _indented(f: Failure) -> Words:
    """A line that begins where none of those above it does."""
    before = f.before(f.at)
    above = "" if before is None else f", line {before + 1} by {f.indent(before)}"
    what = f"`{f.text(f.at)}` is indented by {f.indent(f.at)} blanks{above}: it belongs to nothing"
    return Words(f.at + 1, what, "as many blanks as the keys beside it have")


def _block(f: Failure) -> Words:
    """Something that cannot stand among keys, or among the entries of a list."""
    if f.long_quote is not None:
        first, last = f.long_quote
        what = f"the quote that begins here ends only in line {last + 1}"
        return Words(first + 1, what, "a second quote at the end of the text")
    if f.found in ("-", "<block sequence start>"):
        return Words(
            f.at + 1, "an entry of a list (-) among keys", "keys alone, or a list below a key of its own"
        )
    if f.found == "?" and "collection" in f.context:
        return Words(
            f.at + 1, f"`{f.text(f.at)}` stands among the entries of a list", "`- ` before each entry"
        )
    if f.found == "<scalar>" and f.lines[f.at][: f.column].rstrip().endswith(("'", '"')):
        return Words(f.at + 1, "text after the closing quote", "one text in quotes, or a # before a comment")
    return _indented(f)


def _nothing(f: Failure) -> Words:
    if f.found == "<stream end>":
        return _open_at_the_end(f)
    opening = {closing: opened for opened, closing in CLOSING.items()}.get(f.found)
    if opening:
        return Words(f.at + 1, f"a {f.found} without a {opening} before it", "both, or none")
    return Words(f.at + 1, f"{f.found!r} where a value should stand", "a value, or a text in quotes")


def _open_at_the_end(f: Failure) -> Words:
    """The file ends where a value should stand: within the last bracket that was opened."""
    line = next((k for k in range(f.at, -1, -1) if set(CLOSING) & set(f.lines[k])), f.at)
    opened = next((each for each in reversed(f.lines[line]) if each in CLOSING), "[")
    return Words(line + 1, f"the {opened} is never closed", f"a {CLOSING[opened]} at its end")


def _character(f: Failure) -> Words:
    return Words(f.at + 1, f"a value cannot begin with {f.found}", "the value in quotes")


def _document(f: Failure) -> Words:
    return Words(f.at + 1, "--- begins a second document", "one rig in one file, without ---")


def _list_in_line(f: Failure) -> Words:
    right = "[a, b] here, or each `- ` entry in a line of its own below the key"
    return Words(f.at + 1, "a list with - cannot begin in the line of its key", right)


def _block_text(f: Failure) -> Words:
    return Words(f.at + 1, "text in the same line after | or >", "the text in the lines below, indented")


def _reference(f: Failure) -> Words:
    what = "a value that begins with * or & would be a reference, which a rig file has not"
    return Words(f.at + 1, what, "the value in quotes")


def _after_the_end(f: Failure) -> Words:
    return Words(
        f.at + 1, f"`{f.text(f.at)}` stands where only a key can stand", "a key, or the line left out"
    )


_KINDS: tuple[tuple[str, Callable[[Failure], Words]], ...] = (
    (r"'\\t'", _tab),
    (r"scanning a quoted scalar", _open_quote),
    (r"escape", _escape),
    (r"expected the node content", _nothing),
    (r"parsing a flow", _brackets),
    (r"could not find expected ':'", _no_colon),
    (r"mapping values are not allowed", _second_colon),
    (r"expected <block end>", _block),
    (r"cannot start any token", _character),
    (r"another document", _document),
    (r"sequence entries are not allowed", _list_in_line),
    (r"scanning a block scalar", _block_text),
    (r"scanning an (alias|anchor)", _reference),
    (r"expected '<document start>'", _after_the_end),
)
"""What the parser says -> who knows what is meant by it; the first that fits."""
