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
from hidden_baseline import best_baseline
from hidden_cases import COARSE, SENSORS_SINCE, channel_of, run, supply_of, torque_of
from hidden_drives import make_drive
from hidden_records import Record, with_defects
from hidden_rig import GIVEN, Drive, simulate
from hidden_strength import UNLISTED
from scipy.signal import detrend, lfilter

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
MAINS_HZ = 50.0
"""By the file's clock; above half its rate it is seen as another one."""
OVERTONES = (1.0, 0.3, 0.2)
"""Of mains: twice and three times its frequency at most as large as that."""
SAMPLERS = ("none", "finer", "late", "slower")
OF_SAMPLERS = (0.4, 0.2, 0.2, 0.2)
"""How often each is drawn."""
FINER, SLOWER = (2, 4, 8), (2, 3, 4)
"""Commands in the place of one row; rows in the place of one command."""
MILD_SINCE = 130000
"""From this number on a sampler loses no more than the noise: a cause that shows less cannot be told."""
TOLD_SINCE = 130300
"""From this number on a file that tells when commands were given has no sampler: it would tell a lie."""
COMMANDS_SINCE = 134000
"""From this number on commands have any unit: %, mA, counts of a converter."""
LEAST_COMMAND, LARGEST_COMMAND = 0.1, 3000.0
"""Of the file's units of a command in one volt."""
RELEVANT = 0.02
"""Of the movement's deviation: what a sampler leaves and is more has no name, and is rightly unexplained."""
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
        volt: Of the file's units of a command in one volt.
        mains: Part of the disturbance's variance that is a hum of 50 Hz with overtones; the rest is as above.
        sampler: How the command came into the record. `finer`: it changed also between rows, and is recorded
            as it was at each row; `late`: likewise, but as it was a part of a row before; `slower`: it was
            looked at every so many rows.
        sampled: Commands to a row; of `slower` rows to a look.
        late: Commands by which the record is late.
        leaves: Of the movement's deviation, what Eq. 1 refitted leaves for the sampler alone.
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
    mains: float = 0.0
    sampler: str = "none"
    sampled: int = 1
    late: int = 0
    leaves: float = 0.0
    volt: float = 1.0

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
        volts = self.volt if unit.split("/")[0] == "V" else 1.0
        return sign * value * self.length**lengths * self.time**seconds * volts

    def gain(self, K_L: float) -> float:
        """K_L in the file's units."""
        return self.sign * K_L * self.length / self.time / self.volt

    @property
    def also_there(self) -> set[str]:
        """Causes that such a rig has beside those that are hidden: they may be named."""
        hum = self.hum + self.mains
        return {name for name, there in (("periodic_disturbance", hum), (COARSE, self.bits)) if there}

    def forgiven(self, causes, told: dict) -> dict:
        """The answer without what is there as well, and without the verdict on what a sampler leaves.

        A name stays that is told to be indistinguishable from what is hidden.
        """
        extra, hidden = self.also_there - set(causes), set(causes)
        effects = [
            each
            for each in told["effects"]
            if each["name"] not in extra or hidden.intersection(each["indistinguishable_from"])
        ]
        verdict = told["verdict"]
        if verdict == "unexplained" and self.leaves > RELEVANT and not set(causes) & set(UNLISTED):
            verdict = "effects"
        freed = verdict == "effects" and not effects
        return told | {"effects": effects, "verdict": "clean" if freed else verdict}


def dimension(unit: str, *, sees_speed: bool) -> tuple[int, int]:
    """Powers of length and time in a unit such as `unit/s^2` or `rad/unit`."""
    if "for a speed" in unit:
        unit = "unit/s" if sees_speed else "unit"
    unit, _, _ = unit.partition(" for each ")
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
    how = Rough(
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
    if case.number >= COMMANDS_SINCE:
        spread = math.log(LEAST_COMMAND), math.log(LARGEST_COMMAND)
        how = replace(how, volt=math.exp(np.random.default_rng([case.number, 13]).uniform(*spread)))
    return how if case.number < SENSORS_SINCE else _with_mains_and_sampler(case, how)


def _with_mains_and_sampler(case: Case, how: Rough) -> Rough:
    """By a stream of their own. Samples that are taken at random times have no sampler, nor told commands."""
    random = np.random.default_rng([case.number, 11])
    mains = float(random.uniform(0.1, 0.6) * (random.random() < 0.4))
    sampler = str(random.choice(SAMPLERS, p=OF_SAMPLERS))
    finer, slower = int(random.choice(FINER)), int(random.choice(SLOWER))
    late = int(random.integers(1, finer + 1))
    told = case.latency > 0.0 and case.number >= TOLD_SINCE
    if sampler == "none" or told or "jitter" in case.defects:
        return replace(how, mains=mains)
    how = replace(
        how,
        mains=mains,
        sampler=sampler,
        sampled=slower if sampler == "slower" else finer,
        late=late if sampler == "late" else 0,
    )
    how = replace(how, leaves=sampler_leaves(case, how))
    return how if case.number < MILD_SINCE else _mild(case, how)


def _mild(case: Case, how: Rough) -> Rough:
    """With a sampler nearer to the rows, until it loses no more than the noise; if none is, without one."""
    while how.leaves > case.noise_part:
        fewer = how.sampled // 2 if how.sampler != "slower" else how.sampled - 1
        if fewer < 2:
            return replace(how, sampler="none", sampled=1, late=0, leaves=0.0)
        how = replace(how, sampled=fewer, late=min(how.late, fewer))
        how = replace(how, leaves=sampler_leaves(case, how))
    return how


def sampler_leaves(case: Case, how: Rough) -> float:
    """What a refit of Eq. 1 to the recorded command leaves without effects, over the movement's deviation."""
    bare = replace(case, rig=replace(case.rig, effects={}), causes=(), defects={})
    y, u = sampled(bare, how, np.zeros(len(case.t)))
    start = case.rig.K_L, case.rig.omega_n, case.rig.zeta
    left = best_baseline(y, u, case.tick, start, sees_speed=case.rig.sees_speed)
    return left.rms / float(np.std(detrend(y)))


def sampled(case: Case, how: Rough, noise):
    """Readings and commands of the rows as they are recorded; `noise` of each row's reading."""
    rows = np.arange(len(case.t))
    if how.sampler in {"none", "slower"}:
        y, u = run(case, noise)
        return y, u if how.sampler == "none" else u[rows - rows % how.sampled]
    each = np.arange(len(rows) * how.sampled)
    t = each * (case.tick / how.sampled)
    random = np.random.default_rng([case.number, 1])
    drive = make_drive(case.excitation, case.rig, t, case.volts, random, case.hysteresis)
    on_the_way = np.minimum(-(-each // how.sampled), len(rows) - 1)
    supply, torque = (x if x is None else x[on_the_way] for x in (supply_of(case), torque_of(case)))
    y, u = simulate(case.rig, t, drive, noise[each // how.sampled], supply, torque, case.latency)
    return y[rows * how.sampled], u[np.maximum(rows * how.sampled - how.late, 0)]


def make_rough_record(case: Case, how: Rough) -> Record:
    """What the file holds."""
    random = np.random.default_rng([case.number, 10])
    noise = case.noise * _disturbance(case, how, random)
    shaken = _shaken(case, how)
    y, u = sampled(shaken, how, noise)
    if not np.all(np.isfinite(y)):  # torques drive the load to where the plant's own law ends
        y, u = sampled(case, how, noise)
    y = with_defects(case, y, random)
    supply, f = supply_of(case), channel_of(case)
    scale = how.length / how.time if case.rig.sees_speed else how.length
    t = case.t * how.time
    t_u = t + case.latency * how.time if case.latency else None
    y, u = _converted(y * scale, how.bits), _converted(u * how.sign * how.volt, how.bits)
    ps = None if supply is None else 7e6 * supply
    return Record(t, u, y, t_u, ps, None if f is None else _converted(f, how.bits))


def _disturbance(case: Case, how: Rough, random):
    """Of the readings, in noise deviations: noise of a colour, a line, an offset that moves slowly."""
    n = len(case.t)
    noise = lfilter([math.sqrt(1.0 - how.colour**2)], [1.0, -how.colour], random.normal(size=n + 1000))[1000:]
    line = math.sqrt(2.0) * np.sin(2.0 * math.pi * how.hum_hz * case.t + random.uniform(0.0, 6.3))
    slow = 2.0 * math.pi * case.t / case.duration * random.uniform(0.3, 1.5)
    wander = math.sqrt(2.0) * np.sin(slow + random.uniform(0.0, 6.3))
    plain = 1.0 - how.hum - how.wander - how.gusts
    old = math.sqrt(plain) * noise + math.sqrt(how.hum) * line + math.sqrt(how.wander) * wander
    if how.mains == 0.0:
        return old
    return math.sqrt(1.0 - how.mains) * old + math.sqrt(how.mains) * _mains(case, how)


def _mains(case: Case, how: Rough):
    """A hum of deviation 1, which the sensor sees as its converter takes it, without a filter before it."""
    random = np.random.default_rng([case.number, 12])
    turns = MAINS_HZ * how.time * case.t
    parts = [size * random.uniform(0.0, 1.0) if k else size for k, size in enumerate(OVERTONES)]
    wave = sum(
        part * np.sin(2.0 * math.pi * (k * turns + random.random())) for k, part in enumerate(parts, 1)
    )
    return wave / math.sqrt(0.5 * sum(part**2 for part in parts))


def _shaken(case: Case, how: Rough) -> Case:
    """With random torques under which the reading moves as much as their part of the disturbance."""
    if how.gusts <= 0.0 or "gusts" in case.rig.effects:
        return case
    _, u = run(case)
    tried = _with_gusts(case, case.rig.omega_n**2 * case.noise)
    given = Drive(GIVEN, u)
    quiet, moved = (
        simulate(each.rig, case.t, given, None, supply_of(case), torque_of(each), case.latency)[0]
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
