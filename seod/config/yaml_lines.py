"""YAML with the place of every value: what a message needs to say `configs/x.yaml:14`.

A narrow, predictable YAML. Plain words are read by the YAML 1.2 core schema: `1e-3` and `8e6` are numbers,
`yes` and `off` are words, `true` and `false` are the only booleans, `12:30` is text. Duplicate keys are
mistakes. Anchors, aliases and tags are refused: a rig file says everything where it stands, and nothing in it
can blow up.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from seod.config.tokens import SECRETS
from seod.config.yaml_words import plain

if TYPE_CHECKING:
    from seod.config.errors import KeyPath

MAX_DEPTH = 30
"""Deepest nesting; the deepest rig file needs eight."""


class Place(NamedTuple):
    """Line and column, from 1."""

    line: int
    column: int


class Problem(NamedTuple):
    """A mistake in the YAML itself."""

    path: KeyPath
    line: int
    message: str
    right: str = ""


@dataclass
class Document:
    """A parsed file.

    Attributes:
        value: Mappings, lists and scalars; None if nothing could be read.
        places: Where each value stands: for a mapping's value, where its key stands.
        problems: Mistakes in the YAML itself; `value` is what could be read nevertheless.
    """

    value: Any = None
    places: dict[KeyPath, Place] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def line(self, path: KeyPath) -> int:
        """Line of a value, or of the nearest thing around it that is there."""
        while path not in self.places and path:
            path = path[:-1]
        return self.places[path].line if path in self.places else 1


class _Refused(yaml.MarkedYAMLError):
    """YAML that is correct but not wanted here."""


class _Loader(yaml.SafeLoader):
    """Composes nodes; refuses what a rig file has no use for."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - pyyaml's own class attribute
    depth = 0
    long_quote: tuple[int, int] | None = None
    """First and last line, from 0, of the last quoted text that goes over several lines."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]  # left out of the stubs
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise _Refused(problem=f"anchors (&) and aliases (*) {_REFUSED}", problem_mark=event.start_mark)
        if getattr(event, "tag", None) is not None:
            raise _Refused(problem=f"tags (!) {_REFUSED}", problem_mark=event.start_mark)
        if self.depth == MAX_DEPTH:
            raise _Refused(problem=f"nested deeper than {MAX_DEPTH} levels", problem_mark=event.start_mark)
        if getattr(event, "style", None) in ("'", '"') and event.start_mark.line != event.end_mark.line:
            self.long_quote = event.start_mark.line, event.end_mark.line
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


_REFUSED = "are not supported in a rig file; write the value itself"


_TAG = "tag:yaml.org,2002:"
_CORE = [
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
]
"""Type, form and first characters of plain scalars: YAML 1.2.2, section 10.3.2."""

for _name, _form, _first in _CORE:
    _Loader.add_implicit_resolver(_TAG + _name, re.compile(f"^(?:{_form})$"), _first)


def parse(text: str) -> Document:
    """Read one YAML document; never raises, whatever the text."""
    document = Document()
    loader = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
    except _Refused as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        document.problems.append(Problem((), line, str(error.problem)))
    except yaml.MarkedYAMLError as error:
        words = plain(error, text, loader.long_quote if loader else None)
        document.problems.append(Problem((), *words))
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        document.problems.append(Problem((), line, f"character U+{error.character:04X} is not allowed"))
    except (ValueError, OverflowError) as error:  # from escapes such as "\UFFFFFFFF" and huge version numbers
        line = loader.line + 1 if loader else 1
        document.problems.append(Problem((), line, f"not readable as YAML ({error})"))
    else:
        if node is not None:
            document.value = _build(document, node, (), node)
    finally:
        if loader is not None:
            loader.dispose()
    return document


def _build(document: Document, node: yaml.Node, path: KeyPath, where: yaml.Node) -> Any:
    """The value of a node; notes its place (that of `where`, its key) and those of all within."""
    mark = where.start_mark
    document.places[path] = Place(mark.line + 1, mark.column + 1)
    if isinstance(node, yaml.MappingNode):
        return _mapping(document, node, path)
    if isinstance(node, yaml.SequenceNode):
        return [_build(document, item, (*path, index), item) for index, item in enumerate(node.value)]
    return _scalar(document, node, path)


def _mapping(document: Document, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
    value: dict[str, Any] = {}
    lines: dict[str, int] = {}
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode) or not key_node.value.isprintable():
            document.problems.append(Problem(path, line, "a key must be a plain word"))
            continue
        key = key_node.value
        if key in value:
            message = f"duplicate key: it is already on line {lines[key]}"
            document.problems.append(Problem((*path, key), line, message, "keep one of the two"))
            continue
        lines[key] = line
        value[key] = _build(document, value_node, (*path, key), key_node)
    return value


def _scalar(document: Document, node: yaml.Node, path: KeyPath) -> Any:
    try:
        return _CONVERT[node.tag.removeprefix(_TAG)](node.value)
    except ValueError:  # "\ud800" is a character for YAML; a number may be too long for Python
        told = "the token" if path[-1:] in SECRETS else repr(node.value[:40])
        message = f"{told} cannot be read"
    document.problems.append(
        Problem(path, node.start_mark.line + 1, message, "a shorter number, or plain text")
    )
    return None


def _text(text: str) -> str:
    text.encode()
    return text


def _int(text: str) -> int:
    return int(text, 0) if text.startswith(("0x", "0o")) else int(text)


def _bool(text: str) -> bool:
    return {"true": True, "false": False}[text.lower()]


def _float(text: str) -> float:
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


_CONVERT = {"null": lambda _: None, "bool": _bool, "int": _int, "float": _float, "str": _text}
