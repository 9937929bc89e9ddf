"""The relay that drives hidden rigs, compiled for `hidden_plant.run`."""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def relay(c, memory, t, signal, k):
    """Two-phase where `c[2]`: that many cycles as they are, as many late by a quarter of a period.

    It switches where the signal is beyond `c[4]`: without hysteresis it follows the noise when a load sticks.

    `memory`: asked sign, shown sign, when it follows, last upward switch, period, cycles, lateness, integral.
    """
    asked = -1.0 if signal > 0.0 else 1.0
    if k > 0 and abs(signal) < c[4]:
        asked = memory[0]
    if k == 0:
        memory[:] = 0.0
        memory[0] = memory[1] = asked
        memory[3] = np.nan
    if asked != memory[0]:
        memory[0], memory[2] = asked, t + memory[6]
        if asked > 0.0:
            if not np.isnan(memory[3]):
                memory[5] += 1.0
                if memory[6] == 0.0:
                    memory[4] = t - memory[3]
            memory[3] = t
            if 0.0 < c[2] <= memory[5]:
                memory[5] = 0.0
                memory[6] = 0.25 * memory[4] if memory[6] == 0.0 else 0.0
    if t >= memory[2]:
        memory[1] = memory[0]
    return c[1] + memory[1] * c[0]
