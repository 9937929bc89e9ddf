"""Completes the descriptions of a JSON schema: what a key means, its unit, its range, its default."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from seod.config.section import UNIT_KEY

if TYPE_CHECKING:
    from collections.abc import Iterator

Schema = dict[str, Any]

BOUNDS = {
    "gt": ("exclusiveMinimum", "> {}"),
    "ge": ("minimum", ">= {}"),
    "lt": ("exclusiveMaximum", "< {}"),
    "le": ("maximum", "<= {}"),
}
"""Pydantic's name of a bound -> that of JSON schema, and words."""

SIZES = {
    "minLength": "at least {} characters",
    "maxLength": "at most {} characters",
    "minItems": "at least {} entries",
    "maxItems": "at most {} entries",
    "minProperties": "at least {} entries",
}


def described(schema: Schema) -> Schema:
    """The schema with complete descriptions; changed in place.

    A key without a text of its own has that of the section that it refers to.
    """
    for node in list(_nodes(schema)):
        for ours, (theirs, _) in BOUNDS.items():
            if ours in node and "type" in node:
                node[theirs] = node.pop(ours)
    for node in list(_nodes(schema)):
        required = node.get("required", [])
        for name, key in node.get("properties", {}).items():
            if name == "kind" and "description" not in key:
                key["description"] = f"The kind of this section: {node.get('description', '')}"
            key["description"] = " ".join(_sentences(schema, key, name in required))
    for node in _nodes(schema):
        node.pop(UNIT_KEY, None)
    return schema


def _nodes(value: Any) -> Iterator[Schema]:
    """Every mapping in it."""
    if isinstance(value, dict):
        yield value
    for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _nodes(each)


def _sentences(schema: Schema, key: Schema, required: bool) -> Iterator[str]:
    parts = list(_nodes({name: each for name, each in key.items() if name != "default"}))
    text = " ".join((key.get("description") or _text_of_section(schema, parts)).split())
    if text:
        yield text if text[-1] in ".:)`]" else f"{text}."
    unit = next((part[UNIT_KEY] for part in parts if UNIT_KEY in part), "")
    if unit and f"[{unit}]" not in text:
        yield f"Unit: {unit}."
    yield from _range(parts)
    if required:
        yield "Required."
    elif "default" in key:
        yield _default(key["default"])


def _text_of_section(schema: Schema, parts: list[Schema]) -> str:
    """The first paragraph about the section that a key holds."""
    for part in parts:
        name = str(part.get("$ref", "")).removeprefix("#/$defs/")
        if name:
            return str(schema["$defs"][name].get("description", "")).split("\n\n")[0]
    return ""


def _range(parts: list[Schema]) -> Iterator[str]:
    words = []
    for part in parts:
        words += [text.format(_written(part[name])) for name, text in BOUNDS.values() if name in part]
        words += _sizes(part)
    choices = [_written(each) for part in parts for each in part.get("enum", [])]
    choices += [_written(part["const"]) for part in parts if "const" in part]
    if words:
        yield f"Range: {', '.join(dict.fromkeys(words))}."
    if choices:
        yield f"One of: {', '.join(choices)}." if len(choices) > 1 else f"Value: {choices[0]}."


def _sizes(part: Schema) -> list[str]:
    fewest = part.get("minItems")
    if fewest is not None and fewest == part.get("maxItems"):
        return [f"{fewest} entries"]
    return [text.format(part[name]) for name, text in SIZES.items() if name in part]


def _default(value: Any) -> str:
    if value is None or value in ({}, [], ""):
        return "Default: none."
    if isinstance(value, dict):
        return "May be left out."
    return f"Default: {_written(value)}."


def _written(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
