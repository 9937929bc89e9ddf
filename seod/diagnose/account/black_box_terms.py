"""Terms of the black box: what may brake the load, be added to the command, or to the reading.

Forces act on the load, volts on the valve, of the fitted plant, so that what they do to the reading drifts as
it does.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import cont2discrete, lfilter

from seod.diagnose.fitting.noise_colour import WHITE, NoiseColour
from seod.diagnose.tuning.account import BLACK_BOX

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import Plant, WindowResidual
    from seod.diagnose.result import Array


def sizes_of(parts: Sequence[WindowResidual]) -> dict[str, float]:
    """Largest values over all windows."""
    names = ["u", "pressure", "velocity", "position"]
    if all(len(one.force) for one in parts):
        names.append("force")
    return {
        name: max(1e-300, *(float(np.max(np.abs(getattr(one, name)))) for one in parts)) for name in names
    }


def columns_of(
    one: WindowResidual,
    plant: Plant,
    sizes: dict[str, float],
    asked: tuple[Sequence[tuple[int, float]], Array],
    noise: NoiseColour,
) -> Array:
    """All terms, the residual with what is added, and noises, without what a state at the beginning would do.

    All as they come through what makes this noise white. Shape (n, terms + asked).
    """
    added, noises = asked
    tick = float(np.median(np.diff(one.t)))
    u, p, v, x = (getattr(one, name) / sizes[name] for name in ("u", "pressure", "velocity", "position"))
    angle = tick * plant.omega_n
    measured = _measured(one.force / sizes["force"], angle) if "force" in sizes else []
    forces = _through(_load(plant), [*_forces(p, v, x), *measured], angle)
    volts = _through(_valve(plant), _volts(u, p, x, angle), angle)
    error = np.where(one.scored, one.error, 0.0)
    columns = np.column_stack([*forces, *volts, *_readings(p, v, x), error])
    shapes = shapes_of(one, plant, sizes)
    more = [columns[:, -1] + size * shapes[:, k] for k, size in added[1:]]
    return _without_beginning(np.column_stack([columns, *more, noises]), one, plant, angle, noise)


def _without_beginning(
    columns: Array, one: WindowResidual, plant: Plant, angle: float, noise: NoiseColour
) -> Array:
    """Columns, made white, less what is as a state at the window's beginning moves the reading."""
    kept, white = noise.has_past(one.scored), noise.whitened(columns)
    basis, _ = np.linalg.qr(noise.whitened(free_movements(len(one.t), plant, angle))[kept])
    white[kept] -= basis @ (basis.T @ white[kept])
    return white


def _forces(p: Array, v: Array, x: Array) -> list[Array]:
    """What may brake the load."""
    sign = np.tanh(v / BLACK_BOX.sharp)
    waves = [wave(k * math.pi * x) for k in range(1, BLACK_BOX.waves + 1) for wave in (np.cos, np.sin)]
    return [
        np.ones_like(v),
        *(sign, sign * np.exp(-np.abs(v) / BLACK_BOX.stribeck), v, v * np.abs(v), v**3),
        *(x, x * np.abs(x), x * x, x**3),
        *(sign * x, sign * np.abs(p), v * x, v * x * x, v * p),
        *waves,
    ]


def _measured(f: Array, angle: float) -> list[Array]:
    """What a disturbance that is measured may do to the load, at once or later."""
    return [f, f * np.abs(f), *_lagged(f, angle)]


def _lagged(x: Array, angle: float) -> list[Array]:
    """The same later, by some parts of the plant's own time."""
    rows = [min(max(1, round(lag / angle)), len(x) - 1) for lag in BLACK_BOX.lags]
    return [np.r_[np.full(k, x[0]), x[:-k]] for k in rows]


def _volts(u: Array, p: Array, x: Array, angle: float) -> list[Array]:
    """What may be added to the command."""
    hinges = [np.sign(s) * np.maximum(np.abs(s) - part, 0.0) for s in (u, p) for part in BLACK_BOX.hinges]
    change = np.gradient(p) / angle
    return [
        *(u, np.abs(u), u * np.abs(u), u * u, u**3, np.tanh(u / BLACK_BOX.sharp)),
        *(np.abs(p), p * np.abs(p), p * p, p**3, u * p, np.abs(u) * p, u * np.abs(p), u * p * p),
        *(u * x, p * x, change * x, change, change * np.abs(p)),
        *hinges,
        *_lagged(u, angle),
    ]


def _readings(p: Array, v: Array, x: Array) -> list[Array]:
    """What may be added to the reading."""
    waves = [wave(k * math.pi * x) for k in range(1, BLACK_BOX.waves + 1) for wave in (np.cos, np.sin)]
    return [np.tanh(v / BLACK_BOX.sharp), v, p, np.abs(v), np.abs(x), x * x, x**3, v * x, v * x * x, *waves]


def _load(plant: Plant) -> tuple[Array, Array]:
    """From a force against the load to the reading, but for a factor: -(s + 2 zeta) / (s^2 + ...) of Eq. 1.

    Time is counted in 1 / omega_n.
    """
    return np.array([-1.0, -2.0 * plant.zeta]), _poles(plant)


def _valve(plant: Plant) -> tuple[Array, Array]:
    """Likewise from volts: Eq. 1."""
    return np.ones(1), _poles(plant)


def _poles(plant: Plant) -> Array:
    poles = np.array([1.0, 2.0 * plant.zeta, 1.0])
    return poles if plant.sees_speed else np.r_[poles, 0.0]


def _through(transfer: tuple[Array, Array], inputs: Sequence[Array], angle: float) -> list[Array]:
    """What inputs that are held between samples do, from rest; `angle` is omega_n times the interval."""
    number, poles, _ = cont2discrete(transfer, angle)
    return list(lfilter(number.ravel(), poles, np.array(inputs), axis=-1))


def free_movements(n: int, plant: Plant, angle: float) -> Array:
    """An offset, and movements of the plant that is left alone; shape (n, 3).

    A position that is left alone ends anywhere: its offset is among them.
    """
    _, poles, _ = cont2discrete(_valve(plant), angle)
    left_alone = lfilter([1.0], poles, np.eye(len(poles) - 1, n), axis=-1)
    return np.column_stack([np.ones(n), *left_alone] if plant.sees_speed else [*left_alone])


def shapes_of(one: WindowResidual, plant: Plant, sizes: dict[str, float]) -> Array:
    """Systematic parts that are none of the black box's own terms, shape (n, shapes).

    As a load or a valve off the list would make them, without what a state at the beginning would do.
    """
    u, v, x = (getattr(one, name) / sizes[name] for name in ("u", "velocity", "position"))
    angle = float(np.median(np.diff(one.t))) * plant.omega_n
    wave, limit = np.sin(BLACK_BOX.unlisted_wave * math.pi * x), BLACK_BOX.unlisted_limit
    forces = _through(_load(plant), [np.sign(v) * np.sqrt(np.abs(v)), wave], angle)
    volts = _through(_valve(plant), [np.clip(u, -limit, limit), u * np.sqrt(np.abs(u)) * x], angle)
    return _without_beginning(np.column_stack([*forces, *volts]), one, plant, angle, WHITE)
