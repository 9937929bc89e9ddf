"""A frequency response on the rig: what fits its limits, drive by drive, and the relay for comparison."""

from __future__ import annotations

import math
import time
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from seod.calibrate.procedure import CalibrationError
from seod.calibrate.ramp import settled, step_of
from seod.calibrate.session import RemoteRig
from seod.client import ClientError
from seod.respond.design import ROOM, Excitation, Room, largest, multisines, settling_time, sines
from seod.respond.fit import Plant
from seod.respond.record import RespondError, Segment
from seod.respond.relay import LimitCycle

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from seod.client import Client
    from seod.config.axis import AxisConfig
    from seod.respond.design import Tones

Kind = Literal["multisine", "sine"]
BACK_S: Final = 5.0
"""After an interruption the axis may take so long to come back."""
_CYCLES: Final = 10
_SHORTEST_S: Final = 0.4
"""Of a single tone: so many cycles, and at least so long."""
_MORE_S: Final = 0.05
"""A drive lasts longer by this, so that no late tick takes the last period away."""
PEAK: Final = 1.03
"""Its sum of tones may be larger between the instants at which its peak was sought."""
_BAND: Final = (0.05, 3.0)
"""In parts of the plant's frequency, where no band is given."""


@dataclass(frozen=True)
class Options:
    """How to excite.

    Attributes:
        kind: Multisines, or sines one after the other.
        amplitude: Largest voltage [V]; None: e_a, or less where the limits ask for it.
        band: [Hz]; None: about the frequency that the relay tells.
        period: Of the multisine [s]; None: that of the band's lower end.
        periods: Analysed in each drive of a multisine.
        realisations: Multisines with other phases.
        points: Sines.
        relay: Run the relay before, for comparison.
        e_a: Amplitude of that relay [V]; None: as it is set.
        seed: Of the phases.
    """

    kind: Kind = "multisine"
    amplitude: float | None = None
    band: tuple[float, float] | None = None
    period: float | None = None
    periods: int = 6
    realisations: int = 4
    points: int = 20
    relay: bool = True
    e_a: float | None = None
    seed: int = 1


@contextmanager
def at_rest_afterwards(client: Client, axis: str) -> Iterator[None]:
    """Stop the axis however this ends, and wait until it is back where it stood."""
    try:
        yield
    finally:
        with suppress(ClientError):
            client.stop(axis)
            deadline = time.monotonic() + BACK_S
            while client.get(axis)["state"] not in ("idle", "fault") and time.monotonic() < deadline:
                time.sleep(0.05)


def limit_cycle(client: Client, axis: str, e_a: float | None) -> LimitCycle | None:
    """Run the relay until 20 estimates have come; None where they are not to be believed. e_a is restored.

    Raises:
        CalibrationError: The axis is in fault.
    """
    before = client.get(axis)["settings"]["e_a"]
    amplitude = before if e_a is None else e_a
    subscription = client.subscribe(["estimate", "event"], [axis])
    client.set(axis, e_a=amplitude)
    try:
        with at_rest_afterwards(client, axis):
            client.start(axis)
            estimates = settled(client, axis)
    finally:
        client.unsubscribe(subscription)
        client.set(axis, e_a=before)
    step = step_of(amplitude, estimates)
    gains = [e["K_L"] for e in estimates if e["quality"] == "ok" and e["K_L"] is not None]
    if step.omega_n is None or step.zeta is None or not gains:
        return None
    plant = Plant(median(gains), step.omega_n, step.zeta)
    return LimitCycle(plant, step.omega_n_sd or 0.0, step.zeta_sd or 0.0, amplitude)


def plan(axis: AxisConfig, options: Options, room: Room, K_L: float, plant: Plant | None) -> list[Excitation]:
    """The drives, all within their room.

    Args:
        axis: Its section of the rig file.
        options: How.
        room: What the motion may use.
        K_L: Gain [unit/s/V].
        plant: As far as it is known.

    Raises:
        RespondError: The wish goes beyond the limits; says what would fit.
    """
    band = options.band or _band(plant)
    random = np.random.default_rng(options.seed)
    settling = axis.excitation.entry + settling_time(
        plant, axis.hold.bandwidth if axis.mode == "position" else None
    )
    if options.kind == "multisine":
        period = options.period or 1.0 / band[0]
        sets = multisines(band, period, options.realisations, room.output, random)
        drives = [
            Excitation(period, tones, settling, settling + options.periods * period + _MORE_S)
            for tones in sets
        ]
    else:
        drives = [_sine(tones, settling) for tones in sines(band, options.points)]
    longest = max(drive.duration for drive in drives)
    if longest > axis.limits.excitation:
        what = f"a drive would take {longest:.3g} s, limits.excitation is {axis.limits.excitation:g} s"
        raise RespondError(f"{what}: raise the band's lower end, or take fewer periods")
    return _sized(drives, options, axis.relay.e_a, room, K_L, plant)


def _band(plant: Plant | None) -> tuple[float, float]:
    if plant is None:
        raise RespondError("the plant's frequency is not known: give the band, --band LOW:HIGH in Hz")
    low, high = (factor * plant.omega_n / (2.0 * math.pi) for factor in _BAND)
    return low, high


def _sine(tones: Tones, settling: float) -> Excitation:
    period = 1.0 / tones[0].frequency
    cycles = max(_CYCLES, math.ceil(_SHORTEST_S / period))
    return Excitation(period, tones, settling, settling + cycles * period + _MORE_S)


def _sized(
    drives: Sequence[Excitation], options: Options, e_a: float, room: Room, K_L: float, plant: Plant | None
) -> list[Excitation]:
    """Each tone of its own where there is one at a time, else all alike."""
    most = [largest(drive.tones, drive.period, room, K_L, plant) for drive in drives]
    wanted = options.amplitude or e_a
    if options.kind == "multisine":
        most = [min(most)] * len(drives)
        if options.amplitude is not None and most[0] < wanted:
            raise RespondError(
                f"an amplitude of {wanted:g} V may use more than {100 * ROOM:.0f} % of the axis' limits; "
                f"{most[0]:.2g} V fits, or a band that begins higher"
            )
    return [drive.scaled(min(wanted, size)) for drive, size in zip(drives, most, strict=True)]


def room_of(axis: AxisConfig, reading: float, bias: float, reference: float) -> Room:
    """What the motion may use about where the axis stands, or about its reference speed.

    Raises:
        RespondError: There is none.
    """
    low, high = axis.limits.travel
    velocity = axis.mode == "velocity"
    centre = reference if velocity else reading
    way = min(high - centre, centre - low)
    if not velocity:
        way = min(way, axis.limits.amplitude)
    speed = axis.limits.speed if axis.limits.speed is not None else math.inf
    volts = (axis.limits.output - abs(bias)) / PEAK
    if min(way, volts) <= 0.0:
        what = f"at {centre:.4g} limits.travel [{low:g}, {high:g}] and limits.output leave no room"
        raise RespondError(what)
    return Room("velocity" if velocity else "position", ROOM * way, ROOM * speed, volts)


def drive_all(
    rig: RemoteRig, name: str, drives: Sequence[Excitation], output: Any, told: Callable[[float], None]
) -> list[Segment]:
    """Put out all of them; what is settled of each.

    Raises:
        CalibrationError: The guard stopped it.
        RespondError: Nothing came of it.
    """
    segments = []
    for k, drive in enumerate(drives):
        told(k / len(drives))
        samples = rig.excite(PEAK * drive.most, drive.duration, drive.tones)
        fresh = np.array([sample["fresh"] for sample in samples])
        t, u, y, t_u = (np.array([sample[key] for sample in samples]) for key in ("t", "u", "y", "t_u"))
        y = np.where(fresh, y, math.nan)
        whole = Segment.of(name, t, u, y, t_u, output=output, period=drive.period)
        segments.append(whole.after(float(t[0]) + drive.settling))
    return segments


def measure(
    client: Client, name: str, axis: AxisConfig, options: Options, told: Callable[[str, float], None]
) -> tuple[list[Segment], LimitCycle | None, list[Excitation]]:
    """The relay's answer, if wanted, then the response; the axis is idle, and idle again afterwards.

    Raises:
        CalibrationError: It is not idle, or the guard stopped it.
        RespondError: The options do not fit the rig.
    """
    RemoteRig(client, name).close()  # once a sample has come, the loop takes commands
    now = client.get(name)
    if now["state"] != "idle":
        raise CalibrationError(f"{name} is {now['state']}: stop or reset it first")
    told("relay", 0.0)
    cycle = limit_cycle(client, name, options.e_a) if options.relay else None
    with closing(RemoteRig(client, name)) as rig, at_rest_afterwards(client, name):
        bias, reference = now["settings"]["bias"], now["settings"].get("reference") or 0.0
        K_L = rig.gain() if cycle is None else cycle.plant.K_L
        if axis.mode == "velocity":
            bias = abs(bias) + abs(reference / K_L)
        room = room_of(axis, rig.position(), bias, reference)
        drives = plan(axis, options, room, K_L, None if cycle is None else cycle.plant)
        return drive_all(rig, name, drives, room.output, lambda done: told(options.kind, done)), cycle, drives
