"""Rig files as they may stand in recordings: without the tokens, each character of them an `x`.

Nothing else changes, not even the length in bytes, so that places in the file stay what they are.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import yaml

from seod.config.token_field import FILL, LEAST
from seod.config.tokens import RIGHTS, is_filled

if TYPE_CHECKING:
    from collections.abc import Iterator

_LOOSE = re.compile(
    rf"""(?:{"|".join(RIGHTS)})["']?[ \t]*[:=][ \t]*"""
    r"""(?:"((?:[^"\\\n]|\\.)*)"|'([^'\n]*)'|([^\s"',}\]][^\s,}\]]*))"""
)
"""A token where the text is no YAML, or where a comment has it."""


class Secret(NamedTuple):
    """A token in a text: from the character `start` to before `end`; `value` is what it means."""

    start: int
    end: int
    value: str


def secrets(text: str) -> list[Secret]:
    """All tokens in the text of a rig file, YAML or JSON; in comments and broken files where they show."""
    found = {(each.start, each.end): each for each in (*_by_form(text), *_by_structure(text))}
    return [each for each in found.values() if not is_filled(text[each.start : each.end])]


def redacted(text: str) -> str:
    """The text with every character of a token replaced by `x`; as long in UTF-8 as it was."""
    found = secrets(text)
    hidden = {index for each in found for index in range(each.start, each.end)}
    text = "".join(_filled(char) if index in hidden else char for index, char in enumerate(text))
    for value in {each.value for each in found if len(each.value) >= LEAST}:
        text = text.replace(value, _filled(value))  # in comments
    return text


def _filled(part: str) -> str:
    return "".join(char if char in " \t\r\n" else FILL * len(char.encode(errors="replace")) for char in part)


def _by_form(text: str) -> Iterator[Secret]:
    for match in _LOOSE.finditer(text):
        group = match.lastindex or 0
        if len(match[group]) >= LEAST:
            yield Secret(*match.span(group), match[group])


def _by_structure(text: str) -> Iterator[Secret]:
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, ValueError, RecursionError):
        return
    for node in _scalars(root):
        edge = 1 if node.style in ("'", '"') else 0
        yield Secret(node.start_mark.index + edge, node.end_mark.index - edge, node.value)


def _scalars(root: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    """Values of the keys that hold tokens, wherever they stand."""
    waiting, seen = [root], set[int]()
    while waiting:
        node = waiting.pop()
        if id(node) in seen or not isinstance(node, yaml.CollectionNode):
            continue
        seen.add(id(node))
        for item in node.value:
            key, value = item if isinstance(item, tuple) else (None, item)
            is_token = isinstance(key, yaml.ScalarNode) and key.value in RIGHTS
            if is_token and isinstance(value, yaml.ScalarNode) and not value.tag.endswith(":null"):
                yield value
            waiting.append(value)
