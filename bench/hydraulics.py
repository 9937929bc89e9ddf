"""What a tick of the physical plants costs beside the reduced kernel, and how exact it is.

    python bench/hydraulics.py [--rounds 21] [--ticks 4000]

Each of the shipped physical rigs in the limit cycle of its own relay, 0.5 ms a tick; beside it Eq. 1 of
the same small signals, alone and with the effects that a physical plant always has. Both take turns;
ratios are medians of processor time. Goal: at most 5 times the reduced kernel's. The last column is the
largest difference of the speed, over its range, from the same commands in ticks 32 times shorter.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from bench_pairs import alternate

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from sim.hydraulics.closed_loop import INSIDE, follow
from sim.machine import HydraulicMachine, ReducedMachine
from sim.runs import RELAY

if TYPE_CHECKING:
    from sim.config import PlantConfig

NONE = np.empty(0)
TICK = 5e-4
GOAL = 5.0
FINER = 32
SPEED = INSIDE.index("velocity")


def machine_of(plant: PlantConfig):
    """The plant, at rest."""
    return (HydraulicMachine if plant.hydraulic else ReducedMachine)(plant, 0.0)


def relay_of(plant: PlantConfig, e_a: float):
    """A relay that switches soon after the middle."""
    relay = np.zeros(1, RELAY)
    relay["e_a"], relay["hysteresis"] = e_a, 1e-3 * e_a * plant.K_L / (plant.zeta * plant.omega_n)
    return relay


def limit_cycle(plant: PlantConfig, e_a: float, ticks: int):
    """A run to be timed."""
    t, relay = np.arange(ticks) * TICK, relay_of(plant, e_a)

    def run() -> None:
        machine_of(plant).relay(relay, t, NONE, (NONE, NONE, NONE))

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


def exactness(plant: PlantConfig, e_a: float, ticks: int) -> tuple[float, float]:
    """Runge-Kutta steps a tick of the limit cycle, and the speed's error over its range."""
    machine, t = machine_of(plant), np.arange(ticks) * TICK
    _, u, t_u = machine.relay(relay_of(plant, e_a), t, NONE, (NONE, NONE, NONE))
    steps = float(machine.state["steps"][0]) / ticks
    coarse = speeds(plant, t_u, u, t)
    fine = speeds(plant, t_u, u, np.arange(ticks * FINER) * (TICK / FINER))[::FINER]
    return steps, float(np.abs(coarse - fine).max() / np.ptp(fine))


def speeds(plant: PlantConfig, t_u: np.ndarray, u: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Of the load at `t` [s] under these commands."""
    machine, inside = machine_of(plant), np.empty((len(t), len(INSIDE)))
    follow(machine.p[0], machine.state[0], t_u, u, t, NONE, NONE, NONE, np.empty(len(t)), inside)
    return inside[:, SPEED]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--ticks", type=int, default=4000)
    args = parser.parse_args()
    print(f"goal: at most {GOAL:g} times Eq. 1")
    print(
        f"{'plant':18} {'ns a tick':>10} {'over Eq. 1':>12} {'over Eq. 1 with effects':>24}"
        f" {'steps a tick':>13} {'error':>9}"
    )
    for name in ("servo", "seat", "tail"):
        config = load_rig(configs_dir() / f"{name}-hydraulic.yaml")
        assert config.simulation is not None
        for axis, plant in config.simulation.plants.items():
            speed = plant.model_copy(update={"sensor": None, "measures": "position"})
            e_a = config.axes[axis].relay.e_a
            own = limit_cycle(speed, e_a, args.ticks)
            others = (limit_cycle(each, e_a, args.ticks) for each in (speed.reduced, with_effects(speed)))
            plain, rich = (alternate(own, other, args.rounds, clock=process_time) for other in others)
            cost = 1e9 * float(np.median(plain.first)) / args.ticks
            steps, error = exactness(speed, e_a, args.ticks)
            print(
                f"{name + ': ' + axis:18} {cost:10.0f} {plain.ratio:12.2f} {rich.ratio:24.2f}"
                f" {steps:13.2f} {error:9.1e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
