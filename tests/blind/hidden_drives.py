"""How hidden rigs are driven: relay, two phases, multisine, steps, operation, two commands of a clock."""

from __future__ import annotations

import math

import numpy as np
from hidden_rig import GIVEN, RELAY, SERVO, Drive

EXCITATIONS = ("relay", "two-phase", "multisine", "steps", "operation")
CLOCKED = ("square", "binary")
"""Two commands that no movement switches: a square wave, and binary noise."""


def make_drive(excitation: str, rig, t, volts: float, random, hysteresis: float = 0.0) -> Drive:
    """The drive for this plant; `volts` is the relay's amplitude, or the largest command."""
    n = len(t)
    if excitation == "relay":
        return Drive(RELAY, np.zeros(n), (volts, 0.0, 0.0, 0.0, hysteresis))
    if excitation == "two-phase":
        return Drive(RELAY, np.zeros(n), (volts, 0.0, 3.0, 0.0, hysteresis))
    if excitation == "multisine":
        return Drive(GIVEN, multisine(t, volts, rig.omega_n, random))
    if excitation == "steps":
        return Drive(GIVEN, mirrored_steps(t, volts, rig.omega_n, random))
    if excitation == "operation":
        return operation(rig, t, volts, random)
    if excitation == "square":
        return Drive(GIVEN, square(t, volts, rig.omega_n, random))
    if excitation == "binary":
        return Drive(GIVEN, binary_noise(t, volts, rig.omega_n, random))
    raise ValueError(f"{excitation}: there are {', '.join((*EXCITATIONS, *CLOCKED))}")


def multisine(t, volts, omega_n, random):
    """Lines from a tenth to three times the plant's frequency, four periods in the record."""
    period = t[-1] / 4.0
    first = max(1, round(0.1 * omega_n / (2.0 * math.pi) * period))
    last = max(first + 3, round(3.0 * omega_n / (2.0 * math.pi) * period))
    orders = np.unique(np.round(np.geomspace(first, last, 60)).astype(int))
    phases = random.uniform(0.0, 2.0 * math.pi, len(orders))
    wave = sum(
        np.sin(2.0 * math.pi * k / period * t + phase) for k, phase in zip(orders, phases, strict=True)
    )
    return volts * wave / np.max(np.abs(wave))


def mirrored_steps(t, volts, omega_n, random):
    """Levels that last 2 to 8 radians of the plant, each followed by its mirror image."""
    u, at = np.zeros(len(t)), 0.0
    while at < t[-1]:
        level, half = random.uniform(0.2, 1.0) * volts * random.choice([-1.0, 1.0]), random.uniform(2.0, 8.0)
        half *= 1.0 / omega_n
        u[(t >= at) & (t < at + half)] = level
        u[(t >= at + half) & (t < at + 2.0 * half)] = -level
        at += 2.0 * half
    return u


def square(t, volts, omega_n, random):
    """A square wave of 4 to 40 radians of the plant in each of its halves."""
    half = float(np.exp(random.uniform(np.log(4.0), np.log(40.0)))) / omega_n
    return volts * np.where(((t + random.uniform(0.0, 2.0) * half) / half) % 2.0 < 1.0, 1.0, -1.0)


def binary_noise(t, volts, omega_n, random):
    """Either of two values, drawn anew every 0.5 to 8 radians of the plant."""
    clock = float(np.exp(random.uniform(np.log(0.5), np.log(8.0)))) / omega_n
    values = random.choice([-volts, volts], int(t[-1] / clock) + 2)
    return values[(t / clock).astype(int)]


def operation(rig, t, volts, random) -> Drive:
    """Moves and rests under a proportional position controller; a speed is driven open loop."""
    if rig.sees_speed:
        return Drive(GIVEN, np.interp(t, *moves(t, volts, rig.omega_n, random)))
    gain = min(0.4 * 2.0 * rig.zeta * rig.omega_n, 0.3 * rig.omega_n) / rig.K_L
    references = np.interp(t, *moves(t, 0.7 * volts / gain, rig.omega_n, random))
    return Drive(SERVO, references, (gain, 3.0 * volts, 0.0, 0.0))


def moves(t, size, omega_n, random):
    """Corners of ramps between random places, with rests."""
    times, places = [0.0], [0.0]
    while times[-1] < t[-1]:
        place = random.uniform(-size, size)
        times += [times[-1] + random.uniform(2.0, 15.0) / omega_n, 0.0]
        times[-1] = times[-2] + random.uniform(1.0, 15.0) / omega_n
        places += [place, place]
    return times, places
