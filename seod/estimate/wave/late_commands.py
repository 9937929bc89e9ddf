"""Single voltages that come earlier or later than told, as where a device looks only now and then.

Each leaves a step of position, which no white noise explains and which an autoregression follows badly. Their
times are unknowns with a common standard deviation, which the residual itself tells (MacKay, Neural
Computation 4, 1992: the evidence's fixed point).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.estimate.noise import WHITE, seen_in
from seod.estimate.wave.search import Lateness, Search

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.wave.window import Window

FEWEST, MOST = 3, 40
"""Changes of the voltage in a window: fewer tell no deviation, more are a relay that chatters."""
FEW: Final = 1.2
"""Over as many times told, the part by which their deviation is widened: Student's factor, nearly."""
ITERATIONS: Final = 12
NONE_OF_IT: Final = 0.1
"""Unknowns that the data tell of all those times together, below which there is nothing of the kind."""


def search_late(window: Window, theta: Array, gain: float, sigma: float) -> Search | None:
    """A search from `theta` with the times of single voltages unknown; None where that explains nothing.

    Args:
        window: What is measured and known.
        theta: End of a search without it, shape (3,).
        gain: K_L there [unit/s/V].
        sigma: Innovations of the noise that it saw [unit].
    """
    changes = _changes(window, float(theta[2]))
    found = None if changes is None else _deviations(window, theta, changes, gain)
    if found is None:
        return None
    late, noise = found
    search = Search(window, WHITE, noise, late)
    search.run(theta)
    rest = seen_in(search.here.residual)
    if rest.memory or rest.rejected:
        search = Search(window, rest, noise, late)
        search.run(theta)
    cost = late.number * math.log(len(window.t)) / len(window.t)
    return search if 2.0 * math.log(sigma / max(search.sigma, 1e-300)) > cost else None


def _changes(window: Window, delay: float) -> slice | None:
    """The changes of the voltage that come within the window."""
    arrive = window.voltage.t_u + delay + window.lag
    first = max(int(np.searchsorted(arrive, window.t[0], side="right")), 1)
    last = int(np.searchsorted(arrive, window.t[-1]))
    return slice(first, last) if FEWEST <= last - first <= MOST else None


def _deviations(window: Window, theta: Array, changes: slice, gain: float) -> tuple[Lateness, float] | None:
    """That of the times [s], and that of the noise beside them [unit]; linear about `theta`."""
    tick = float(window.t[-1] - window.t[0]) / len(window.t)
    late = Lateness(tick, changes, gain)
    search = Search(window, WHITE, None, late)
    here = search.here = search.at(theta)
    sigma, count, known = search.sigma, late.number, here.gram - here.jacobian @ here.jacobian.T
    precision = known.diagonal() / search.sigma_before**2
    gram, gradient = here.gram - known, here.jacobian @ here.white
    at, sd = here.weights[-count:], late.sd
    fixed = len(gram) - count
    identified = 0.0
    for _ in range(ITERATIONS):
        precision[-count:] = sd**-2
        pull = here.pull / search.sigma_before**2
        pull[-count:] = -at * precision[-count:]
        covariance = np.linalg.pinv(gram / sigma**2 + np.diag(precision), hermitian=True)
        step = covariance @ (gradient / sigma**2 + pull)
        times = at + step[-count:]
        identified = count - float(np.trace(covariance[-count:, -count:])) / sd**2
        if identified < NONE_OF_IT:
            return None
        sd = math.sqrt(float(times @ times) / identified)
        residual = here.white - step @ here.jacobian
        sigma = math.sqrt(float(residual @ residual) / max(len(residual) - fixed - identified, 1.0))
    return late._replace(sd=sd * (1.0 + FEW / identified)), sigma
