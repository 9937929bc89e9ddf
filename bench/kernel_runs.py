"""The kernel's runs with the signatures of `kernel_in_c`: without noise, supply and oil as they are named."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from kernel_tasks import NOTHING, command, plant

from sim import runs
from sim.state import new_state

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Kernel:
    """Records of shape (1,), arrays of one element a row."""

    def follow(self, p: NDArray, s: NDArray, t: NDArray, u: NDArray, y: NDArray) -> None:
        runs.follow(p[0], s[0], t, u, t, NOTHING, NOTHING, NOTHING, NOTHING, y)

    def sampled_relay(
        self, p: NDArray, s: NDArray, r: NDArray, t: NDArray, y: NDArray, u: NDArray, t_u: NDArray
    ) -> None:
        runs.sampled_relay(p[0], s[0], r[0], t, NOTHING, NOTHING, NOTHING, NOTHING, y, u, t_u)

    def ideal_relay(
        self, p: NDArray, s: NDArray, r: NDArray, t: NDArray, y: NDArray, switches: NDArray
    ) -> int:
        return runs.ideal_relay(p[0], s[0], r[0], t, y, switches)


def follow_once(kernel: Kernel, p: NDArray, seconds: float) -> NDArray:
    """What is measured under the command of `kernel_tasks`."""
    t, u = command(seconds)
    s, y = new_state(p), np.empty(len(t))
    kernel.follow(p, s, t, u, y)
    return y


def relay_once(kernel: Kernel, p: NDArray, seconds: float, *, ideal: bool) -> NDArray:
    """What is measured under a relay of 0.5 V, from a deflection of 0.05 rad."""
    t = command(seconds)[0]
    r, s, y = np.zeros(1, runs.RELAY), new_state(p, position=-0.05), np.empty(len(t))
    r["e_a"] = 0.5
    if ideal:
        kernel.ideal_relay(p, s, r, t, y, np.empty(1000))
    else:
        kernel.sampled_relay(p, s, r, t, y, np.empty(len(t)), np.empty(len(t)))
    return y


def everything_once() -> None:
    """Have all of it compiled or loaded."""
    kernel, p = Kernel(), plant()
    follow_once(kernel, p, 0.1)
    relay_once(kernel, p, 0.1, ideal=False)
    relay_once(kernel, p, 0.1, ideal=True)
