"""Whether a diagnosis said what was hidden; counts with Wilson's intervals."""

from __future__ import annotations

import math
from typing import Any

from hidden_strength import BRISTLES, NAMED

OUTCOMES = ("exact", "within", "wrong")
FRICTIONS = {"coulomb_friction", "stribeck_friction"}
ANGLES = {"phase"}
NOW_NAMED = {"curved": "sensor_nonlinearity", "progressive": "static_valve_map"}
"""Off the list when some records were made: a diagnosis that knows them may name them."""
FROM_OUTSIDE = {"gusts"}
"""Off the list, but no part of the plant: what does not repeat has no name, and is not unexplained."""


def expected(causes) -> set[str]:
    """As a diagnosis has to name them: bristles count as the dry friction, a heavy spool as its lag."""
    return {NAMED.get(cause, cause) for cause in causes}


def outcome(kind: str, causes, told: dict[str, Any]) -> str:
    """`exact`; `within`: the cause is among those said to be indistinguishable; `wrong`.

    The verdict counts too: `effects` where listed causes are hidden; bristles are not quite the dry friction.
    """
    if kind == "clean":
        return "exact" if told["verdict"] == "clean" and not told["effects"] else "wrong"
    if kind == "unlisted" and FROM_OUTSIDE.intersection(causes):
        return "exact" if told["verdict"] == "clean" and not told["effects"] else "wrong"
    if kind == "unlisted" and [NOW_NAMED.get(*causes)] == [each["name"] for each in told["effects"]]:
        return "exact" if told["verdict"] == "effects" else "wrong"
    if kind == "unlisted":
        return "exact" if told["verdict"] == "unexplained" else "wrong"
    if told["verdict"] not in ({"effects", "unexplained"} if BRISTLES in causes else {"effects"}):
        return "wrong"
    wanted, named = expected(causes), {each["name"] for each in told["effects"]}
    if BRISTLES in causes and named == FRICTIONS:
        return "exact"
    if named == wanted:
        return "exact"
    return "within" if _covered(wanted, told["effects"]) else "wrong"


def _covered(wanted: set[str], effects) -> bool:
    """Each cause is named, or told to be as good as one that is; nothing else is named."""
    left = set(wanted)
    for each in effects:
        mine = left & {each["name"]} or left & set(each["indistinguishable_from"])
        if not mine:
            return False
        left -= {sorted(mine)[0]}
    return not left


def parameters(true_effects, told: dict[str, Any]) -> list[tuple[str, float, float, float, float]]:
    """(place, truth, value, lower and upper end) of the numbers of effects that were named rightly."""
    out = []
    for each in told["effects"]:
        truth = true_effects.get(each["name"], {})
        for name, told_of in each["parameters"].items():
            if name in truth and None not in (told_of["value"], *told_of["ci95"]):
                value, (low, high) = told_of["value"], told_of["ci95"]
                turn = (
                    2.0 * math.pi * round((truth[name] - value) / (2.0 * math.pi)) if name in ANGLES else 0.0
                )
                out.append((f"{each['name']}.{name}", truth[name], value + turn, low + turn, high + turn))
    return out


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Interval of a proportion (Wilson 1927)."""
    if n == 0:
        return 0.0, 1.0
    p, w = hits / n, z * z / n
    middle, half = p + w / 2.0, z * math.sqrt(p * (1.0 - p) / n + w / n / 4.0)
    return (middle - half) / (1.0 + w), (middle + half) / (1.0 + w)
