"""All causes, and what a search asks of them without knowing one by its name."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.disturbance import DISTURBANCE
from seod.diagnose.causes.flow import FLOW
from seod.diagnose.causes.friction import FRICTION
from seod.diagnose.causes.load import LOAD
from seod.diagnose.causes.plant import PLANT
from seod.diagnose.causes.sensor import SENSOR
from seod.diagnose.causes.valve import VALVE
from seod.diagnose.causes.valve_map import VALVE_MAP
from seod.terminal.text import number
from sim.effects import EFFECTS, parameter, power_of_y

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from seod.diagnose.causes.cause import Cycle, Grid, Group, Hidden, Wave
    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Effects

_GROUPS: Final = (VALVE, VALVE_MAP, FLOW, LOAD, FRICTION, DISTURBANCE, SENSOR, PLANT)
_ALL: Final = {each.name: each for group in _GROUPS for each in group}
CAUSES: Final = {name: _ALL[name] for name in EFFECTS if name in _ALL}
"""Every cause by name, in the order of the signal's way."""
DELAYS: Final = frozenset(name for name, one in CAUSES.items() if one.delays)
"""Causes that may stand for a delay of a plant of the relay's grid."""
IN_GRID: Final = tuple(name for name, one in CAUSES.items() if one.grid is not None and one.grid.alone)
"""Causes that the relay's grid has."""
SETTLED: Final = tuple(name for name, one in CAUSES.items() if one.grid is not None and one.grid.settles)
"""Causes with which the search goes on from the grid's plants with their plain form."""
RAMPED: Final = tuple(name for name, one in CAUSES.items() if one.grid is not None and one.grid.ramps)
"""Causes whose plants of the grid have ramps for the relay's switches."""
LATE, LATE_PLACE = next((name, f"{name}.{one.pure_delay}") for name, one in CAUSES.items() if one.pure_delay)
"""The cause that is a delay and nothing else, and its parameter."""
SHAKES: Final = next(name for name, one in CAUSES.items() if one.wave and one.wave.over == "time")
"""The cause that is a wave over time: a limit cycle may have locked to it."""
FROM_GRID: Final = DELAYS.union(IN_GRID, SETTLED, RAMPED, {SHAKES})
"""Causes that may be tried from a plant of the grid."""
RICHER: Final = {
    name: plain
    for name, one in CAUSES.items()
    if (plain := tuple(each.name for each in one.plain if each.grows is not None))
}
"""Causes that are tried from a set with a plain form of theirs, each with those."""
GAPS: Final = frozenset(f"{name}.{one.gap}" for name, one in CAUSES.items() if one.gap)
"""Places of gaps in which the load may have been at rest anywhere."""
OFFSET, OFFSET_PLACE = next((name, f"{name}.{one.offset}") for name, one in CAUSES.items() if one.offset)
"""The cause that is a constant acceleration, and its parameter: Eq. 1 is linear in it."""
FOLLOWS, FOLLOWS_PLACE = next((name, f"{name}.{one.follows}") for name, one in CAUSES.items() if one.follows)
"""The cause that is an acceleration in proportion to a channel, and its parameter, likewise."""
SOLVED: Final = {OFFSET: OFFSET_PLACE, FOLLOWS: FOLLOWS_PLACE}
"""Causes in which Eq. 1 is linear: their sizes are solved for with its gain."""
PULLS, PULLS_PLACES = next(
    (name, (f"{name}.{one.pulls[0]}", f"{name}.{one.pulls[1]}")) for name, one in CAUSES.items() if one.pulls
)
"""The cause that is an acceleration in proportion to the position, and its parameters."""
RAMPS, RAMPS_PLACE = next((name, f"{name}.{one.ramps}") for name, one in CAUSES.items() if one.ramps)
"""The cause that is a valve of limited speed, and its parameter."""
HOLDS, HOLDS_PLACE = next((name, f"{name}.{one.holds}") for name, one in CAUSES.items() if one.holds)
"""The cause that is a dry friction, and its parameter."""
TWINS: Final = {name: one.twin for name, one in CAUSES.items() if one.twin is not None}
"""Causes with which a plant of Eq. 1 is the same as without, and their parameters there."""
SAME_PLANT: Final = {name: one.same_plant for name, one in CAUSES.items() if one.same_plant is not None}
"""Causes beside which a plant of Eq. 1 has other numbers."""
WHOLE_PARTS: Final = frozenset(place for twin in TWINS.values() for place in twin)
"""Places of these: whatever they are within their range, it is no limit of the search."""
OFFSET_DRIFT_PLACE: Final = f"{OFFSET}.{CAUSES[OFFSET].drift}"
"""By how much it grows with time: searched in runs of whole recordings alone, windows hardly show it."""
WITHOUT_SIGN: Final = frozenset(name for name, one in CAUSES.items() if one.unsigned)
"""Causes behind which the sign of the gain is not told: the plant turned round reads alike."""
MIRRORED: Final = frozenset(f"{name}.{of}" for name, one in CAUSES.items() for of in one.mirrored)
"""Places of parameters that turn their sign with that of the command."""


def answered_as(name: str) -> str:
    """The name by which the answer has an effect: its own, or that of the cause that it counts as."""
    return EFFECTS[name].counts_as or name


def group(name: str, scales: Scales) -> Group:
    """What is searched for a cause of this name; a wave begins without its number.

    Raises:
        KeyError: There is no such cause.
    """
    return CAUSES[name].group(scales)


def wave_of(name: str) -> Wave:
    """How a cause that is a wave repeats; to be asked of waves alone."""
    wave = CAUSES[name].wave
    assert wave is not None  # noqa: S101 - asked of waves alone
    return wave


def searched_causes(scales: Scales) -> list[str]:
    """Causes that a simulation can show in these recordings, but for those that show only beside another."""
    alone = [name for name, one in CAUSES.items() if not one.needs and not one.shown_by]
    asked = [name for name in alone if CAUSES[name].searched(scales)]
    return [name for name in asked if name not in scales.given]


def causes_tried(scales: Scales) -> int:
    """How many causes are searched in such recordings."""
    return len(further_causes(scales, ()))


def further_causes(scales: Scales, names: Collection[str]) -> list[str]:
    """What can be added to a set: causes that it lacks; last those that act only beside one that it has.

    Not those whose own limits leave no room in recordings of these sizes, nor beside one that contains it.
    Where one is not shown yet, those that show it.
    """
    shown = [name for name, one in CAUSES.items() if not one.shown_by.isdisjoint(names)]
    needing = [*(name for name, one in CAUSES.items() if one.needs in names), *shown]
    waiting = [CAUSES[name].shown_by for name in names if is_unseen(name, names)]
    lacking = [each for each in (*searched_causes(scales), *needing) if each not in names]
    return [
        each
        for each in lacking
        if CAUSES[each].has_room(scales)
        and each not in scales.given
        and all(each in showing for showing in waiting)
        and not any(_contains(each, own) or _contains(own, each) for own in names)
    ]


def commuting(name: str, others: Collection[str]) -> list[str]:
    """Causes that are the same as this one beside these others, whatever recordings show."""
    if any(CAUSES[each].tells_lags_apart for each in others):
        return []
    return [each.name for each in CAUSES[name].alike if each.commutes and each.name not in others]


def is_unseen(name: str, names: Collection[str]) -> bool:
    """Whether nothing in a set shows this cause."""
    shown_by = CAUSES[name].shown_by
    return bool(shown_by) and shown_by.isdisjoint(names)


def _contains(name: str, other: str) -> bool:
    """Whether a cause does all that the other does."""
    return any(each.name == other and not each.adds for each in CAUSES[name].plain)


def plain_forms(names: Collection[str]) -> set[frozenset[str]]:
    """The set with plain forms in the place of one or more richer ones that grow from them."""
    own = frozenset(names)
    return {frozenset(some) for some in product(*((name, *RICHER.get(name, ())) for name in names))} - {own}


def grown(name: str, plain: str, values: Values, scales: Scales) -> Values:
    """Parameters of a richer form to begin with, from those of a set that has its plain one.

    Args:
        name: The richer cause.
        plain: Its plain form, one of `RICHER`.
        values: Of the set that has that one, by place.
        scales: Sizes of the recordings.
    """
    (grows,) = (each.grows for each in CAUSES[name].plain if each.name == plain and each.grows is not None)
    return grows(values, scales)


def bound_to(name: str) -> set[str]:
    """Causes that do nothing without this one."""
    return {other for other, one in CAUSES.items() if one.needs == name}


def hidden_by_relay() -> dict[str, Hidden]:
    """Causes that two commands hide in the gain, and how."""
    return {name: one.hidden for name, one in CAUSES.items() if one.hidden is not None}


def alike_under_relay() -> Iterator[tuple[str, str]]:
    """Pairs of causes that two commands cannot tell apart."""
    for name, one in CAUSES.items():
        for other in one.alike:
            if other.two_commands_only and list(CAUSES).index(name) < list(CAUSES).index(other.name):
                yield name, other.name


def grid_of(name: str) -> Grid:
    """How a cause is tried in the relay's grid; to be asked of causes of the grid alone."""
    grid = CAUSES[name].grid
    assert grid is not None  # noqa: S101 - asked of causes of the grid alone
    return grid


def settled_from(name: str, sizes: Values, half: float) -> Values:
    """Parameters of a cause of `SETTLED`, by place, from a plant with its plain form.

    Args:
        name: The cause.
        sizes: That plant's effects, by place.
        half: How far it moves either way without effects [unit].
    """
    begins = grid_of(name).begins
    assert begins is not None  # noqa: S101 - asked of `SETTLED` alone
    return begins(sizes, half)


def sized_by_shares(name: str, shares: Values, sizes: Values, cycle: Cycle) -> Values:
    """Parameters of a cause of the grid, by place.

    Args:
        name: The cause.
        shares: Of the limit cycle, by place [1].
        sizes: Parameters of the causes before it, by place.
        cycle: That of Eq. 1.
    """
    made = grid_of(name).sizes
    assert made is not None  # noqa: S101 - asked of causes that have shares
    return made(shares, sizes, cycle)


def ramped_by(name: str, lasts: float, height: float) -> Values:
    """Parameters of a cause of `RAMPED`, by place.

    Args:
        name: The cause.
        lasts: How long a ramp from one command to the other lasts [s].
        height: How far these are apart [V].
    """
    ramps = grid_of(name).ramps
    assert ramps is not None  # noqa: S101 - asked of `RAMPED` alone
    return ramps(lasts, height)


def grid_shares() -> Iterator[Values]:
    """Shares of each cause of the relay's grid, and of two of them."""
    grids = [grid_of(name) for name in IN_GRID]
    for grid in grids:
        yield from grid.alone
    for k, one in enumerate(grids):
        for other in grids[k + 1 :]:
            yield from (a | b for a, b in product(one.paired, other.paired))


def grows_with_movement(place: str) -> bool:
    """Whether a parameter is as large as the movement is, all else being the same."""
    return power_of_y(parameter(place)[1].unit) == 1


def sentence(name: str, effects: Effects) -> str:
    """What a found cause means, for a report; `effects` are those of the model."""
    cause = CAUSES[name]
    return cause.says if cause.figure is None else cause.says.format(figure=number(cause.figure(effects)))


def remote(start: Values) -> bool:
    """Whether a start is far from the parent's own plant."""
    return not {"*K_L", "*omega_n", "*zeta", "K_L", "zeta"}.isdisjoint(start)


def bare(names: Collection[str]) -> bool:
    """Whether a set is the baseline, if need be behind a sensor that has lost the sign, or its twin."""
    return all(CAUSES[name].unsigned or is_unseen(name, names) for name in names)


def begun_from(values: Values, start: Values) -> Values:
    """A parent's parameters, by place, times the factors of a start; its own values replace them.

    A start near the parent has the parent's plant, whatever numbers that has beside its cause.
    """
    factors = {place: start.get(f"*{place}", 1.0) for place in values}
    begun = {place: value * factors[place] for place, value in values.items()} | start
    if remote(start):
        return begun
    for name, same in SAME_PLANT.items():
        if has(name, start) and not has(name, values):
            begun |= same.begins(begun)
    return begun


def has(name: str, values: Collection[str]) -> bool:
    """Whether places are a cause's, among others."""
    return any(place.startswith(f"{name}.") for place in values)
