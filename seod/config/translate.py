"""Pydantic's errors in plain language: what is wrong, what was written, what would be right."""

from __future__ import annotations

import json
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ValidationError
from typing_extensions import is_typeddict

from seod.config.errors import KeyPath, suggest
from seod.config.token_field import FILL
from seod.config.tokens import RIGHTS, SECRETS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from pydantic.fields import FieldInfo
    from pydantic_core import ErrorDetails

SHOWN = 60
"""Longest value quoted in a message."""


_WORDING = {
    "missing": "has too few entries",
    "greater_than": "must be > {gt}",
    "greater_than_equal": "must be >= {ge}",
    "less_than": "must be < {lt}",
    "less_than_equal": "must be <= {le}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "literal_error": "must be {expected}",
    "enum": "must be {expected}",
    "string_pattern_mismatch": "must match {pattern}",
    "string_too_short": "must have at least {min_length} characters",
    "string_too_long": "must have at most {max_length} characters",
    "too_short": "needs at least {min_length} entries",
    "too_long": "has more than {max_length} entries",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a mapping of keys to values",
    "model_type": "must be a mapping of keys to values",
    "union_tag_not_found": "must name a kind",
    "model_attributes_type": "must be a mapping of keys to values",
}
"""Pydantic's error type -> what would be right, with pydantic's names for the numbers."""

Report = tuple[KeyPath, str, str]
"""Path, message, what would be right."""


def translate(error: ValidationError, model: type[BaseModel], raw: Any) -> Iterator[Report]:
    """Each mistake that pydantic found.

    Args:
        error: What validating `raw` raised.
        model: The model that `raw` was validated against.
        raw: The value as read from the file.
    """
    for detail in error.errors(include_url=False):
        path = _real_path(detail["loc"], raw, detail["type"])
        if detail["type"] in ("union_tag_invalid", "union_tag_not_found"):
            path = (*path, "kind")
        yield path, *_wording(detail, path, model, raw)


def _wording(detail: ErrorDetails, path: KeyPath, model: type[BaseModel], raw: Any) -> tuple[str, str]:
    kind = detail["type"]
    if kind == "extra_forbidden":
        known = fields_at(model, path[:-1], raw)
        return "unknown key", suggest(str(path[-1]), known, "keys here") if known else ""
    if kind == "missing" and isinstance(detail["loc"][-1], str):
        return "missing", _described(model, path, raw)
    if kind == "union_tag_invalid":
        kinds = [tag.strip().strip("'") for tag in detail["ctx"]["expected_tags"].split(",")]
        written = at(raw, path)
        return f"must name a kind, got {show(written)}", suggest(str(written), kinds, "kinds")
    if "[key]" in detail["loc"]:
        return "cannot be used as a name", "letters, digits, _ and -, starting with a letter, at most 32"
    message = _message(detail)
    value = at(raw, path)
    container = isinstance(value, dict | list) and kind == "value_error"
    quoted = "got" in message or (isinstance(value, str) and value in message)
    said = container or quoted or path[-1:] in SECRETS
    return (message if said else f"{message}, got {show(value)}"), ""


def _message(detail: ErrorDetails) -> str:
    context = detail.get("ctx", {})
    if detail["type"] == "value_error":
        return str(context["error"])
    template = _WORDING.get(detail["type"])
    if template is None:
        return detail["msg"][:1].lower() + detail["msg"][1:]
    plain = {name: f"{value:g}" if isinstance(value, float) else value for name, value in context.items()}
    return template.format(**plain)


def _described(model: type[BaseModel], path: KeyPath, raw: Any) -> str:
    field = fields_at(model, path[:-1], raw).get(str(path[-1]))
    what = field.description.split(". ")[0].rstrip(".") if field and field.description else ""
    return f"add `{path[-1]}:`" + (f" ({what})" if what else "")


def show(value: Any) -> str:
    """A value as the user would write it, shortened."""
    text = "nothing" if value is None else json.dumps(_without_tokens(value), ensure_ascii=False)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def _without_tokens(value: Any) -> Any:
    if isinstance(value, list):
        return [_without_tokens(each) for each in value]
    if not isinstance(value, dict):
        return value
    return {key: FILL if key in RIGHTS else _without_tokens(each) for key, each in value.items()}


def at(raw: Any, path: KeyPath) -> Any:
    """The value at a path; None where there is none."""
    for part in path:
        if not _has(raw, part):
            return None
        raw = raw[part]
    return raw


def _has(raw: Any, part: str | int) -> bool:
    if isinstance(raw, dict):
        return part in raw
    return isinstance(raw, list) and isinstance(part, int) and 0 <= part < len(raw)


def _real_path(location: tuple[str | int, ...], raw: Any, kind: str) -> KeyPath:
    """The location without pydantic's own words in it (tags of unions, `[key]`)."""
    path: list[str | int] = []
    for part in location:
        if _has(raw, part):
            raw = raw[part]
            path.append(part)
    lost_key = kind == "missing" and isinstance(location[-1], str)
    return (*path, location[-1]) if lost_key else tuple(path)


def fields_at(model: type[BaseModel], path: KeyPath, raw: Any = None) -> Mapping[str, FieldInfo | None]:
    """The fields of a model, or keys of a typed dictionary, at a path; empty where that cannot be told.

    Where the path leads to one of several kinds, `raw` tells by its `kind` which of them counts.
    """
    annotation: Any = model
    for part in path:
        annotation = _step(annotation, part)
    if is_typeddict(annotation):
        return dict.fromkeys(get_type_hints(annotation))
    models = _of_kind(_models(annotation), at(raw, path))
    return {field.alias or name: field for found in models for name, field in found.model_fields.items()}


def _of_kind(models: list[type[BaseModel]], value: Any) -> list[type[BaseModel]]:
    """Those models that are of the kind of `value`; all where that cannot be told."""
    kinds = [found.model_fields.get("kind") for found in models]
    if not isinstance(value, dict) or not all(kinds):
        return models
    chosen = [
        found
        for found, kind in zip(models, kinds, strict=True)
        if kind and value.get("kind", kind.default) in get_args(kind.annotation)
    ]
    return chosen or models


def _step(annotation: Any, part: str | int) -> Any:
    if is_typeddict(annotation):
        return get_type_hints(annotation).get(str(part))
    for model in _models(annotation):
        if part in model.model_fields:
            return model.model_fields[str(part)].annotation
    arguments = get_args(annotation)
    return arguments[-1] if arguments and get_origin(annotation) in (dict, list, tuple) else None


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Union, UnionType, Annotated):
        return [model for argument in get_args(annotation) for model in _models(argument)]
    return []
