"""Hides one cause in records of the physical plants, and asks the diagnosis: who is named, what it foretells.

    python bench/diagnose_physical.py --out physical.jsonl --count 200     # the same file again: goes on
    python bench/diagnose_physical.py --out physical.jsonl --count 0       # only the tables

The plants are other physics than the model that is searched: chambers, orifices, a spool of second
order. What they always have may be named beside the cause: square_root_flow and a lag of valve or
sensor. A leakage is linear: it changes zeta, and nothing else may be named. The held-out record is at
another operating point, pressure +-2 MPa and amplitude x 0.5 or x 2: the extended model must foretell it
better than the baseline, where there is a name. Goals: 95 % of 200 for both.

A null shift counts as `load_bias`.
A single rod is like the shipped tail's: its valve leaks and is adjusted, its seals rub in proportion to
speed, and it stays within an eighth of half its stroke. It extends faster than it retracts:
`asymmetric_gain`, or a `static_valve_map`, whose even part is that ratio. A `load_bias` is not right: without
load A pA = B pB.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

import diagnose_physical as importable  # this module by the name that workers know
from hidden_score import wilson
from through import add_options, results

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.result import DiagnoseError
from sim.config import PlantConfig
from sim.hydraulics.linear import Physics
from sim.hydraulics.record import record_of
from sim.machine import HydraulicMachine

GOAL = 0.95
TICK = 1e-3
DURATION = 12.0
NOISE = 0.003
"""Part of the movement's standard deviation."""
ALWAYS = {"square_root_flow", "valve_lag", "sensor_lag", "transport_delay"}
"""What a physical plant has, whatever is switched on."""
NONE = np.empty(0)
LITRE = 1e-3 / 60.0
VALVE_LEAKAGE, SEALS = 0.7 * LITRE, 5e-13
"""Of a rod, as of the shipped tail: through the closed valve [m^3/s], without which chambers at rest run
empty, and past the seals [m^3/s/Pa]."""
HOLDS, HELD_EVERY = 2.0, 100
"""A slow loop keeps a rod about its middle: of its way so much a second [1/s], every so many ticks."""

CAUSES = {
    "friction": {"coulomb_friction", "stribeck_friction"},
    "overlap": {"valve_deadband", "static_valve_map"},
    "air": {"pressure_dependent_stiffness"},
    "leakage": set(),
    "null shift": {"load_bias"},
    "hysteresis": {"valve_hysteresis"},
    "single rod": {"asymmetric_gain", "static_valve_map"},
    "shaking": {"periodic_disturbance"},
    "spool lag": {"valve_lag", "sensor_lag", "transport_delay"},
}
"""Causes and the names that are right for them."""


def base(random: np.random.Generator, rod: bool) -> dict[str, dict[str, float]]:
    """A plant of omega_n 60 to 160 rad/s, damped by leakage; a rod is faster, damped by its seals."""
    ps, omega_n, zeta = 7e6, random.uniform(60.0, 160.0), random.uniform(0.2, 0.6)
    volume, E = random.uniform(5e-5, 2e-4), 1.3e9
    parts: dict[str, dict[str, float]] = {
        "supply": {"pressure": ps},
        "valve": {"rated_flow": 30 * LITRE, "rated_drop": 21e6, "omega": random.uniform(800.0, 1200.0)},
        "oil": {"air": 0.0, "bulk_modulus": E},
        "leakage": {"cross": zeta * omega_n * volume / E},
    }
    if rod:
        area = 1.0e-3
        half = volume / area
        inertia = E * 1.6 * area**2 / (volume * omega_n**2) / 1.3
        parts["cylinder"] = {"piston": 0.04, "rod": 0.025, "half_stroke": 0.5 * half, "volume": 0.4 * volume}
        parts["leakage"]["cross"] = SEALS
        parts["load"] = {"inertia": inertia, "viscous": 2.0 * zeta * omega_n * inertia}
        parts["valve"]["leakage"] = VALVE_LEAKAGE
        parts["valve"]["null_bias"] = -Physics(record_of(configured(parts)), 0.0).steady(0.0).volts
    else:
        displacement = 10 ** random.uniform(-5.5, -4.3)
        parts["motor"] = {"displacement": displacement, "volume": volume}
        parts["load"] = {"inertia": 2.0 * E * displacement**2 / (volume * omega_n**2)}
    return parts


def with_cause(cause: str, parts: dict[str, dict[str, float]], e_a: float, random: np.random.Generator):
    """One cause switched on; its size well within what is met."""
    area = parts["motor"]["displacement"] if "motor" in parts else 1.0e-3
    force = area * parts["supply"]["pressure"]
    if cause == "friction":
        parts["load"]["coulomb"] = force * random.uniform(0.01, 0.05)
    elif cause == "overlap":
        parts["valve"]["overlap"] = e_a * random.uniform(0.08, 0.3)
    elif cause == "air":
        parts["oil"]["air"] = random.uniform(0.02, 0.06)
    elif cause == "leakage":
        parts["leakage"]["cross"] *= random.uniform(1.5, 3.0)
    elif cause == "null shift":
        parts["valve"]["null_bias"] = e_a * random.uniform(0.1, 0.4) * random.choice([-1.0, 1.0])
    elif cause == "hysteresis":
        parts["valve"]["hysteresis"] = e_a * random.uniform(0.05, 0.2)
    elif cause == "shaking":
        parts["load"] |= {
            "shake": force * random.uniform(0.02, 0.06),
            "shake_omega": random.uniform(150, 900),
        }
    elif cause == "spool lag":
        parts["valve"] |= {"omega": random.uniform(150.0, 350.0), "zeta": random.uniform(0.7, 1.0)}


def plant_of(cause: str, number: int) -> tuple[PlantConfig, float, np.random.Generator]:
    """The plant, the amplitude of its command [V], and where more chance comes from."""
    random = np.random.default_rng([number, list(CAUSES).index(cause)])
    parts, e_a = base(random, cause == "single rod"), random.uniform(0.4, 1.0)
    with_cause(cause, parts, e_a, random)
    return configured(parts), e_a, random


def configured(parts: dict[str, dict[str, float]]) -> PlantConfig:
    """A plant of these parts whose speed is measured."""
    fields = {"plant": "hydraulic", "input": "u", "output": "y", "measures": "velocity", "hydraulic": parts}
    return PlantConfig.model_validate(fields)


def command(t: np.ndarray, plant: PlantConfig, e_a: float, random: np.random.Generator) -> np.ndarray:
    """A multisine and steps of random levels, the largest about `e_a` [V]."""
    own = plant.omega_n / (2.0 * math.pi)
    hertz = np.geomspace(0.1 * own, 2.5 * own, 25)
    waves = np.sin(2.0 * math.pi * np.outer(t, hertz) + random.uniform(0.0, 2.0 * math.pi, 25)).sum(axis=1)
    length = max(2, round(1.5 / own / TICK))
    steps = np.repeat(random.uniform(-1.0, 1.0, len(t) // length + 1), length)[: len(t)]
    return e_a * (0.5 * waves / np.abs(waves).max() + 0.5 * steps)


def record(plant: PlantConfig, u: np.ndarray, t: np.ndarray, ps: np.ndarray, random: np.random.Generator):
    """The command that was given, and readings of the speed with noise."""
    machine = HydraulicMachine(plant, 0.0)
    supply = ps / 7e6
    machine.surround(supply, NONE)
    if "cylinder" in plant.hydraulic:
        u, y = held(machine, plant, u, t, supply)
    else:
        y = machine.follow(t, u, t, NONE, (supply, NONE, NONE))
    return u, y + random.normal(0.0, NOISE * float(np.std(y)), len(y))


def held(machine: HydraulicMachine, plant: PlantConfig, u: np.ndarray, t: np.ndarray, supply: np.ndarray):
    """A rod's command and speed: a slow loop about the command keeps the piston well within its cylinder."""
    given, y = u.copy(), np.empty(len(u))
    for first in range(0, len(t), HELD_EVERY):
        now = slice(first, first + HELD_EVERY)
        given[now] -= HOLDS / plant.K_L * float(machine.state["position"][0])
        y[now] = machine.follow(t[now], given[now], t[now], NONE, (supply[now], NONE, NONE))
    return given, y


def write(path: Path, t: np.ndarray, u: np.ndarray, y: np.ndarray, ps: np.ndarray) -> None:
    with path.open("w", encoding="ascii") as file:
        file.write("t,u,y,ps\n")
        file.writelines(f"{a:.9g},{b:.9g},{c:.9g},{d:.9g}\n" for a, b, c, d in zip(t, u, y, ps, strict=True))


def case(number: int) -> tuple[str, PlantConfig, list[tuple[np.ndarray, ...]], dict[str, float]]:
    """A cause, its plant, the record and the one at another operating point."""
    cause = list(CAUSES)[number % len(CAUSES)]
    plant, e_a, random = plant_of(cause, number)
    t = np.arange(round(DURATION / TICK)) * TICK
    u = command(t, plant, e_a, random)
    swing = 2e6 * np.sin(2.0 * math.pi * 0.25 * t) if cause == "air" else np.zeros(len(t))
    other = {
        "pressure": 2e6 * float(random.choice([-1.0, 1.0])),
        "amplitude": float(random.choice([0.5, 2.0])),
    }
    found = []
    for shift, times in ((0.0, 1.0), (other["pressure"], other["amplitude"])):
        ps = 7e6 + swing + shift
        given, y = record(plant, times * u, t, ps, random)
        found.append((t, given, y, ps))
    return cause, plant, found, other


def judged(cause: str, told: dict[str, Any]) -> bool:
    """Whether the right name is among those that are told, and no wrong one."""
    effects = told["effects"]
    right = CAUSES[cause]
    hits = [each for each in effects if right & {each["name"], *each["indistinguishable_from"]}]
    others = {each["name"] for each in effects if each not in hits} - ALWAYS
    return not others and (bool(hits) or not right)


def line(number: int, folder: Path) -> dict[str, Any]:
    cause, plant, records, other = case(number)
    paths = [folder / "run.csv", folder / "other.csv"]
    for path, columns in zip(paths, records, strict=True):
        write(path, *columns)
    before = process_time()
    try:
        told = diagnose([read(paths[0])], [read(paths[1])], Options(output="velocity")).as_json()
    except DiagnoseError as error:
        told = {"verdict": f"refused: {error}", "effects": []}
    baseline, extended = ((told.get(name) or {}).get("holdout_nrmse") for name in ("baseline", "extended"))
    return {
        "number": number,
        "cause": cause,
        "plant": [plant.K_L, plant.omega_n, plant.zeta],
        "other": other,
        "verdict": told["verdict"],
        "named": [each["name"] for each in told["effects"]],
        "alike": [each["indistinguishable_from"] for each in told["effects"]],
        "unexplained": told.get("unexplained"),
        "right": judged(cause, told),
        "baseline": baseline,
        "extended": extended,
        "seconds": process_time() - before,
    }


def told_of(number: int) -> dict[str, Any]:
    """The line of a record."""
    with tempfile.TemporaryDirectory() as folder:
        return line(number, Path(folder))


def table(lines: list[dict[str, Any]]) -> None:
    by = defaultdict(list)
    for each in lines:
        by[each["cause"]].append(each)
    print(f"{'cause':12} {'n':>4} {'right':>6} {'better':>7} {'unexplained':>12}   named")
    for cause, some in by.items():
        names = sorted({name for each in some for name in each["named"]})
        better = sum(_is_better(each) for each in some)
        odd = sum(each["verdict"] == "unexplained" for each in some)
        right = sum(each["right"] for each in some)
        print(f"{cause:12} {len(some):4} {right:6} {better:7} {odd:12}   {', '.join(names)}")
    asked = [each for each in lines if CAUSES[each["cause"]]]
    for what, hits, n in (
        ("right name", sum(each["right"] for each in lines), len(lines)),
        ("foretold better", sum(_is_better(each) for each in asked), len(asked)),
    ):
        low, high = wilson(hits, n)
        ends = f"{100 * low:.0f} to {100 * high:.0f} %"
        print(f"{what}: {hits} of {n}, Wilson 95 % {ends} (goal {100 * GOAL:.0f} %)")


def _is_better(each: dict[str, Any]) -> bool:
    return None not in (each["baseline"], each["extended"]) and each["extended"] < each["baseline"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "seod-physical.jsonl")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=200)
    add_options(parser, workers=0)
    args = parser.parse_args()
    there = args.out.read_text().splitlines() if args.out.exists() else []
    lines = [json.loads(each) for each in there]
    done = {each["number"] for each in lines}
    wanted = (n for n in range(args.first, args.first + args.count) if n not in done)
    with args.out.open("a", encoding="utf-8") as out:
        for _, found in results(args, importable.told_of, wanted):
            lines.append(found)
            out.write(json.dumps(found) + "\n")
            out.flush()
    table(sorted(lines, key=lambda each: each["number"]))


if __name__ == "__main__":
    main()
