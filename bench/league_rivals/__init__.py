"""Other authors' ways from a limit cycle to the plant, a module a family; none uses `seod`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from league_rivals.a_function import a_function
from league_rivals.describing import describing
from league_rivals.integrals import areas, fourier
from league_rivals.output_error import asymmetric, asymmetric_told
from league_rivals.shifting import shifting

if TYPE_CHECKING:
    from collections.abc import Callable

    from league_rivals.base import Found, Record, Told


class Rival(NamedTuple):
    """One row of the league."""

    find: Callable[[Record, Told], Found | None]
    unequal: bool
    """Its authors' relay has unequal levels."""
    told: str
    """What it needs to know beforehand, besides the relay."""


TABLE: dict[str, Rival] = {
    "describing": Rival(describing, False, "K_L, delay, hysteresis"),
    "areas": Rival(areas, False, "K_L, delay, hysteresis"),
    "fourier": Rival(fourier, False, "K_L, when voltages arrived"),
    "A-function": Rival(a_function, False, "K_L, delay, hysteresis"),
    "shifting": Rival(shifting, True, "K_L, when voltages arrived"),
    "asymmetric": Rival(asymmetric, True, "nothing"),
    "asymmetric, told": Rival(asymmetric_told, True, "K_L, when voltages arrived"),
}
