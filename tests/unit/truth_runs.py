"""Runs of the plant written apart (`plant_truth`): given commands, a sampled and an ideal relay."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from plant_laws import PLACE

if TYPE_CHECKING:
    from plant_truth import Plant


def follow(plant: Plant, t_u, u, t, supply=None, warmth=None, force=None) -> np.ndarray:
    """Readings at `t` under commands `u` at `t_u`; conditions of row k hold on the way to it."""
    arrivals = np.asarray(t_u) + plant.of("transport_delay", "time")
    y, given = np.empty(len(t)), 0
    changing = any(each is not None for each in (supply, warmth, force))
    bounds = list(t) if changing else [t[-1]]
    first = 0
    for k, bound in enumerate(bounds):
        plant.supply = supply[k] if supply is not None else 1.0
        plant.warmth = warmth[k] if warmth is not None else 0.0
        plant.force = force[k] if force is not None else 0.0
        last = k + 1 if changing else len(t)
        while True:
            stop = min(bound, arrivals[given]) if given < len(u) else bound
            part = plant.advance(max(stop, plant.t), t[first:last])
            fresh = ~np.isnan(part)
            y[first:last][fresh] = part[fresh]
            if stop == bound and (given == len(u) or arrivals[given] > bound):
                break
            plant.command(u[given])
            given += 1
        if t[last - 1] == plant.t:
            y[last - 1] = plant.reading(plant.w)
        first = last
    return y


def sampled_relay(plant: Plant, e_a, t, latency=0.0, hysteresis=0.0, reference=0.0, bias=0.0):
    """A relay that looks at the ticks; readings and the commands made from them."""
    y, u, pending, sign, integral = np.empty(len(t)), np.empty(len(t)), [], 1.0, 0.0
    for k, now in enumerate(t):
        while pending and pending[0][0] <= now:
            due, volts = pending.pop(0)
            plant.advance(due)
            plant.command(volts)
        plant.advance(now)
        y[k] = plant.reading(plant.w)
        if plant.sees_speed and k:
            integral += (0.5 * (y[k] + y[k - 1]) - reference) * (t[k] - t[k - 1])
        error = integral if plant.sees_speed else y[k] - reference
        if abs(error) > hysteresis:
            sign = -math.copysign(1.0, error)
        u[k] = bias + sign * e_a
        pending.append((now + latency + plant.of("transport_delay", "time"), u[k]))
    return y, u


def ideal_relay(plant: Plant, e_a, until, lag=0.0, hysteresis=0.0, speed=None, reference=0.0, bias=0.0):
    """Times at which the position, or the integral of its speed's error, passes the relay's threshold."""
    switches, sign, start, centre = [], 1.0, plant.t, reference if speed is None else plant.w[PLACE]
    plant.command(bias + e_a)
    while plant.t < until:

        def rises(t, reading, sign=sign):
            return sign * (reading - centre - (speed or 0.0) * (t - start)) - hysteresis

        plant.advance(until, watch=rises)
        if plant.t >= until:
            break
        switches.append(plant.t)
        sign = -sign
        plant.advance(plant.t + lag + plant.of("transport_delay", "time"))
        plant.command(bias + sign * e_a)
    return np.array(switches)
