"""Writes the extended model into a rig file: a copy of the user's own, or a new one for a recording alone."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from seod.config.edit import REMOVED, edited
from seod.config.load import load_text
from seod.config.units import UNITS
from seod.diagnose.extend.model import rounded
from seod.simulate.view import AxisView
from sim.experiment import sensor_effects

if TYPE_CHECKING:
    from seod.config.errors import KeyPath
    from seod.config.model import RigConfig
    from seod.diagnose.extend.model import Model
    from seod.diagnose.extend.seen import Seen

_TEMPLATE: Final = Path(__file__).parent / "rig_template.yaml"
FURTHER_PORTS: Final = 10
"""Added to the port of the user's own rig file: the daemon of the measured rig may be running."""
_RATES: Final = (100.0, 10_000.0)
"""Of the loop [Hz]."""


def into_config(text: str, config: RigConfig, axis: str, model: Model) -> str:
    """The rig file with the model in its simulated plant and a port aside; comments and all else stay.

    Args:
        text: The rig file; it has a `simulation:` section.
        config: What it says.
        axis: Whose plant it is.
        model: In the axis' units.

    Raises:
        ValueError: No simulated plant belongs to the axis, or it moves the other way.
    """
    view = AxisView(config, axis)
    if not (view.per_volt > 0.0 and view.slope > 0.0 and model.K_L > 0.0):
        raise ValueError(f"axis {axis}: its plant, its sensor or its output is turned round")
    numbers = model.in_units_of(view.slope, view.per_volt).numbers()
    for name in set(sensor_effects(view.plant)) - {"sensor_quantization"}:
        numbers["effects"].pop(name, None)  # the plant's `sensor` has it
    plants = config.simulation.plants if config.simulation else {}
    plant = next(name for name, each in plants.items() if each is view.plant)
    places: dict[KeyPath, object] = {
        ("simulation", "plants", plant, key): each for key, each in numbers.items()
    }
    if view.plant.hydraulic is not None:  # the model is one of Eq. 1 with effects
        places |= {("simulation", "plants", plant, key): REMOVED for key in ("plant", "hydraulic")}
    if config.server.port:
        places["server", "port"] = config.server.port + FURTHER_PORTS
    return edited(text, places)


def new_rig_file(model: Model, excitation: Seen, speed: bool, source: str) -> str:
    """A rig file of a virtual rig that is excited as the recording was.

    Args:
        model: The plant.
        excitation: What the recording tells of its excitation.
        speed: Whether y is a speed.
        source: Name of the recording.

    Raises:
        ConfigErrors: Its numbers make no rig, such as a range that is empty.
    """
    bias = math.copysign(excitation.bias, excitation.bias * model.K_L)
    plant = model.upright()
    filled = _TEMPLATE.read_text("utf-8")
    fields = _words(excitation, speed, source) | _ranges(plant, excitation, speed, bias)
    for key, value in fields.items():
        filled = filled.replace(f"<{key}>", value)
    lines = [line for line in filled.splitlines(keepends=True) if not line.lstrip().startswith("~")]
    places: dict[KeyPath, object] = {
        ("simulation", "plants", "plant", key): each for key, each in plant.numbers().items()
    }
    text = edited("".join(lines), places)
    load_text(text, f"the extended rig of {source}", Path())
    return text


def _ranges(plant: Model, excitation: Seen, speed: bool, bias: float) -> dict[str, str]:
    """The axis' numbers: limits of a rig that cannot be hurt, wide around what was seen and is expected."""
    at_resonance = 1.3 * excitation.e_a * plant.K_L / (2.0 * plant.zeta)
    amplitude = at_resonance / plant.omega_n + excitation.hysteresis
    reach = 4.0 * max(amplitude, excitation.high - excitation.low)
    seen = max(abs(excitation.low), abs(excitation.high)) if speed else 0.0
    fastest = 4.0 * max(seen, at_resonance, plant.K_L * excitation.most_volts)
    reference = excitation.centre if speed else 0.0
    held = abs(reference) / plant.K_L
    rate = min(_RATES[1], max(_RATES[0], excitation.rate_hz))
    numbers = {
        "rate": rate,
        "K_L": plant.K_L,
        "e_a": excitation.e_a,
        "hysteresis": excitation.hysteresis,
        "bias": bias - reference / plant.K_L,
        "output": 2.0 * max(excitation.most_volts, excitation.e_a + abs(bias)) + 2.0 * held,
        "low": -fastest if speed else excitation.centre - 4.0 * reach,
        "high": fastest if speed else excitation.centre + 4.0 * reach,
        "amplitude": reach,
        "speed": fastest,
        "movement": 0.01 * (fastest if speed else amplitude),
        "reference": reference,
        "position": excitation.centre,
    }
    return {key: f"{rounded(x)!r}" for key, x in numbers.items()}


def _words(excitation: Seen, speed: bool, source: str) -> dict[str, str]:
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(source).name.split(".")[0]).strip("-_")
    return {
        "name": name[:40] or "recording",
        "source": " ".join(source.split()),
        "unit": _unit(excitation.unit, speed),
        "mode": "velocity" if speed else "position",
        "speed_only": "" if speed else "~",
        "position_only": "~" if speed else "",
    }


def _unit(found: str, speed: bool) -> str:
    """A unit that rig files know: where the recording tells none, metres stand for it."""
    wanted = ("angular speed", "speed") if speed else ("angle", "length")
    if UNITS.get(found, ("",))[0] in wanted:
        return found
    return "m/s" if speed else "m"
