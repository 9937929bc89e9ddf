"""Have a plant of each kind once, so that its machine code is kept: `python -m sim.compile_plant KIND ...`.

Apart from `sim.cache`, which needs no numba and starts this as a process of its own.
"""

from __future__ import annotations

import sys

from sim.config import PlantConfig
from sim.hydraulics.live import HydraulicPlant
from sim.hydraulics.record import record_of
from sim.parameters import parameters
from sim.plant import Plant

PARTS = {
    "supply": {"pressure": 7e6},
    "valve": {"rated_flow": 5e-4},
    "motor": {"displacement": 1e-5, "volume": 1e-4},
    "load": {"inertia": 1.0},
}
"""Of some hydraulic plant: machine code is the same for all."""


def main() -> None:
    """Have a plant of each kind that is named; without a name a reduced one."""
    kinds = sys.argv[1:] or ["reduced"]
    if "hydraulic" in kinds:
        _have_hydraulic()
    if "reduced" in kinds:
        Plant(parameters(1.0, 1.0, 1.0))


def _have_hydraulic() -> None:
    plant = PlantConfig.model_validate(
        {"plant": "hydraulic", "input": "u", "output": "y", "hydraulic": PARTS}
    )
    HydraulicPlant(record_of(plant))


if __name__ == "__main__":
    main()
