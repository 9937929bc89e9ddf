"""The gain that fits best at a given natural frequency and damping, found without a search."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.causes.table import CAUSES, OFFSET, SOLVED
from seod.diagnose.fitting.least_squares import LeastSquares
from seod.diagnose.fitting.normal_equations import Normal
from seod.diagnose.fitting.simulate import POSITION, simulate
from seod.diagnose.tuning.fitting import LINEAR_GAIN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


class LinearGain(NamedTuple):
    """What fits best at a natural frequency and a damping.

    Attributes:
        K_L: [unit/s/V].
        loads: Sizes of what acts on the load, by their places: the bias [unit/s^2], and the gain of a
            disturbance that was measured, where one was.
        cost: Mean log squared error that they leave.
    """

    K_L: float
    loads: Values
    cost: float


def linear_gain(model: Model, cut: Cut, x: Array, start: Array, known: float | None = None) -> LinearGain:
    """K_L and the loads that fit best at the omega_n and zeta of `x`, the initial states being free.

    Exact for Eq. 1, whose answer is linear in them; for the effects of a rig's file a guess.

    Args:
        model: Eq. 1, with the effects of a rig's file.
        cut: The windows.
        x: Searched numbers, shape (p,).
        start: Initial states, shape (w, 7).
        known: K_L [unit/s/V] if it is known.
    """
    search = LeastSquares(model, cut, map, np.zeros(len(x), np.bool_))
    columns, loads = [], _loads(model)
    at_rest = simulate(model.kernel_parameters(x), cut, start)
    for column in model.states:
        moved = start.copy()
        moved[:, column] += model.state_sizes[column]
        columns.append(simulate(model.kernel_parameters(x), cut, moved) - at_rest)
    pushed = [simulate(_loaded(model, x, name, size), cut, start) for name, size in loads.items()]
    place = np.concatenate([np.full(n, s) for n, s in zip(cut.sizes, start[:, POSITION], strict=True)])
    offset = np.zeros_like(place) if model.sees_speed else place
    K_L = model.values(x)["K_L"]
    answers = [(each - at_rest) / size for each, size in zip(pushed, loads.values(), strict=True)]
    every = [*columns, (at_rest - offset) / K_L, *answers, search.y - offset]
    n = 1 + len(loads)
    table = np.stack(every, axis=1) * search.good[:, None]
    products = np.array([table[rows].T @ table[rows] for rows in search.slices])
    normal = Normal(products, model.states, model.state_sizes, np.arange(n), n)
    found = _solved(normal.total, known)
    error = normal.reduced[:, n, n] - 2.0 * normal.reduced[:, n, :n] @ found
    error += np.einsum("i,wij,j->w", found, normal.reduced[:, :n, :n], found)
    sizes = {SOLVED[name]: float(size) for name, size in zip(loads, found[1:], strict=True)}
    cost = search.cost(np.maximum(error, 0.0) / np.maximum(search.count, 1))
    return LinearGain(float(found[0]) or 1e-9, sizes, cost)


def _loads(model: Model) -> Values:
    """What is solved for beside the gain, by its cause, and the size of each that is simulated."""
    sizes, bias = model.scales, LINEAR_GAIN.bias * model.scales.pressure
    follows = [each for each in SOLVED if each != OFFSET and each not in {*model.names, *model.fixed}]
    followed = {each: bias / sizes.force for each in follows if CAUSES[each].searched(sizes)}
    return {OFFSET: bias} | followed


def _loaded(model: Model, x: Array, name: str, size: float) -> NDArray[np.void]:
    """The kernel's parameters with one load of this size."""
    loaded = model if name in model.names else model.with_effect(name)
    at = np.concatenate([x, np.zeros(len(loaded.coordinates) - len(x))])
    return loaded.kernel_parameters(loaded.searched({**loaded.values(at), SOLVED[name]: size}))


def _solved(total: Array, known: float | None) -> Array:
    """K_L, which may be known, and the loads."""
    n = len(total) - 1
    if known is None:
        return np.asarray(np.linalg.lstsq(total[:n, :n], total[:n, n], rcond=1e-12)[0])
    loads = np.linalg.lstsq(total[1:n, 1:n], total[1:n, n] - total[1:n, 0] * known, rcond=1e-12)[0]
    return np.concatenate([[known], loads])
