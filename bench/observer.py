"""Whether fits that an observer pulls to the measurement reach the noise, beside today's starts.

    python bench/observer.py --out observer.jsonl --first 42000 --count 60   # again: goes on
    python bench/observer.py --out observer.jsonl --count 0                   # only the table

Each record hides one or two causes (`tests/blind`), and the model with just these is fitted to 6 s:

- `one start`: least squares from the baseline and each cause's first start;
- `observer`: the same start; the simulation is pulled to the readings by a critically damped observer of rate
  lambda omega_n, lambda going from 4 to 0 in ten stages of so many steps, each from where the last one ended;
- `starts`: all of today's: roots, starts of causes, plants of the relay's grid; each is tried by a few steps,
  the best four are fitted to the end;
- `both`: as `starts`, but the best four go through the observer's stages.

It prints who reaches the noise, and the median of the work [s of a usual machine] that each counted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from itertools import islice, product
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from hidden_cases import Invisible, draw
from hidden_records import make_record, write

import seod.diagnose.fitting.simulate as simulations
from seod.data import read
from seod.diagnose.causes.table import begun_from, searched_causes
from seod.diagnose.fitting import work
from seod.diagnose.fitting.initial_states import best_states, simulated_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.record.closed_form import UserValues, closed_form
from seod.diagnose.record.defects import examine
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.effect_starts import effect_starts
from seod.diagnose.starts.search_roots import hidden_by_offset, search_roots
from seod.diagnose.starts.sizes import scales
from sim import physics
from sim.compiled import Record, compiled
from sim.kernel import advance, measured
from sim.state import new_state
from sim.windows import _arrive, _begin, _loose, _valve

if TYPE_CHECKING:
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.search.screen import Screen

Array = np.ndarray

STAGES = (4.0, 2.0, 1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.01)
"""lambda, before the free run."""
STAGE_STEPS, LAST_STEPS, TRIED_STEPS, KEPT, MOST_STARTS = 3, 20, 3, 4, 48
REACHED = 1.15
"""Geometric mean of the windows' squared errors over the noise's, up to which a fit has reached it."""
WAYS = ("one start", "observer", "starts", "both")
HARD = (
    "coulomb_friction", "stribeck_friction", "backlash", "load_resonance", "transport_delay",
    "valve_hysteresis", "valve_lag", "square_root_flow", "valve_saturation", "load_spring",
)  # fmt: skip
EXCITATIONS = ("relay", "multisine", "steps", "two-phase")


class Pull:
    """Rate of the observer [rad/s]; 0: the free run."""

    rate = 0.0


@compiled
def _surround(s: Record, supply: Array, warmth: Array, force: Array, k: int) -> None:
    """Have the surroundings of row `k` from now on."""
    if len(supply):
        s.supply = supply[k]
    if len(warmth):
        s.warmth = warmth[k]
    if len(force):
        s.force = force[k]


@compiled
def pulled_windows(
    p: Record,
    v: Record,
    s: Record,
    t_u: Array,
    u: Array,
    t: Array,
    supply: Array,
    warmth: Array,
    force: Array,
    first: Array,
    last: Array,
    start: Array,
    limit: float,
    read_y: Array,
    rate: float,
    y: Array,
    inside: Array,
) -> None:
    """`sim.windows.follow_windows` with an observer: after each reading the state goes some way to it."""
    reached = 0
    for w in range(len(first)):
        reached = _valve(p, v, t_u, u, reached, t[first[w]])
        _begin(p, v, s, start[w])
        given = reached
        for k in range(first[w], last[w]):
            _surround(s, supply, warmth, force, k)
            while given < len(u) and t_u[given] + p.transport_delay_time <= t[k]:
                _arrive(p, s, t_u[given] + p.transport_delay_time, u[given])
                given += 1
            advance(p, s, t[k])
            y[k] = measured(p, s)
            if len(inside):
                inside[k, 0], inside[k, 1] = s.pressure, s.velocity
                inside[k, 2], inside[k, 3] = s.position, s.followed
                inside[k, 4] = _loose(p, s)
            if not abs(y[k]) <= limit:
                y[k : last[w]] = y[k]
                break
            missed = read_y[k] - y[k]
            if rate > 0.0 and k > first[w] and math.isfinite(missed):
                tick = t[k] - t[k - 1]
                kept = math.exp(-rate * tick)
                near, next_one = (1.0 - kept * kept) * missed, (1.0 - kept) ** 2 / tick * missed
                if p.measures_speed:
                    s.pressure += next_one
                    if s.motion != 0.0:
                        s.velocity, s.velocity2 = s.velocity + near, s.velocity2 + near
                else:
                    s.position, s.position2 = s.position + near, s.position2 + near
                    if s.motion != 0.0:
                        s.velocity, s.velocity2 = s.velocity + next_one, s.velocity2 + next_one
                    s.followed = physics.followed(p, s, s.position)
                s.lagged += near


def pulled_run(record, parts, start, *, states):
    """`seod.diagnose.fitting.simulate._run`, pulled."""
    seen, within = [], []
    for k, one in enumerate(parts.series):
        own = [w for w, (of, _, _) in enumerate(parts.windows) if of == k]
        if not own:
            continue
        first = np.array([parts.windows[w][1] for w in own], np.int64)
        last = np.array([parts.windows[w][2] for w in own], np.int64)
        begin = float(min(one.t[0], one.t_u[0]))
        valve, load = new_state(record, begin), new_state(record, begin)
        load["origin"] = one.t[0]
        y = np.empty(len(one.t))
        z = np.empty((len(one.t), 5)) if states else np.empty((0, 5))
        given = *one.drive, one.t, one.supply, one.warmth, one.force
        limit = 1e3 * float(np.max(np.abs(one.y)))
        read_y = np.where(one.good, one.y, np.nan)
        windows = first, last, start[own], limit, read_y, Pull.rate
        pulled_windows(record[0], valve[0], load[0], *given, *windows, y, z)
        work.spend(float(load["steps"][0]), int(np.sum(last - first)))
        seen += [y[a:b] for a, b in zip(first, last, strict=True)]
        within += [z[a:b] for a, b in zip(first, last, strict=True)]
    return np.concatenate(seen), np.concatenate(within)


def begin(path: Path, output: str) -> tuple[Screen, list[Fitted]]:
    """Windows for trying, and the plants from which causes are searched today."""
    recording = read([path])
    defects = examine(recording)
    one = series(recording, defects.bad, sees_speed=output == "velocity", step=defects.step,
                 late=defects.late, taken=defects.taken, hold="zero")  # fmt: skip
    to_fit, held = cut([one])
    small = segments(to_fit)
    screened = screen(small, map, Budget())
    begun = baseline(screened.cut, output == "velocity", {}, map, None)
    first = begun.best
    base = fit(first.model, small, first.x, simulated_states(first.model, first.x, small))
    begun = hidden_by_offset(
        begun, Judged.of(base, held), closed_form([recording], output, UserValues("zero"))
    )
    near = begun.closed or begun.near
    roots = search_roots(base, begun, scales(near, near.cut), screened.cut)
    return screened, [one for one in roots.begin if not one.model.names] or [roots.baseline]


def begins(screened: Screen, roots: list[Fitted], causes: tuple[str, ...]) -> list[tuple]:
    """Models with just these causes, and where to begin."""
    out = []
    for root in roots:
        model = root.model
        for name in causes:
            model = model.with_effect(name)
        at = root.model.values(root.x)
        plants = [plant.values() for plant in screened.plants(model, causes)]
        own = list(product(*(effect_starts(root, name, screened.cut) for name in causes)))
        sets = [{place: x for one in some for place, x in one.items()} for some in own]
        first = sets[0] if sets else {}
        for some in islice([*sets, *(first | plant for plant in plants)], MOST_STARTS):
            values = begun_from(at, some)
            turned = model.turned(values["K_L"])
            out.append((turned, turned.searched(values)))
    return out


def stages(model, cut_, x, start, rate):
    """Through the observer's stages, then the free run."""
    for part in STAGES:
        Pull.rate = part * rate
        here = fit(model, cut_, x, start, STAGE_STEPS)
        x, start = here.x, here.start
    Pull.rate = 0.0
    start = best_states(model, x, cut_, start, simulated_states(model, x, cut_))
    return fit(model, cut_, x, start, LAST_STEPS)


def plainly(model, cut_, x, most):
    return fit(model, cut_, x, simulated_states(model, x, cut_), most)


def ways(screened: Screen, roots: list[Fitted], causes: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Excess over the noise, and the work, of each."""
    every, cut_ = begins(screened, roots, causes), screened.cut
    (model, x), out = every[0], {}
    rate = roots[0].model.values(roots[0].x)["omega_n"]

    def done(name, since, fitted):
        out[name] = (float(fitted.excess), work.used_s() - since)

    since = work.used_s()
    done("one start", since, plainly(model, cut_, x, LAST_STEPS))
    since = work.used_s()
    done("observer", since, stages(model, cut_, x, simulated_states(model, x, cut_), rate))
    since = work.used_s()
    tried = sorted((plainly(*one[:1], cut_, one[1], TRIED_STEPS) for one in every), key=lambda one: one.cost)
    glanced = work.used_s() - since
    since = work.used_s() - glanced
    ends = [fit(one.model, cut_, one.x, one.start, LAST_STEPS) for one in tried[:KEPT]]
    done("starts", since, min(ends, key=lambda one: one.cost))
    since = work.used_s() - glanced
    ends = [stages(one.model, cut_, one.x, one.start, rate) for one in tried[:KEPT]]
    done("both", since, min(ends, key=lambda one: one.cost))
    return out


def case_of(number: int):
    excitation = EXCITATIONS[number % len(EXCITATIONS)]
    names = (HARD[number // len(EXCITATIONS) % len(HARD)],)
    if number // (len(EXCITATIONS) * len(HARD)) % 2:
        names = (names[0], HARD[(number * 7 + 3) % len(HARD)])
    if len(set(names)) < len(names):
        return None
    try:
        return draw(number, "one" if len(names) == 1 else "two", names, excitation, None, 0.01, 12.0)
    except Invisible:
        return None


def one_record(number: int, folder: Path) -> dict | None:
    case = case_of(number)
    if case is None:
        return None
    path, output = folder / "run.csv", "velocity" if case.rig.sees_speed else "position"
    write(make_record(case), path)
    try:
        screened, roots = begin(path, output)
        if not set(case.causes) <= set(searched_causes(roots[0].model.scales)):
            return None
        results = ways(screened, roots, case.causes)
    except (ValueError, ArithmeticError) as error:
        return {"number": number, "broke": str(error)}
    return {"number": number, "causes": list(case.causes), "excitation": case.excitation,
            "output": output, "ways": results}  # fmt: skip


def table(lines: list[dict]) -> None:
    lines = [line for line in lines if "ways" in line]
    print(f"{'':24}{'records':>9}" + "".join(f"{way:>12}" for way in WAYS))
    groups = {"all": lines}
    groups |= {kind: [one for one in lines if one["excitation"] == kind] for kind in EXCITATIONS}
    groups |= {f"{n} cause{'s' * (n > 1)}": [one for one in lines if len(one["causes"]) == n] for n in (1, 2)}
    for name, some in groups.items():
        if some:
            reached = [sum(one["ways"][way][0] < REACHED for one in some) for way in WAYS]
            print(f"{name:24}{len(some):9}" + "".join(f"{count:12}" for count in reached))
    if lines:
        used = [median(one["ways"][way][1] for one in lines) for way in WAYS]
        print(f"{'work, median [s]':33}" + "".join(f"{each:12.2f}" for each in used))
        only = [one for one in lines if one["ways"]["both"][0] < REACHED <= one["ways"]["starts"][0]]
        lost = [one for one in lines if one["ways"]["starts"][0] < REACHED <= one["ways"]["both"][0]]
        print("reached by `both` alone:", [(one["number"], *one["causes"]) for one in only])
        print("reached by `starts` alone:", [(one["number"], *one["causes"]) for one in lost])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "seod-observer.jsonl")
    parser.add_argument("--first", type=int, default=42000)
    parser.add_argument("--count", type=int, default=60)
    asked = parser.parse_args()
    simulations._run = pulled_run
    lines = [json.loads(line) for line in asked.out.read_text().splitlines()] if asked.out.exists() else []
    done = {line["number"] for line in lines}
    with tempfile.TemporaryDirectory() as folder, asked.out.open("a", encoding="utf-8") as out:
        for number in range(asked.first, asked.first + asked.count):
            if number not in done and (line := one_record(number, Path(folder))) is not None:
                lines.append(line)
                out.write(json.dumps(line) + "\n")
                out.flush()
                shown = {way: f"{a:.2f}" for way, (a, _) in line.get("ways", {}).items()}
                print(number, line.get("causes"), line.get("excitation"), shown or line, flush=True)
    table(lines)


if __name__ == "__main__":
    main()
