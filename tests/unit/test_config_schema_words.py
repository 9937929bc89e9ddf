"""Every key of the schema tells its meaning, unit, range and default: no key may come without."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

from seod.config.schema import FILE_NAME
from seod.files.shipped import configs_dir

if TYPE_CHECKING:
    from collections.abc import Iterator

SCHEMA = json.loads((configs_dir() / FILE_NAME).read_text())


def keys(node: Any, where: str = "") -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Every key anywhere in the schema: its path, its schema, whether it has to be there."""
    if isinstance(node, list):
        for each in node:
            yield from keys(each, where)
    if not isinstance(node, dict):
        return
    for name, each in node.get("properties", {}).items():
        yield f"{where}.{name}", each, name in node.get("required", [])
    for name, each in node.items():
        if name == "if":  # asks for the value of a key that stands elsewhere
            continue
        yield from keys(each, f"{where}/{name}" if "/$defs" in f"{where}/{name}" else where)


KEYS = list(keys(SCHEMA))


def types(key: dict[str, Any]) -> set[str]:
    """The types that a key's own value, or an entry of its list, may have."""
    found = {key["type"]} if "type" in key else set()
    for part in ("anyOf", "oneOf", "prefixItems"):
        for each in key.get(part, []):
            found |= types(each)
    return found | (types(key["items"]) if "items" in key else set())


def bounds(key: Any) -> list[tuple[str, float]]:
    """Every bound of a number in the key."""
    names = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
    found = []
    for name, each in key.items():
        if name in names:
            found.append((name, each))
        for part in each if isinstance(each, list) else [each]:
            found += bounds(part) if isinstance(part, dict) and name != "default" else []
    return found


def test_there_are_many() -> None:
    assert len(KEYS) > 350


@pytest.mark.parametrize(("path", "key", "required"), KEYS, ids=[path for path, _, _ in KEYS])
def test_each_key_tells_meaning_unit_range_and_default(
    path: str, key: dict[str, Any], required: bool
) -> None:
    text = key.get("description", "")
    meaning = re.split(r"(Unit: |Range: |Default: |Value: |One of: |Required\.|May be )", text)[0].strip()
    assert len(meaning.split()) >= 2, f"{path} has no meaning: {text!r}"
    if "number" in types(key):
        assert re.search(r"\[[^\]]+\]|Unit: ", text), f"{path} has no unit: {text!r}"
    for _, bound in bounds(key):
        assert f"{bound:g}" in text or str(bound) in text, f"{path} does not tell its bound {bound}: {text!r}"
    if required:
        assert "Required" in text, f"{path}: {text!r}"
    elif "default" in key:
        assert "Default: " in text or "May be left out" in text, f"{path}: {text!r}"
    for choice in key.get("enum", []):
        assert str(choice) in text, f"{path}: {text!r}"


def test_each_kind_of_sensor_offers_its_own_units() -> None:
    unit = lambda kind: SCHEMA["$defs"][kind]["properties"]["unit"]["enum"]  # noqa: E731
    assert unit("PressureConfig") == ["Pa", "kPa", "bar", "MPa"]
    assert unit("AbsoluteEncoderConfig") == ["rad", "mrad", "deg", "rev"]
    assert "V" in unit("LinearConfig")


def test_quantities_have_their_ranges_for_editors() -> None:
    e_a = SCHEMA["$defs"]["RelayConfig"]["properties"]["e_a"]
    assert e_a["anyOf"][0] == {"exclusiveMinimum": 0, "type": "number"}
    assert e_a["description"] == "Amplitude of the relay. Unit: V or A. Range: > 0. Required."
