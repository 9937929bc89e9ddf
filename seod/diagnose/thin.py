"""A set's effects looked at again: those that gain too little, richer forms of a simple one, alike ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.cell import DELAYS
from seod.diagnose.fit import Fitted, fit
from seod.diagnose.judge import Judged, gain, refined
from seod.diagnose.states import begun_states

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.diagnose.coordinates import Values
    from seod.diagnose.model import Model
    from seod.diagnose.screen import Screen
    from seod.diagnose.windows import Cut

    Tried = Mapping[frozenset[str], Fitted]

PLAIN: Final = {"stribeck_friction": "coulomb_friction", "load_spring": "load_bias"}
"""Effects that become another one at the end of their range: friction that does not fall within the speeds
there are, a spring whose centre is far away."""
BIASES: Final = frozenset({"asymmetric_gain", "load_bias"})
"""Effects that two commands alone cannot tell apart."""


def plainer(own: Judged, aside: Cut, screen: Screen, enough: float) -> Judged:
    """The set with the plain form of effects, where the richer one gains too little over it."""
    for rich, plain in PLAIN.items():
        names = own.found.model.names
        if rich in names and plain not in names:
            other = Judged.of(_exchanged(own.found, rich, plain, screen), aside)
            own = other if gain(other, own) < enough else own
    return own


def best_alike(own: Judged, aside: Cut, screen: Screen) -> Judged:
    """The set with whichever of effects that act alike fits best: which it is shows last of all."""
    found = own.found
    others = [one for name in found.model.names for one in alike(found, name, screen)]
    least = min((found, *others), key=lambda one: one.cost)
    return own if least is found else Judged.of(least, aside)


def alike(found: Fitted, name: str, screen: Screen) -> list[Fitted]:
    """The set with each effect that acts like one of its own in that one's place, fitted to the same windows.

    They are the effects that delay, and of a relay's recording a load's bias and unequal gains.
    """
    model, values = found.model, found.model.values(found.x)
    return [
        _fitted(model.without(name).with_effect(other), values | start, found, screen)
        for other, start in _alike(model, values, name).items()
        if other not in model.names
    ]


def _alike(model: Model, values: Values, name: str) -> dict[str, Values]:
    """Effects that act like this one, each with the size at which it does."""
    if name in DELAYS:
        return {other: {f"{other}.time": values[f"{name}.time"]} for other in sorted(DELAYS)}
    if name not in BIASES or not model.scales.relayed:
        return {}
    full = values["omega_n"] * values["K_L"] * model.scales.volts / (2.0 * values["zeta"])
    ratio, bias = (values.get(place, 0.0) for place in ("asymmetric_gain.ratio", "load_bias.acceleration"))
    return {
        "asymmetric_gain": {"asymmetric_gain.ratio": -bias / full},
        "load_bias": {"load_bias.acceleration": -ratio * full},
    }


def _exchanged(found: Fitted, rich: str, plain: str, screen: Screen) -> Fitted:
    """A set with `plain` in the place of `rich`, fitted anew to the same windows."""
    values = found.model.values(found.x)
    size = {
        "coulomb_friction": {"coulomb_friction.level": values.get(f"{rich}.level", 0.0)},
        "load_bias": {
            "load_bias.acceleration": values.get(f"{rich}.stiffness", 0.0) * values.get(f"{rich}.centre", 0.0)
        },
    }[plain]
    model = found.model.without(rich).with_effect(plain)
    return _fitted(model, values | size, found, screen)


def _fitted(model: Model, values: Values, found: Fitted, screen: Screen) -> Fitted:
    x = model.searched(values)
    cut = found.cut
    start = begun_states(model, x, cut, found.start)
    return fit(model, cut, x, start, each=screen.each, ended=screen.budget.last_fit())


def without(found: Fitted, name: str, screen: Screen) -> Fitted:
    """A set without one of its effects, fitted anew to the same windows."""
    return _fitted(found.model.without(name), found.model.values(found.x), found, screen)


def thinned(
    own: Judged, tried: Tried, aside: Cut, screen: Screen, enough: float
) -> tuple[Judged, dict[str, Judged]]:
    """Without the effects that gain too little, and of those left the set without each.

    They have to gain where they were fitted, and on the windows held out (`aside`). `tried` are sets that
    were fitted, by their effects.
    """
    while True:
        rest = _rest(own.found, tried, aside, screen)
        if not rest:
            return own, {}
        least = min(rest.values(), key=lambda one: gain(one, own))
        if gain(least, own) >= enough:
            return own, rest
        own = least


def _rest(found: Fitted, tried: Tried, aside: Cut, screen: Screen) -> dict[str, Judged]:
    """By its name the set without each effect."""
    names = found.model.names
    left = screen.side_by_side(lambda name, within: _left(found, name, tried, aside, within), names)
    return dict(zip(names, left, strict=True))


def _left(found: Fitted, name: str, tried: Tried, aside: Cut, screen: Screen) -> Judged:
    """A set without one of its effects: fitted from where the set is, and from where it was found without."""
    rest = [without(found, name, screen)]
    before = tried.get(frozenset(rest[0].model.names))
    if before is not None:
        rest.append(before if before.cut is found.cut else refined(before, found.cut, screen))
    return Judged.of(min(rest, key=lambda one: one.cost), aside)
