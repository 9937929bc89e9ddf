"""Records as measured rigs give them: other noise than white, other scales, coarse columns.

A case of `hidden_cases` is run as it is; what disturbs its readings has the deviation that white noise had,
so that what is visible stays so. Then time, length and the command's sign are changed, which changes no
physics but the numbers that are to be found.
"""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from hidden_cases import COARSE, run, supply_of
from hidden_records import Record, with_defects
from hidden_rig import GIVEN, Drive, simulate
from scipy.signal import lfilter

from sim.effects import EFFECTS

if TYPE_CHECKING:
    from hidden_cases import Case

COLOURS = (0.0, 0.5, 0.9, 0.95, 0.99)
"""Of noise from sample to sample, AR(1)."""
SLOWEST, FASTEST = 0.5, 700.0
"""Natural frequencies [rad/s]."""
BITS = (0, 0, 12, 16)
"""Of the converter behind the sensor; 0: none."""
ROOM = 1.5
"""Of the converter's range, over what is read."""
TURNED = {"asymmetric_gain.ratio", "null_shift.voltage"}
"""Numbers that turn their sign with the command's."""


@dataclass(frozen=True)
class Rough:
    """What a rig adds.

    Attributes:
        colour: Of the noise, AR(1).
        hum, wander, gusts: Parts of the disturbance's variance: a line, an offset that moves slowly, and what
            the load does under random torques; the rest is the noise.
        hum_hz: By the record's own clock.
        bits: Of the sensor's converter, and of the command's.
        time: Seconds of the file in one of the generator.
        length: Units of the file in one of the generator.
        sign: Of the command.
    """

    colour: float
    hum: float
    wander: float
    gusts: float
    hum_hz: float
    bits: int
    time: float
    length: float
    sign: float

    def as_json(self) -> dict[str, float]:
        return asdict(self)

    def converted(self, place: str, value: float, *, sees_speed: bool) -> float:
        """A number of an effect, in the file's units."""
        name, _, of = place.partition(".")
        unit = (
            next((p.unit for p in EFFECTS[name].parameters if p.name == of), "1") if name in EFFECTS else "1"
        )
        lengths, seconds = dimension(unit, sees_speed=sees_speed)
        sign = self.sign if place in TURNED else 1.0
        return sign * value * self.length**lengths * self.time**seconds

    def gain(self, K_L: float) -> float:
        """K_L in the file's units."""
        return self.sign * K_L * self.length / self.time

    @property
    def also_there(self) -> set[str]:
        """Causes that such a rig has beside those that are hidden: they may be named."""
        return {name for name, there in (("periodic_disturbance", self.hum), (COARSE, self.bits)) if there}

    def forgiven(self, causes, told: dict) -> dict:
        """The answer without what is there as well."""
        extra = self.also_there - set(causes)
        effects = [each for each in told["effects"] if each["name"] not in extra]
        freed = told["verdict"] == "effects" and not effects
        return told | {"effects": effects, "verdict": "clean" if freed else told["verdict"]}


def dimension(unit: str, *, sees_speed: bool) -> tuple[int, int]:
    """Powers of length and time in a unit such as `unit/s^2` or `rad/unit`."""
    if "for a speed" in unit:
        unit = "unit/s" if sees_speed else "unit"
    above, _, below = unit.partition("/")
    powers = {"unit": 0, "s": 0}
    for part, sign in ((above, 1), (below, -1)):
        for name, power in re.findall(r"\b(unit|s)\b(?:\^(\d))?", part):
            powers[name] += sign * int(power or 1)
    return powers["unit"], powers["s"]


def rough(case: Case) -> Rough:
    """What the rig of a case's number adds."""
    random = np.random.default_rng([case.number, 9])
    parts = random.dirichlet([1.0, 1.0, 1.0, 1.0]) * (random.random(4) < (1.0, 0.4, 0.4, 0.4))
    parts = parts / parts.sum()
    omega_n = float(np.exp(random.uniform(math.log(SLOWEST), math.log(FASTEST))))
    return Rough(
        colour=float(random.choice(COLOURS)),
        hum=float(parts[1]),
        wander=float(parts[2]),
        gusts=float(parts[3]),
        hum_hz=float(np.exp(random.uniform(math.log(3.0), math.log(200.0)))),
        bits=int(random.choice(BITS)),
        time=case.rig.omega_n / omega_n,
        length=float(10.0 ** random.uniform(-3.0, 3.0)),
        sign=float(random.choice([-1.0, 1.0])),
    )


def make_rough_record(case: Case, how: Rough) -> Record:
    """What the file holds."""
    random = np.random.default_rng([case.number, 10])
    noise = case.noise * _disturbance(case, how, random)
    shaken = _shaken(case, how)
    y, u = run(shaken, noise)
    y = with_defects(case, y, random)
    supply = supply_of(case)
    scale = how.length / how.time if case.rig.sees_speed else how.length
    t = case.t * how.time
    t_u = t + case.latency * how.time if case.latency else None
    y, u = _converted(y * scale, how.bits), _converted(u * how.sign, how.bits)
    return Record(t, u, y, t_u, None if supply is None else 7e6 * supply)


def _disturbance(case: Case, how: Rough, random):
    """Of the readings, in noise deviations: noise of a colour, a line, an offset that moves slowly."""
    n = len(case.t)
    noise = lfilter([math.sqrt(1.0 - how.colour**2)], [1.0, -how.colour], random.normal(size=n + 1000))[1000:]
    line = math.sqrt(2.0) * np.sin(2.0 * math.pi * how.hum_hz * case.t + random.uniform(0.0, 6.3))
    slow = 2.0 * math.pi * case.t / case.duration * random.uniform(0.3, 1.5)
    wander = math.sqrt(2.0) * np.sin(slow + random.uniform(0.0, 6.3))
    plain = 1.0 - how.hum - how.wander - how.gusts
    return math.sqrt(plain) * noise + math.sqrt(how.hum) * line + math.sqrt(how.wander) * wander


def _shaken(case: Case, how: Rough) -> Case:
    """With random torques under which the reading moves as much as their part of the disturbance."""
    if how.gusts <= 0.0 or "gusts" in case.rig.effects:
        return case
    _, u = run(case)
    tried = _with_gusts(case, case.rig.omega_n**2 * case.noise)
    given = Drive(GIVEN, u)
    random = np.random.default_rng([case.number, 3])
    keep = math.exp(-case.tick * case.rig.omega_n)
    torque = lfilter([1.0], [1.0, -keep], random.normal(0.0, math.sqrt(1.0 - keep**2), len(u)))
    quiet, moved = (
        simulate(each.rig, case.t, given, None, supply_of(case), torque, case.latency)[0]
        for each in (case, tried)
    )
    size = float(np.std(moved - quiet))
    strength = tried.rig.effects["gusts"]["strength"] * math.sqrt(how.gusts) * case.noise / max(size, 1e-300)
    return _with_gusts(case, strength)


def _with_gusts(case: Case, strength: float) -> Case:
    return replace(case, rig=replace(case.rig, effects=case.rig.effects | {"gusts": {"strength": strength}}))


def _converted(x, bits: int):
    """Behind a converter whose range is a little wider than what there is."""
    if not bits:
        return x
    step = ROOM * float(np.nanmax(x) - np.nanmin(x)) / 2**bits
    return np.round(x / step) * step
