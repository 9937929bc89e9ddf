"""The `effects:` of a simulated plant as rig files write them: a type for pydantic, made of the table.

So a mistake is told at its line like any other, and editors know each effect, its units and its ranges.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import ConfigDict, Field
from typing_extensions import TypedDict

from sim.effects import EFFECTS

if TYPE_CHECKING:
    from sim.effects import Effect, Parameter

    Effects = dict[str, dict[str, float]]
    """Values by effect and parameter: only those that are written."""


def _closed(name: str, text: str, fields: dict[str, Any]) -> Any:
    """A dictionary with these keys, each of which may be left out."""
    typed_dict: Any = TypedDict  # type checkers want keys that are written down
    made = typed_dict(name, fields, total=False)
    made.__pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    made.__doc__ = text
    return made


def _number(each: Parameter) -> Any:
    bounds: dict[str, Any] = {"ge": each.low} | ({"le": each.high} if each.high < math.inf else {})
    off = "left out" if math.isinf(each.null) else f"{each.null:g}"
    text = f"[{each.unit}] {each.text}; default: {off}"
    return Annotated[float, Field(allow_inf_nan=False, description=text, **bounds)]


def _group(effect: Effect) -> Any:
    numbers = {each.name: _number(each) for each in effect.parameters}
    group = _closed(effect.name, effect.physics, numbers)
    return Annotated[group, Field(description=effect.physics)]


if not TYPE_CHECKING:
    Effects = _closed(
        "Effects", "Effects by name; docs/model.md.", {e.name: _group(e) for e in EFFECTS.values()}
    )
