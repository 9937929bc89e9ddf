"""What a tick of the physical plants costs beside the reduced kernel, interleaved.

    python bench/hydraulics.py [--rounds 11] [--ticks 20000]

Each of the shipped physical rigs in the limit cycle of its own relay, 0.5 ms a tick; beside it Eq. 1 of
the same small signals, alone and with the effects that a physical plant always has. Goal: at most 5
times the reduced kernel's.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from bench_pairs import alternate

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from sim.machine import HydraulicMachine, ReducedMachine
from sim.runs import RELAY

if TYPE_CHECKING:
    from sim.config import PlantConfig

NONE = np.empty(0)
TICK = 5e-4
GOAL = 5.0


def limit_cycle(plant: PlantConfig, e_a: float, ticks: int):
    """A run to be timed."""
    t = np.arange(ticks) * TICK
    relay = np.zeros(1, RELAY)
    relay["e_a"], relay["hysteresis"] = e_a, 1e-3 * e_a * plant.K_L / (plant.zeta * plant.omega_n)
    kind = HydraulicMachine if plant.hydraulic else ReducedMachine

    def run() -> None:
        kind(plant, 0.0).relay(relay, t, NONE, (NONE, NONE, NONE))

    return run


def with_effects(plant: PlantConfig) -> PlantConfig:
    """Eq. 1 with an orifice, friction and a spool's lag: what the physical plant has as well."""
    reduced = plant.reduced
    effects = {
        "square_root_flow": {"supply": 4.0 * plant.K_L * plant.omega_n},
        "coulomb_friction": {"level": 0.01 * plant.K_L * plant.omega_n},
        "valve_lag": {"time": 1e-3},
    }
    return reduced.model_copy(update={"effects": {**reduced.effects, **effects}})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--ticks", type=int, default=20_000)
    args = parser.parse_args()
    print(
        f"{'plant':24} {'ns a tick':>10} {'over Eq. 1':>12} {'over Eq. 1 with effects':>24}   goal {GOAL:g}"
    )
    for name in ("servo", "seat", "tail"):
        config = load_rig(configs_dir() / f"{name}-hydraulic.yaml")
        assert config.simulation is not None
        for axis, plant in config.simulation.plants.items():
            speed = plant.model_copy(update={"sensor": None, "measures": "position"})
            e_a = config.axes[axis].relay.e_a
            own = limit_cycle(speed, e_a, args.ticks)
            plain = alternate(own, limit_cycle(speed.reduced, e_a, args.ticks), args.rounds)
            rich = alternate(own, limit_cycle(with_effects(speed), e_a, args.ticks), args.rounds)
            cost = 1e9 * float(np.median(plain.first)) / args.ticks
            print(f"{name + ': ' + axis:24} {cost:10.0f} {plain.ratio:12.2f} {rich.ratio:24.2f}")


if __name__ == "__main__":
    main()
