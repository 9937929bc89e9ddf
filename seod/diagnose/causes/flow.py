"""Causes in the flow through the valve, and in the oil."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.cause import Alike, Cause, signed, sized

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Scales, Values

RATIO_SCALE, LARGEST_RATIO, RATIO_START = 0.1, 0.9, 0.02
"""Of unequal gains: size in whose steps their ratio is searched, its limit (one gain is then a nineteenth of
the other), and a start; chosen."""
LEAST_SUPPLY, LARGEST_SUPPLY = 0.5, 100.0
"""Supply over the load pressure, at least and at most: beyond it the orifice's flow is straight to 0.5 %."""
SUPPLIES: Final = (1.0, 2.0, 5.0)
"""Starts of the supply over the load pressure; chosen."""
LEAST_AIR, MOST_AIR = 1e-4, 100.0
"""Air's compliance over the oil's: less is not seen, more is the simulated plant's own limit."""
AIR: Final = (0.05, 0.5)
"""Starts of it; chosen."""


def full_pressure(values: Values, scales: Scales) -> float:
    """What the largest command's flow is worth as a constant load [unit/s^2], by the plant's own leakage.

    The inverse of `null_of_load`, times that command.
    """
    return values["omega_n"] * values["K_L"] * scales.volts / (2.0 * values["zeta"])


def null_of_load(values: Values) -> float:
    """Null shift that is, while the flow is straight, a constant load of 1 unit/s^2 [V s^2/unit].

    A constant load f needs the opening 2 zeta f / (omega_n K_L): `docs/model.md`, Equations.
    """
    return 2.0 * values["zeta"] / (values["omega_n"] * values["K_L"])


ASYMMETRIC_GAIN: Final = Cause(
    name="asymmetric_gain",
    says="Openings of the two signs have unequal gains: an unequal cylinder, or an unequal spool.",
    coordinates=lambda _: (signed("ratio", RATIO_SCALE, LARGEST_RATIO),),
    starts=lambda _: ((RATIO_START,),),
    alike=(
        Alike(
            "load_bias",
            lambda v, s: {"load_bias.acceleration": -v["asymmetric_gain.ratio"] * full_pressure(v, s)},
            two_commands_only=True,
        ),
    ),
    mirrored=("ratio",),
)
SQUARE_ROOT_FLOW: Final = Cause(
    name="square_root_flow",
    says="The flow falls with the square root of the pressure that the load leaves: an orifice.",
    coordinates=lambda s: (sized("supply", LEAST_SUPPLY * s.pressure, LARGEST_SUPPLY * s.pressure),),
    starts=lambda s: tuple((x * s.pressure,) for x in SUPPLIES),
)
PRESSURE_DEPENDENT_STIFFNESS: Final = Cause(
    name="pressure_dependent_stiffness",
    says="Air in the oil makes it softer where the supply pressure falls.",
    coordinates=lambda _: (sized("air", LEAST_AIR, MOST_AIR),),
    starts=lambda _: tuple((x,) for x in AIR),
    searched=lambda s: s.pressed,
)
FLOW: Final = (ASYMMETRIC_GAIN, SQUARE_ROOT_FLOW, PRESSURE_DEPENDENT_STIFFNESS)
