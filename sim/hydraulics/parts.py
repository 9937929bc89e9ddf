"""Every parameter of the physical plant: unit, range, default and where the default comes from.

Rig files, the kernel's record, the JSON schema and `docs/hydraulics.md` take all of it from here. Pressures
are above atmosphere. `unit` is that of the position, rad (m where a cylinder has no arm); forces are then
torques, N m (or N), inertias kg m^2 (or kg). Needs no numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NotRequired

from pydantic import ConfigDict, Field
from typing_extensions import TypedDict

INF = math.inf
LITRE_PER_MINUTE = 1e-3 / 60.0
"""[m^3/s]"""

CHOSEN = "chosen"
"""Source of what neither the paper nor a standard prints: a usual value of such parts."""


@dataclass(frozen=True, slots=True)
class Part:
    """One parameter.

    Attributes:
        group: Its section in the rig file.
        name: Its key there.
        unit: Its unit.
        default: Taken where the rig file does not say; None: it must say.
        low: Smallest value that makes sense.
        high: Largest.
        text: What it is.
        source: Where the default, or what to put there, comes from.
    """

    group: str
    name: str
    unit: str
    default: float | None
    low: float
    high: float
    text: str
    source: str = CHOSEN

    @property
    def slot(self) -> str:
        """Its name in the kernel's record."""
        return f"{self.group}_{self.name}"


GROUPS = {
    "supply": "Pump, relief valve, line to the servovalve.",
    "valve": "Servovalve: spool of second order, four square-root orifices, clearances.",
    "oil": "Oil with entrained air.",
    "motor": "Rotary motor; it or a cylinder must be there.",
    "cylinder": "Single-rod cylinder, with `arm` behind a crank.",
    "leakage": "Laminar leakage of the actuator.",
    "load": "What it moves.",
}
"""Sections of a physical plant and what they describe."""

PARTS = (
    Part("supply", "pressure", "Pa", None, 1e4, 1e8, "at the servovalve without demand", "paper, section 4"),
    Part("supply", "tank", "Pa", 0.0, 0.0, 1e7, "in the return line"),
    Part("supply", "flow", "m^3/s", 1e-3, 1e-7, 1.0, "of the pump: what the relief valve lets go, at most"),
    Part("supply", "droop", "Pa s/m^3", 0.0, 0.0, 1e13, "fall of the pressure with demand; 0: stiff supply"),
    Part("supply", "volume", "m^3", 2e-3, 1e-6, 10.0, "of the pressure line"),
    Part("supply", "ripple", "1", 0.0, 0.0, 0.5, "of the pump's flow (stiff supply: of the pressure)"),
    Part("supply", "ripple_omega", "rad/s", 1400.0, 1e-2, 1e5, "its frequency: pistons times shaft speed"),
    Part(
        "valve",
        "rated_flow",
        "m^3/s",
        None,
        1e-8,
        1.0,
        "at rated volts and drop, without load",
        "paper, Table 1",
    ),
    Part("valve", "rated_drop", "Pa", 7e6, 1e4, 1e8, "over both edges at rated flow", "ISO 10770-1: 7 MPa"),
    Part("valve", "rated_volts", "V", 10.0, 1e-3, 1e3, "for the rated flow"),
    Part(
        "valve", "omega", "rad/s", 700.0, 1.0, 1e5, "of the spool", "two-stage valves: 60-150 Hz at -90 deg"
    ),
    Part("valve", "zeta", "1", 0.8, 0.05, 5.0, "of the spool"),
    Part("valve", "limit", "V", 10.0, 1e-6, 1e3, "end of the spool's way, either way"),
    Part("valve", "rate", "V/s", INF, 1e-3, INF, "fastest that the spool goes"),
    Part("valve", "overlap", "V", 0.0, 0.0, 10.0, "half the dead zone"),
    Part(
        "valve", "hysteresis", "V", 0.0, 0.0, 10.0, "half the width of the loop", "catalogues: < 3 % of rated"
    ),
    Part("valve", "null_bias", "V", 0.0, -10.0, 10.0, "where it is closed", "catalogues: < 2 % of rated"),
    Part(
        "valve",
        "leakage",
        "m^3/s",
        0.0,
        0.0,
        1e-2,
        "supply to tank, closed, at rated drop",
        "catalogues: 1-2 L/min",
    ),
    Part("valve", "asymmetry", "1", 0.0, -0.9, 0.9, "half the relative difference of the two directions"),
    Part("valve", "laminar", "Pa", 5e4, 1e2, 1e6, "drop below which an orifice is laminar"),
    Part("valve", "delay", "s", 0.0, 0.0, 10.0, "from the command to the spool's motor"),
    Part(
        "valve",
        "measured_0",
        "unit/s/V",
        0.0,
        -1e6,
        1e6,
        "K_L as measured, at pressure 0 (0: by rated flow)",
        "Eq. 9",
    ),
    Part("valve", "measured_1", "unit/s/V/Pa", 0.0, -1.0, 1.0, "its slope", "Eq. 9"),
    Part("valve", "measured_2", "unit/s/V/Pa^2", 0.0, -1.0, 1.0, "its curvature", "Eq. 9"),
    Part("valve", "measured_low", "Pa", 0.0, 0.0, 1e8, "below it, its value there", "Eq. 9: 5 MPa"),
    Part("valve", "measured_high", "Pa", 1e8, 1.0, 1e8, "above it, its value there", "Eq. 9: 10 MPa"),
    Part(
        "oil",
        "bulk_modulus",
        "Pa",
        1.4e9,
        1e7,
        1e10,
        "without air",
        "mineral oil, 40 deg C: 1.4-1.7 GPa; hoses take from it",
    ),
    Part(
        "oil",
        "air",
        "1",
        0.005,
        0.0,
        0.5,
        "entrained, part of the volume at atmosphere",
        "usual 0.002-0.02; ISO/TR 15640",
    ),
    Part("oil", "polytropic", "1", 1.4, 1.0, 1.67, "exponent of the air: 1.4 adiabatic, 1 isothermal"),
    Part("oil", "vapour", "Pa", -9.5e4, -1.01e5, 0.0, "pressure at which oil boils: no chamber falls below"),
    Part(
        "oil",
        "thermal",
        "1/K",
        0.025,
        0.0,
        0.2,
        "by which leakage grows with temperature",
        "ISO VG 32 about 40 deg C",
    ),
    Part("motor", "displacement", "m^3/rad", None, 1e-9, 1.0, "of the motor", "paper, Table 1"),
    Part("motor", "volume", "m^3", None, 1e-8, 1.0, "of oil to each side, lines included"),
    Part("cylinder", "piston", "m", None, 1e-3, 2.0, "diameter of the piston", "paper, Table 1 (b)"),
    Part("cylinder", "rod", "m", 0.0, 0.0, 2.0, "diameter of the rod; 0: none", "paper, Table 1 (b)"),
    Part("cylinder", "half_stroke", "m", None, 1e-4, 20.0, "half of its stroke"),
    Part("cylinder", "volume", "m^3", None, 1e-8, 1.0, "of oil to each side beside the stroke: lines"),
    Part("cylinder", "base", "m", 1.0, 1e-3, 100.0, "from the crank's axis to the cylinder's pivot"),
    Part("cylinder", "length", "m", 1.0, 1e-3, 100.0, "between its pivots at angle 0"),
    Part("cylinder", "arm", "m", 0.0, 0.0, 100.0, "of the crank; 0: the load moves straight"),
    Part("leakage", "cross", "m^3/s/Pa", 0.0, 0.0, 1e-6, "between the chambers"),
    Part("leakage", "external", "m^3/s/Pa", 0.0, 0.0, 1e-6, "of each chamber to the tank"),
    Part("load", "inertia", "kg unit^2", None, 1e-9, 1e9, "all that moves", "paper, Table 1 (a)"),
    Part("load", "viscous", "N s/unit", 0.0, 0.0, 1e12, "friction in proportion to speed"),
    Part("load", "coulomb", "N unit", 0.0, 0.0, 1e12, "dry friction"),
    Part("load", "stribeck", "N unit", 0.0, 0.0, 1e12, "its excess at rest"),
    Part("load", "stribeck_speed", "unit/s", 1.0, 1e-9, 1e9, "at which that has fallen to 1/e"),
    Part("load", "force", "N unit", 0.0, -1e12, 1e12, "constant, against positive movement: weight"),
    Part("load", "spring", "N/unit", 0.0, -1e12, 1e12, "pulls it back"),
    Part("load", "spring_centre", "unit", 0.0, -1e9, 1e9, "position without that force"),
    Part("load", "second", "1", 0.0, 0.0, 100.0, "flexible part's inertia over the rest's; their sum stays"),
    Part("load", "second_omega", "rad/s", 1000.0, 1.0, 1e5, "of the flexible part with the rest held"),
    Part("load", "second_zeta", "1", 0.05, 0.0, 5.0, "its damping ratio"),
    Part("load", "shake", "N unit", 0.0, 0.0, 1e12, "amplitude of a periodic force"),
    Part("load", "shake_omega", "rad/s", 100.0, 1e-3, 1e5, "its frequency"),
    Part("load", "shake_phase", "rad", 0.0, -10.0, 10.0, "at the start"),
)
"""All parameters, in the order of the signal's way."""

BY_SLOT = {part.slot: part for part in PARTS}


def _closed(name: str, text: str, fields: dict[str, Any], total: bool) -> Any:
    typed_dict: Any = TypedDict  # type checkers want keys that are written down
    made = typed_dict(name, fields, total=total)
    made.__pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    made.__doc__ = text
    return made


def _number(part: Part) -> Any:
    bounds: dict[str, Any] = {"ge": part.low} | ({"le": part.high} if part.high < INF else {})
    default = "" if part.default is None else f"; default: {part.default:g}"
    number = Annotated[
        float, Field(allow_inf_nan=False, description=f"[{part.unit}] {part.text}{default}", **bounds)
    ]
    return number if part.default is None else NotRequired[number]


def _group(name: str, text: str) -> Any:
    numbers = {part.name: _number(part) for part in PARTS if part.group == name}
    return _closed(name.capitalize(), text, numbers, total=True)


OPTIONAL = ("oil", "motor", "cylinder", "leakage")
"""Sections that a rig file may leave out."""

if TYPE_CHECKING:
    Hydraulic = dict[str, dict[str, float]]
    """Values by section and key: only those that are written."""
else:
    Hydraulic = _closed(
        "Hydraulic",
        "A physical plant: docs/hydraulics.md.",
        {
            name: NotRequired[_group(name, text)] if name in OPTIONAL else _group(name, text)
            for name, text in GROUPS.items()
        },
        total=True,
    )


def contradiction(hydraulic: Hydraulic) -> str | None:
    """What does not fit together in a section that is sound key by key; None: nothing."""
    motor, cylinder = hydraulic.get("motor"), hydraulic.get("cylinder")
    if (motor is None) == (cylinder is None):
        return "a motor or a cylinder: give one of the two"
    supply = hydraulic["supply"]
    if supply.get("tank", 0.0) >= supply["pressure"]:
        return f"supply.tank {supply['tank']:g} Pa must lie below supply.pressure {supply['pressure']:g} Pa"
    droop, flow = supply.get("droop", 0.0), supply.get("flow", 1e-3)
    if droop * flow >= supply["pressure"]:
        return f"supply.droop times supply.flow, {droop * flow:g} Pa, must lie below supply.pressure"
    return None if cylinder is None else _cylinder_contradiction(cylinder)


def _cylinder_contradiction(cylinder: dict[str, float]) -> str | None:
    if cylinder.get("rod", 0.0) >= cylinder["piston"]:
        return f"cylinder.rod {cylinder['rod']:g} m must be thinner than the piston, {cylinder['piston']:g} m"
    arm, base, length = cylinder.get("arm", 0.0), cylinder.get("base", 1.0), cylinder.get("length", 1.0)
    if arm and not abs(base - arm) < length < base + arm:
        return f"cylinder: base {base:g}, arm {arm:g} and length {length:g} m make no triangle"
    return None
